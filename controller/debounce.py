"""For how long a condition must hold before it counts: scans, or a time that becomes scans at the recipe's period.

The fault table gives scans where readings are meant: two of them may be spoiled, whatever time lies between. Where a
time is meant (a shaft that swings, a drive that follows, samples that grow too old) a number of scans would be another
time in every recipe: it stands here, and in the fault table as 0.

A time is counted up by each scan with the condition and down by each without: a sensor that is right now and then is
still wrong. Two kinds start anew with the first good scan: readings, and what one good scan disproves (`STARTS_ANEW`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from definitions.faults import Fault
from definitions.program import Program

LEAST_SCANS = 2
"""A time shorter than this many scans: one spoiled reading may never stop a run."""


class Time(NamedTuple):
    """A debounce time: how many scans it is in a program, and what it is called in the documentation."""

    scans: Callable[[Program], int]
    text: str


SAMPLES_BAD_MS = 20.0
"""Bad samples are borne no longer than this, however old the recipe lets good ones grow."""


def _scans_of(milliseconds: float, program: Program) -> int:
    # a hair less than the quotient: 20 ms are 20 scans of 1 ms, whatever the rounding of the division
    return max(LEAST_SCANS, math.ceil(milliseconds * 1e-3 / program.period_s - 1e-6))


def _fixed(milliseconds: float) -> Time:
    return Time(lambda p: _scans_of(milliseconds, p), f"{milliseconds:g} ms")


def _bad_samples(scans: Callable[[Program], int], text: str) -> Time:
    def at_most(program: Program) -> int:
        return max(LEAST_SCANS, min(scans(program), _scans_of(SAMPLES_BAD_MS, program)))

    return Time(at_most, f"{text}, at most {SAMPLES_BAD_MS:g} ms")


DEBOUNCE_TIMES: dict[str, Time] = {
    "drive_internal_limit": Time(lambda p: p.limits.internal_limit_scans, "`internal_limit` of the recipe"),
    "sample_frozen": _bad_samples(lambda p: p.limits.sample_stale_scans, "`sample_age`"),
    "sample_not_ready": _bad_samples(lambda p: p.limits.sample_late_scans, "half of `sample_age`"),
    "torque_channels_disagree": _fixed(20),
    "drive_not_following": _fixed(10),
    "angle_channels_disagree": _fixed(20),
}

STARTS_ANEW = frozenset({"sample_frozen"})
"""Of the times: one new sample says that the counter does not stand, however rarely an amplifier has one."""


def leaks(fault: Fault) -> bool:
    """Whether a scan without the condition takes one from its count, instead of all."""
    return fault.id in DEBOUNCE_TIMES and fault.id not in STARTS_ANEW


def debounce_scans(fault: Fault, program: Program) -> int:
    """Return for how many scans the condition of a fault may hold before it counts."""
    time = DEBOUNCE_TIMES.get(fault.id)
    return fault.debounce_scans + (time.scans(program) if time else 0)


def debounce_text(fault: Fault) -> str:
    """Return the debounce of a fault for the documentation."""
    if fault.id in DEBOUNCE_TIMES:
        return DEBOUNCE_TIMES[fault.id].text
    return f"{fault.debounce_scans} scans" if fault.debounce_scans else "none"
