"""What people touch: command line, run supervisor, records, reports.

Exceptions::

    StationError            what a person can mend: bad input, a run that is not there (exit 2)
    +-- BenchFaultError     the bench or the scan process failed (exit 4)
    +-- RecordError         a record that cannot be written or does not read back
"""

from station.errors import BenchFaultError, RecordError, StationError

__all__ = ["BenchFaultError", "RecordError", "StationError"]
