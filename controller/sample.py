"""The newest torque sample: its torques less their zeroes, and whether it is new enough to decide anything.

Only here is a zero subtracted from a torque as it was measured: for the controller, and for whoever shows a scan while
the run goes on. What a record holds is read by `station.records.samples.zeroes`.
"""

from __future__ import annotations

from typing import Protocol

from definitions.image import Image, Orders
from definitions.program import Limits, Program


class Zeroes(Protocol):
    """What holds the zeroes of the torque sensors [N·m]: the controller's context, and the orders of every scan."""

    @property
    def torque_in_tare_nm(self) -> float:
        """Zero of the input torque."""

    @property
    def torque_out_tare_nm(self) -> float:
        """Zero of the output torque."""


def tared_nm(image: Image, zeroes: Zeroes) -> tuple[float, float]:
    """Return input and output torque of a scan [N·m], less their zeroes; of any age."""
    return image.torque_in_nm - zeroes.torque_in_tare_nm, image.torque_out_nm - zeroes.torque_out_tare_nm


def is_fresh(image: Image, limits: Limits) -> bool:
    """Tell whether the sample of a scan is one of now: on an older one nobody lets go of a torque."""
    return image.sample_age_scans <= limits.sample_late_scans


def shown_torque_nm(image: Image, orders: Orders, program: Program) -> float | None:
    """Return the torque at the output as a person is shown it [N·m]; None where the newest sample is stale."""
    if image.sample_age_scans > program.limits.sample_stale_scans:
        return None
    return tared_nm(image, orders)[1] if program.has_torque_out else orders.controlled_torque_nm
