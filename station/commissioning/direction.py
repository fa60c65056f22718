"""Step `direction`: whether motor, torques and angles count the same way, and by about the right amount.

A small run on the locked unit: the lock is verified at 1 % of rated torque, and only then 5 % is brought onto the unit.
Where a sign is wrong, the run ends in an interlock or with an unverified lock, and its records tell which sign it was.
Each channel is compared with the one that drives it, by a straight line through all samples under torque:

    drive position on other torque      loaded angle on drive position      loaded torque on drive torque
    other torque on loaded torque       locked angle on output torque

The drive's position goes with the torque that arrives at the locked shaft: of its own torque, friction holds back most
of so little. Where that shaft has no sensor, it is compared with the drive's torque.

The slope's sign is the direction. Its amount must be near 1 for the angle; a torque also shows friction, so its amount
is judged coarsely. A channel that moves by less than its resolution or noise shows nothing, which is said.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from definitions.states import LOCKED
from recipes import Bench, Recipe
from station.commissioning.on_wires import Scale
from station.commissioning.trial_run import Plan, Tried
from station.documents.commissioning import Figure, Finding

PLAN = Plan("direction", proof=0.01, peak=0.05, rate_nm_s=60.0, dwell_s=0.2)

LEAST_MOVED = 10.0
"""Range of a channel, in its own resolution or noise, from which on its direction is judged."""

LEAST_FIT = 0.5
"""Correlation from which on a direction is judged."""

ANGLE_RATIO = (0.8, 1.25)
"""Angle of the loaded shaft over that of the drive: outside, scale or gear_ratio is wrong."""

TORQUE_RATIO = (0.33, 3.0)
"""Torque over what drives it, by the files: friction and inertia are inside of this, another unit is not."""

DRIVE_ANGLE = "drive_angle_rad"
"""Position of the drive: it goes with its torque but for play and friction, which a small torque may not overcome."""

Column = npt.NDArray[np.float64]
ScaleOf = Callable[[str], Scale | None]


class Seen(NamedTuple):
    """A channel against the one that drives it. `slope` is the measured one over the expected one, NaN for none.

    moved: range of the channel; least: what it has to be; sign: +1, -1, or 0 when nothing was shown.
    """

    channel: str
    against: str
    unit: str
    moved: float
    least: float
    slope: float
    sign: int


def look(tried: Tried) -> list[Seen]:
    """Return how each channel went with the one that drives it."""
    job, table = tried.job, tried.table
    state = np.asarray(table["orders"]["state"])
    mask = np.isin(state, [int(one) for one in LOCKED])
    sensors, at_input = job.bench.sensors, job.recipe.loading == "input"

    def image(name: str) -> Column:
        return np.asarray(table["image"][name], dtype=float)[mask]

    ordered = np.asarray(table["orders"]["drive_target_torque_nm"], dtype=float)[mask]
    loaded, locked = ("in", "out") if at_input else ("out", "in")
    drive_angle = image(DRIVE_ANGLE)
    other = getattr(sensors, f"torque_{locked}")
    arrived, where = (
        (ordered, "drive torque") if other is None else (image(f"torque_{locked}_nm"), f"torque_{locked}_nm")
    )
    seen = [_seen(DRIVE_ANGLE, where, "rad", drive_angle, arrived, 0.0, float("nan"))]
    angle = getattr(sensors, f"angle_{loaded}")
    if angle is not None:
        least = LEAST_MOVED * 2 * np.pi / 2**angle.resolution_bits
        seen.append(
            _seen(f"angle_{loaded}_rad", "drive angle", "rad", image(f"angle_{loaded}_rad"), drive_angle, least, 1.0)
        )
    torque = getattr(sensors, f"torque_{loaded}")
    driving, name, expected = ordered, "drive torque", 1.0
    if torque is not None:
        values = image(f"torque_{loaded}_nm")
        seen.append(_seen(f"torque_{loaded}_nm", name, "N·m", values, driving, _noise(torque), 1.0))
        driving, name = values, f"torque_{loaded}_nm"
    if other is not None:
        slope = job.recipe.unit_under_test.loading_torque_ratio.slope
        expected = slope if at_input else 1.0 / slope
        values = image(f"torque_{locked}_nm")
        seen.append(_seen(f"torque_{locked}_nm", name, "N·m", values, driving, _noise(other), expected))
    far = getattr(sensors, f"angle_{locked}")
    if far is not None:
        output = image("torque_out_nm") if sensors.torque_out is not None else ordered
        least = LEAST_MOVED * 2 * np.pi / 2**far.resolution_bits
        seen.append(
            _seen(
                f"angle_{locked}_rad", "output torque", "rad", image(f"angle_{locked}_rad"), output, least, float("nan")
            )
        )
    return seen


def _noise(sensor: Any) -> float:
    return float(LEAST_MOVED * sensor.noise_fraction * sensor.full_scale_nm)


def _seen(  # noqa: PLR0917 - a row
    channel: str, against: str, unit: str, values: Column, driving: Column, least: float, expected: float
) -> Seen:
    moved = float(np.ptp(values)) if values.size else 0.0
    if values.size < 2 or moved <= least or not np.ptp(driving):
        return Seen(channel, against, unit, moved, least, float("nan"), 0)
    x, y = driving - driving.mean(), values - values.mean()
    fit = float(x @ y / np.sqrt((x @ x) * (y @ y)))
    # of the two lines, the one through the middle of a hysteresis loop: its slope is the ratio of the spreads
    ratio = float(np.copysign(np.sqrt((y @ y) / (x @ x)), fit))
    slope = ratio if np.isnan(expected) else ratio / expected
    return Seen(channel, against, unit, moved, least, slope, int(np.sign(fit)) if abs(fit) >= LEAST_FIT else 0)


def judged(tried: Tried, seen: Sequence[Seen], scale_of: ScaleOf) -> tuple[Finding, ...]:
    """Say which signs and amounts are wrong, each with what has to be written where."""
    bench, recipe = tried.job.bench, tried.job.recipe
    findings = [*_signs(bench, recipe, seen, scale_of)]
    findings += _amounts(seen, scale_of)
    if not findings and not tried.complete:
        findings.append(Finding(what=f"The test run with small torque ended early: {tried.why}.", cure=_next(tried)))
    for one in seen:
        if one.sign == 0:
            least = f"{one.least:.3g} {one.unit}"
            what = f"{one.channel}: direction not shown, moved by {one.moved:.3g} {one.unit}, at least {least} needed."
            locked = one.against == "output torque"
            cure = "Check that this sensor is connected and coupled."
            if one.moved > one.least:
                moved = f"{one.moved:.3g} {one.unit}"
                what = f"{one.channel}: direction not shown, it moved by {moved}, but not with {one.against}."
            if one.channel == DRIVE_ANGLE:
                cure = "Play or friction of the unit can hide it. Repeat this step, now that the play is taken up."
            if locked:
                cure = "A locked shaft moves little. Turn it by hand, drive off, and look with 'bench probe'."
            findings.append(Finding(what=what, cure=cure, refuses=not locked and one.channel != DRIVE_ANGLE))
    return tuple(findings)


def _next(tried: Tried) -> str:
    alarms = tried.result.alarms or ()
    return f"{alarms[0].next_action}." if alarms else "Do this step again."


def _signs(bench: Bench, recipe: Recipe, seen: Sequence[Seen], scale_of: ScaleOf) -> Iterator[Finding]:
    signs = {one.channel: one.sign for one in seen}
    loaded, locked = ("in", "out") if recipe.loading == "input" else ("out", "in")
    angle, torque = signs.get(f"angle_{loaded}_rad", 0), signs.get(f"torque_{loaded}_nm", 0)
    # the torque at the locked shaft was compared with that of the loaded one, and the drive's position with it
    other = signs.get(f"torque_{locked}_nm", 0) * (torque or 1)
    position = signs[DRIVE_ANGLE] * (other or 1) if seen[0].against == f"torque_{locked}_nm" else signs[DRIVE_ANGLE]
    if position < 0:
        cure = "Set the drive's polarity 0x607E to 0 with the maker's tool, and check its encoder's direction."
        yield Finding(what="The drive's position falls while its torque is positive.", cure=cure)
        return
    shown = [sign for sign in (angle, torque, other) if sign]
    if len(shown) > 1 and all(sign < 0 for sign in shown):
        toggled = "false" if bench.drive.reversed else "true"
        what = "Motor: all sensors count against it."
        yield Finding(what=what, cure=f"Write 'reversed: {toggled}' into the section drive of the bench file.")
        return
    rows = ((f"angle_{loaded}_rad", angle), (f"torque_{loaded}_nm", torque), (f"torque_{locked}_nm", other))
    for channel, sign in (*rows, (f"angle_{locked}_rad", signs.get(f"angle_{locked}_rad", 0) * (other or 1))):
        if sign < 0:
            scale = scale_of(channel)
            cure = "Turn the sign of its scale."
            if scale is not None:
                cure = f"Write 'scale: {-scale.value!r}' for {scale.place}; it is {scale.value!r} now."
            yield Finding(what=f"{channel} counts in the wrong direction.", cure=cure)


def _amounts(seen: Sequence[Seen], scale_of: ScaleOf) -> Iterator[Finding]:
    for one in seen:
        low, high = ANGLE_RATIO if one.unit == "rad" else TORQUE_RATIO
        if one.sign and one.against != "output torque" and one.channel != DRIVE_ANGLE:
            amount = abs(one.slope)
            if not low <= amount <= high:
                what = f"{one.channel}: {amount:.3g} of what {one.against} lets expect; {low:g} to {high:g} allowed."
                where = "gear_ratio of the bench file or " if one.unit == "rad" else "ratio of the recipe or "
                scale = scale_of(one.channel)
                place = one.channel if scale is None else scale.place
                yield Finding(what=what, cure=f"Correct {where}the scale of {place}.")


def figures(tried: Tried, seen: Sequence[Seen]) -> tuple[Figure, ...]:
    """Return what was measured, for the protocol."""
    words = {1: "same way", -1: "opposite way", 0: "not shown"}
    rows = [Figure(name=f"{one.channel} against {one.against}", value=words[one.sign]) for one in seen]
    slopes = [
        Figure(name=f"{one.channel} over expected", value=round(one.slope, 4))
        for one in seen
        if one.sign and one.against != "output torque" and one.channel != DRIVE_ANGLE
    ]
    return (*rows, *slopes, Figure(name="record", value=tried.record.id))
