"""What can go wrong before the virtual bench runs.

VirtualBenchError
    a unit, scenario, profile or port that cannot be had; the text says what, found, allowed, and what to do next
"""


class VirtualBenchError(Exception):
    """The virtual bench cannot be built or started as asked."""
