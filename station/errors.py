"""The errors of the station, each with the text a person reads."""

from __future__ import annotations


class StationError(Exception):
    """Something a person can mend: bad input, an unknown run, a file that is not there."""


class BenchFaultError(StationError):
    """The bench or the scan process failed: nothing could be measured, or not to the end."""


class RecordError(StationError):
    """A record cannot be written, or does not read back as it was written."""
