"""A brake at a digital output of the drive: ordered in a receive PDO (0x60FE:1), seen in a transmit PDO (0x60FD).

It takes the place of a brake on Modbus in scan and image. What its output switches, and whether that holds when the
drive fails, the drive does not say: `definitions.device_proofs`.
"""

from __future__ import annotations

from collections.abc import Mapping

from definitions.image import AGE_NEVER
from drivers.can.bus import CanLink
from drivers.config import DriveBrakeConfig, DriveConfig
from drivers.errors import DriveSetupError, Problem
from drivers.servo_drive.drive import CanDrive
from drivers.servo_drive.objects import INPUTS
from drivers.servo_drive.sdo import SdoFailure, SdoNode


class OutputBrake:
    """The brake as the scan sees it; `values` is another list whenever what is known of it has changed."""

    names = ("brake_on",)
    lost = False
    """The bus is what may be lost, and that is known of its link."""

    def __init__(self, config: DriveBrakeConfig) -> None:
        """Prepare the masks of its bits."""
        self._output = 1 << config.output_bit
        self._input = 0 if config.input_bit is None else 1 << config.input_bit
        self._drive: CanDrive | None = None
        self._orders: dict[str, float] = {}
        self.values: list[float] = [0, 0]

    def opened(self, drive: CanDrive, outputs: int) -> None:
        """Take the drive with its outputs as they are: a lock that is closed may hold a wound-up unit."""
        drive.digital_outputs = outputs
        self._drive, self._orders, self.values = drive, {}, [0, 0]

    def place(self, name: str) -> int:
        """Index of a field in `values`; -1, which is the zero at the end, for one that it does not have."""
        return self.names.index(name) if name in self.names else -1

    def age_scans(self, scan: int) -> int:
        """Age of what is known of it: that of the drive's process data."""
        return AGE_NEVER if self._drive is None else self._drive.age_scans(scan)

    def ordered(self, name: str) -> float:
        """Return what was ordered last; 0 before."""
        return self._orders.get(name, 0.0)

    def order(self, orders: Mapping[str, float]) -> None:
        """Set or clear the output with the next set-points."""
        drive = self._drive
        if drive is not None:
            self._orders = dict(orders)
            on = self._output if orders["brake_on"] else 0
            drive.digital_outputs = drive.digital_outputs & ~self._output | on

    def look(self) -> None:
        """Take what the drive says of it: its contact, or without one what was ordered."""
        drive = self._drive
        if drive is None:
            return
        seen = drive.value(INPUTS) & self._input if self._input else drive.digital_outputs & self._output
        on = 1 if seen else 0
        if on != self.values[0]:
            self.values = [on, 0]


def read_outputs(link: CanLink, config: DriveConfig) -> int:
    """Read the digital outputs of a drive as they are (blocking).

    Raises:
        DriveSetupError: it does not say.

    """
    node = SdoNode(link, config.node_id, config.sdo_reply_timeout_s, config.sdo_tries)
    try:
        return node.read(0x60FE, 1, "u32")
    except SdoFailure as failure:
        where = f"node {config.node_id} 60FE:01"
        problem = Problem("outputs cannot be read", where, failure.cause, "their state", failure.next_action)
        raise DriveSetupError(problem) from failure
