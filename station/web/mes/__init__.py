"""The manufacturing execution system (MES) beside the station: what it says of units, and what it is told of runs."""
