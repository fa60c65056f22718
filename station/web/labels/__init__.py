"""Labels for units: printed when the record of a run is sealed, and read back by a scan that must match."""
