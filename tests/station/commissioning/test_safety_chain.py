"""The contacts while the drive is enabled in the step `watchdogs`: open, unknown, or only not asked for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from station.cli.commissioning.steps import STALE_MS, safety_chain
from station.commissioning.on_wires import ByHand


class RemoteIo:
    """A device that answers in every step, or not, on a clock of milliseconds that the test moves."""

    def __init__(self) -> None:
        self.scan, self.arrived, self.answers, self.asked = 0, 0, True, False
        self.values, self.lost, self.replies = [1, 1], False, 1
        self.devices = {"remote_io": self}

    def place(self, name: str) -> int:
        return ("estop_released", "guard_closed").index(name)

    def age_scans(self, scan: int) -> int:
        return scan - self.arrived

    def step(self) -> None:
        """Take the answer to the request of the step before, and ask again."""
        if self.asked and self.answers:
            self.arrived = self.scan
        self.asked = True


def looked_at() -> tuple[RemoteIo, Any]:
    device = RemoteIo()
    wires = SimpleNamespace(remote_io=SimpleNamespace(where="remote I/O"))
    return device, safety_chain(cast("ByHand", device), cast("Any", wires))


def test_contacts_that_nobody_asked_for_are_not_unknown() -> None:
    """The set-up of a drive took longer than half a second, and the trial behind it was given up."""
    device, look = looked_at()
    assert look() == ""
    device.scan += 5 * STALE_MS
    device.asked = False
    for _ in range(3):
        assert look() == ""
        device.scan += 1


def test_contacts_that_are_asked_for_in_vain_are_unknown_and_open_ones_are_named() -> None:
    device, look = looked_at()
    look()
    device.values[0] = 0
    device.scan += 1
    assert look() == "estop_released reads 0"
    device.answers = False
    said = ""
    for _ in range(STALE_MS + 10):
        device.scan += 1
        said = look()
    assert "emergency stop and guard are not known" in said
