"""For how long a condition must hold before it counts: scans, or a time that becomes scans at the recipe's period.

The fault table gives scans where readings are meant: two of them may be spoiled, whatever time lies between. It gives a
time where a time is meant: a shaft that swings, a drive that follows, samples that grow too old.
"""

from __future__ import annotations

import math

from definitions.faults import Fault, Time
from definitions.program import Program

LEAST_SCANS = 2
"""A time shorter than this many scans: one spoiled reading may never stop a run."""


def leaks(fault: Fault) -> bool:
    """Whether a scan without the condition takes one from its count, instead of all."""
    return fault.time is not None and not fault.time.starts_anew


def debounce_scans(fault: Fault, program: Program) -> int:
    """Return for how many scans the condition of a fault may hold before it counts."""
    return fault.debounce_scans + (_time_scans(fault.time, program) if fault.time else 0)


def _time_scans(time: Time, program: Program) -> int:
    of_recipe: int | None = getattr(program.limits, time.limit) if time.limit else None
    if time.at_most_ms is None:
        return of_recipe or 0
    # a hair less than the quotient: 20 ms are 20 scans of 1 ms, whatever the rounding of the division
    at_most = math.ceil(time.at_most_ms * 1e-3 / program.period_s - 1e-6)
    return max(LEAST_SCANS, at_most if of_recipe is None else min(of_recipe, at_most))


def debounce_text(fault: Fault) -> str:
    """Return the debounce of a fault for the documentation."""
    if fault.time is None:
        return f"{fault.debounce_scans} scans" if fault.debounce_scans else "none"
    bounded = fault.time.limit and fault.time.at_most_ms is not None
    return f"{fault.time.text}, at most {fault.time.at_most_ms:g} ms" if bounded else fault.time.text
