"""What a device of a bench may not be able to prove, and what is left then: of brake, amplifier, sensors and I/O.

One row per proof. A bench whose device lacks one says so in the verified list of a run and in its result; the page on
safety is made of these rows.
"""

from __future__ import annotations

from typing import NamedTuple


class DeviceProof(NamedTuple):
    """One proof: which devices lack it, what is not proven then, and what remains."""

    name: str
    lacking: str
    unproven: str
    remains: str


# fmt: off
DEVICE_PROOFS: tuple[DeviceProof, ...] = (
    DeviceProof("identity", "no identity register",
                "that the right device answers, at the start and after a disturbed RTU line",
                "Only its address says which device answers"),
    DeviceProof("life", "brake or remote I/O without life counter",
                "that values are new: a frozen device that still answers is not noticed by their age",
                "The controller compares the brake with its order"),
    DeviceProof("current", "brake without measured current",
                "that the brake has the current that it was ordered: a broken wire or a supply that limits is not"
                " noticed (brake_current_lost)",
                "The lock is proven by a torque before the run, and watched while it bears one (lock_slip)."
                " The record shows the ordered current while the supply says that it is on"),
    DeviceProof("set_point", "brake without current set-point",
                "that the lock holds what the recipe asks for: it holds what its supply is set to by hand",
                "'max_current' of the bench file is taken for it; set the supply to that, and prove it by a torque"),
    DeviceProof("switch", "brake that does not say that it is on",
                "that the output of the supply is on or off",
                "Its current is taken for it: above zero is on"),
    DeviceProof("contact", "brake at an output without contact",
                "that the brake is on: what was ordered is taken for it",
                "The lock is proven by a torque before the run, and watched while it bears one (lock_slip)"),
    DeviceProof("drive_output", "brake at an output of the drive",
                "that the lock stays closed when the drive fails, is switched off or loses its bus: its outputs may"
                " fall then, and the lock opens while the unit is wound up",
                "lock_slip is noticed while sensors and scan go on. Let the drive keep its outputs, or use a brake that"
                " closes without current"),
    DeviceProof("new_values", "channel that is alive by arrival",
                "that the values of a channel are new: a device that goes on sending an old one is not noticed by its"
                " age",
                "The controller compares torques and angles with each other (torque_channels_disagree,"
                " angle_channels_disagree)"),
    DeviceProof("can_identity", "sensor on CAN without identity",
                "that the frames of an identifier come from the sensor that the bench file names",
                "Their length is checked in every frame; a bus has one sender for an identifier"),
    DeviceProof("can_heartbeat", "sensor on CAN without heartbeat",
                "that the sensor did not restart: settings that it keeps may be lost without notice",
                "Its frames stop in most devices until they are started by NMT, and sample_stale acts"),
)
"""What a bench may lack, in the order of the page."""
# fmt: on

PROOF_BY_NAME = {row.name: row for row in DEVICE_PROOFS}


def unproven_text(where: str, name: str) -> str:
    """Return what a result says of a device or channel that lacks a proof."""
    row = PROOF_BY_NAME[name]
    return f"{where}: this device cannot prove {row.unproven}. What remains: {row.remains}."
