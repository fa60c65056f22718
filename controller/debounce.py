"""For how long a condition must hold before it counts: scans, or a time that becomes scans at the recipe's period.

The fault table gives scans where readings are meant: two of them may be spoiled, whatever time lies between. Where a
time is meant (a shaft that swings, a drive that follows, samples that grow too old) a number of scans would be another
time in every recipe: it stands here, and in the fault table as 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from controller.faults import Fault
from controller.program import Program

LEAST_SCANS = 2
"""A time shorter than this many scans: one spoiled reading may never stop a run."""


class Time(NamedTuple):
    """A debounce time: how many scans it is in a program, and what it is called in the documentation."""

    scans: Callable[[Program], int]
    text: str


def _fixed(milliseconds: float) -> Time:
    def scans(program: Program) -> int:
        # a hair less than the quotient: 20 ms are 20 scans of 1 ms, whatever the rounding of the division
        return max(LEAST_SCANS, math.ceil(milliseconds * 1e-3 / program.period_s - 1e-6))

    return Time(scans, f"{milliseconds:g} ms")


DEBOUNCE_TIMES: dict[str, Time] = {
    "drive_internal_limit": Time(lambda p: p.limits.internal_limit_scans, "`internal_limit` of the recipe"),
    "sample_frozen": Time(lambda p: p.limits.sample_stale_scans, "`sample_age` of the recipe's interlocks"),
    "sample_not_ready": Time(lambda p: p.limits.sample_late_scans, "half of `sample_age` of the recipe's interlocks"),
    "torque_channels_disagree": _fixed(20),
    "drive_not_following": _fixed(10),
    "angle_channels_disagree": _fixed(20),
}


def debounce_scans(fault: Fault, program: Program) -> int:
    """Return for how many scans in a row the condition of a fault may hold before it counts."""
    time = DEBOUNCE_TIMES.get(fault.id)
    return fault.debounce_scans + (time.scans(program) if time else 0)


def debounce_text(fault: Fault) -> str:
    """Return the debounce of a fault for the documentation."""
    if fault.id in DEBOUNCE_TIMES:
        return DEBOUNCE_TIMES[fault.id].text
    return f"{fault.debounce_scans} scans" if fault.debounce_scans else "none"
