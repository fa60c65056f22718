"""The process that scans: schedule, loop, what it asks of the machine, and its entry points."""
