"""What can go wrong with the wires, told so that a technician can act on it.

DriverError
├── BusError          the CAN bus cannot be opened
├── DriveSetupError   the drive is not the expected one, or did not take a protection
├── ModbusError       a Modbus device cannot be reached or is not the expected one
├── PaceError         no virtual bench waits where the bench file says
└── ProfileError      a device profile does not fit the part it is used for

Every error carries its findings as `Problem` rows, all of them at once. They are raised before the scan only: from the
first scan on, trouble is a state (`links_lost`, an age, a counter), never an exception.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """One finding: what is wrong, where (node and object, or address and unit), found, expected, what to do next."""

    what: str
    where: str
    found: str
    expected: str
    next_step: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}: found {self.found}, expected {self.expected}; {self.next_step}"


class DriverError(Exception):
    """Base of all errors of this package; `problems` holds every finding."""

    def __init__(self, *problems: Problem) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = problems


class BusError(DriverError):
    """The CAN bus cannot be opened."""


class DriveSetupError(DriverError):
    """The drive is missing, is another one than expected, or did not take a setting."""


class ModbusError(DriverError):
    """A Modbus device cannot be reached or is another one than expected."""


class PaceError(DriverError):
    """No virtual bench waits for the scan where the bench file says."""


class ProfileError(DriverError):
    """A device profile does not deliver what its part on the bench needs."""
