"""Step `tune`: whether the gain of the torque loop is right for this bench, with a margin of two.

A small run steps the torque up and down on the locked unit. A loop whose gain is too high lets its set-point go back
within a ramp: stick and slip, or a resonance. The largest such set-back, of the largest drive torque, tells. A gain is
right when the run is quiet with it and with twice of it; otherwise it is halved until a run is quiet, and half of that
is proposed. The margin is so measured on the bench itself, with its friction, play and lags, and not computed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from definitions.image import State
from station.commissioning.trial_run import Plan, Tried
from station.documents.commissioning import Figure, Finding

PEAK = 0.10
"""Of rated torque: half of it stays within the friction of a unit, and moves nothing that could swing."""

PLAN = Plan("tune", proof=0.05, peak=PEAK, rate_nm_s=120.0, dwell_s=0.2, count=3)
RAMPS = (State.RAMP_POS, State.RAMP_NEG)
SMOOTH_SCANS = 10
"""Scans that the set-point is averaged over: noise of the sensor is not what is looked for."""

QUIET = 0.002
"""Set-back of the set-point, of the largest drive torque, up to which a run is quiet."""

MARGIN = 2.0
MOST_HALVINGS = 5


class Step(NamedTuple):
    """A small run at a gain [1/s]: largest set-back of the set-point, of the largest drive torque; how it ended."""

    gain_per_s: float
    setback: float
    complete: bool
    why: str
    record: str

    @property
    def quiet(self) -> bool:
        """Whether the run came to its end, and the set-point never went back."""
        return self.complete and self.setback <= QUIET


class Tuned(NamedTuple):
    """Every run that was made, and the gain that is proposed [1/s]; None where no run was quiet."""

    steps: list[Step]
    proposed_per_s: float | None


def setback(tried: Tried) -> float:
    """Return the largest set-back of the drive's set-point within a ramp, of its largest magnitude."""
    orders = tried.table["orders"]
    state, segment = np.asarray(orders["state"]), np.asarray(orders["segment"])
    torque = np.asarray(orders["drive_target_torque_nm"], dtype=float)
    ramps = np.isin(state, [int(one) for one in RAMPS])
    largest = 0.0
    for number in np.unique(segment[ramps]):
        values = torque[ramps & (segment == number)]
        if values.size <= 2 * SMOOTH_SCANS:
            continue
        smooth = np.convolve(values, np.full(SMOOTH_SCANS, 1.0 / SMOOTH_SCANS), "valid")
        smooth = smooth * np.sign(smooth[-1] - smooth[0])
        largest = max(largest, float(np.max(np.maximum.accumulate(smooth) - smooth)))
    peak = float(np.max(np.abs(torque), initial=0.0))
    return largest / peak if peak else 0.0


def tune(gain_per_s: float, run: Callable[[Plan], Tried]) -> Tuned:
    """Try the gain of the bench and its margin, or look for one that is quiet; `run` makes a small run."""

    def at(gain: float) -> Step:
        tried = run(replace(PLAN, gain_per_s=gain))
        return Step(gain, setback(tried), tried.complete, tried.why, tried.record.id)

    steps = [at(gain_per_s)]
    if steps[0].quiet:
        steps.append(at(MARGIN * gain_per_s))
        return Tuned(steps, gain_per_s if steps[1].quiet else gain_per_s / MARGIN)
    while not steps[-1].quiet and steps[-1].complete and len(steps) <= MOST_HALVINGS:
        steps.append(at(steps[-1].gain_per_s / 2.0))
    return Tuned(steps, steps[-1].gain_per_s / MARGIN if steps[-1].quiet else None)


def judged(gain_per_s: float, tuned: Tuned) -> tuple[Finding, ...]:
    """Say whether the gain of the bench file is right, and which one is proposed."""
    failed = next((step for step in tuned.steps if not step.complete), None)
    if failed is not None:
        cure = "Correct this first; a wrong direction is found by: lostmotion bench direction."
        return (
            Finding(what=f"The test run with gain {failed.gain_per_s:g} 1/s ended early: {failed.why}.", cure=cure),
        )
    if tuned.proposed_per_s == gain_per_s:
        return ()
    loud = max((step for step in tuned.steps if not step.quiet), key=lambda step: step.setback)
    what = (
        f"Gain {gain_per_s:g} 1/s: at {loud.gain_per_s:g} 1/s the set-point goes back by {loud.setback:.1%} of its peak"
        f" within a ramp, at most {QUIET:.1%} allowed up to twice the gain."
    )
    if tuned.proposed_per_s is None:
        return (
            Finding(
                what=what, cure="Look for play and loose couplings: the torque swings at every gain that was tried."
            ),
        )
    cure = f"Write 'torque_control: {{gain: {tuned.proposed_per_s:.2g}}}' into the bench file."
    return (Finding(what=what, cure=cure),)


def figures(tuned: Tuned) -> tuple[Figure, ...]:
    """Return what was measured, for the protocol."""
    rows = [
        Figure(name=f"set-back at gain {step.gain_per_s:g} 1/s", value=round(100.0 * step.setback, 3), unit="%")
        for step in tuned.steps
    ]
    proposed: Sequence[Figure] = ()
    if tuned.proposed_per_s is not None:
        proposed = (Figure(name="gain proposed", value=float(f"{tuned.proposed_per_s:.2g}"), unit="1/s"),)
    return (*rows, *proposed, *(Figure(name="record", value=step.record) for step in tuned.steps))
