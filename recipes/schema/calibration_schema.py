"""Sections of a bench file that were measured on it: fixture and torque ratios, each with the day it is due again."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import date
from itertools import combinations, pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from definitions.units import ARCMINUTES, RAD_PER_ARCSEC, STIFFNESS, TORQUE
from recipes.text.quantity import show
from recipes.text.section import (
    AngleNoise,
    Deflection,
    Drift,
    FixtureError,
    Fraction,
    Name,
    Section,
    SignedTorque,
    Stiffness,
    StiffnessAtInput,
    Text,
    TorqueSpread,
    Travel,
    refusal,
)

ALIKE = 2.0
"""How far stiffness and curve of one fixture may differ."""

QUADRANTS = ("load_positive", "unload_positive", "load_negative", "unload_negative")
"""Lines of a torque ratio."""

NEAR, NEAR_OFFSET_NM = 1e-3, 0.02
"""How far slopes and transition, as a fraction, and offsets may be from the mean of units: what rounding makes."""


LEAST_UNITS = 3
"""Units whose spread is taken for that of a lot.

Two show it in one direction alone: where both read a metric alike its U is next to nothing. Of six other virtual units
9 and 19 % of all values were outside U by two pairs, by as much as seven times U, and none by three units.
"""


class FixturePoint(Section):
    """One point of a fixture's curve: its deflection at a torque at the output."""

    torque_nm: SignedTorque
    deflection_arcmin: Deflection


class FixtureCurve(Section):
    """Deflection of the fixture over torque, as a blank test on a rigid dummy gave it (`lostmotion blank`)."""

    id: Name
    made: date
    due: date
    angles: Literal["both", "loaded"]
    """Angles that the blank test was evaluated from. Only a wind-up from the same angles is corrected."""
    points: Annotated[tuple[FixturePoint, ...], Field(min_length=2, max_length=1000)]

    @model_validator(mode="after")
    def _in_order(self) -> FixtureCurve:
        _due_after_made(self.made, self.due)
        for before, after in pairwise(self.points):
            if after.torque_nm <= before.torque_nm or after.deflection_arcmin < before.deflection_arcmin:
                found = f"{show(after.deflection_arcmin, ARCMINUTES)} at {show(after.torque_nm, TORQUE)}"
                allowed = (
                    f"torques that rise and deflections that do not fall, after "
                    f"{show(before.deflection_arcmin, ARCMINUTES)} at {show(before.torque_nm, TORQUE)}"
                )
                raise refusal(found, allowed, "Measure the curve again with 'lostmotion blank'.", at="points")
        return self


class FixtureParts(Section):
    """Stiffnesses on both sides of the unit, each as it is at its own shaft.

    output: K_1, of shaft and connections at the output. input: K_i, of shaft, coupling and, where the input is locked,
    lock at the input. At the output the fixture has 1/K = 1/K_1 + 1/(K_i·i²), with the ratio i of the unit in the
    recipe.
    """

    output_nm_per_arcmin: Stiffness
    input_nm_per_arcmin: StiffnessAtInput


class Fixture(Section):
    """Clamping of the unit; its wind-up is taken out of the measured one.

    name: what the fixture is called where a bench has several; kept in each run, which can be grouped by it.
    stiffness: of all of it, at the output, alone or with the curve of a blank test; or instead of both its parts.
    accuracy: limit of the error of its stiffness. drift: limit of the wind-up's creep with the torque, alike in every
    cycle; steady drift is measured. lock_width, lock_windup: limits of what another locking of the shaft changes in the
    width of the loop and in the wind-up; declare what a lock angle study found when results shall speak of the whole
    unit, not of one position.
    """

    name: Name | None = None
    stiffness_nm_per_arcmin: Stiffness | None = None
    parts: FixtureParts | None = None
    curve: FixtureCurve | None = None
    accuracy_fraction: FixtureError = 0.05
    drift_arcmin_min: Drift = 0.005
    lock_width_rad: AngleNoise = 0.12 * RAD_PER_ARCSEC
    lock_windup_fraction: Fraction = 0.0005

    @property
    def output_side_nm_per_arcmin(self) -> float:
        """Stiffness at the output, without what stands at the input where that is known by itself."""
        stated = self.stiffness_nm_per_arcmin if self.parts is None else self.parts.output_nm_per_arcmin
        return math.inf if stated is None else stated  # one of the two is there

    @model_validator(mode="after")
    def _stated_once(self) -> Fixture:
        """How far a fixture gives way is said in one way; two would be two fixtures."""
        allowed = "stiffness, with or without a curve; or parts with output and input, then without those two"
        beside = "stiffness" if self.stiffness_nm_per_arcmin is not None else "curve" if self.curve else ""
        if self.parts is not None and beside:
            hint = f"Delete the parts or {beside}: a blank test and a stiffness include all parts."
            raise refusal(f"both parts and {beside}", allowed, hint, at="parts")
        if self.parts is None and self.stiffness_nm_per_arcmin is None:
            hint = "Add 'stiffness: 10000 N·m/arcmin', as measured at the output."
            raise refusal("neither stiffness nor parts", allowed, hint)
        return self

    @model_validator(mode="after")
    def _one_fixture(self) -> Fixture:
        """The curve of a wind-up by the loaded shaft alone is that of the fixture whose stiffness stands beside it.

        Two encoders see less of the fixture: by them its curve may be as stiff as it likes, and is never softer.
        """
        stated = self.stiffness_nm_per_arcmin
        if stated is None or self.curve is None:
            return self
        first, last = self.curve.points[0], self.curve.points[-1]
        deflection = last.deflection_arcmin - first.deflection_arcmin
        by_curve = (last.torque_nm - first.torque_nm) / deflection if deflection else math.inf
        stiffest = stated * ALIKE if self.curve.angles == "loaded" else math.inf
        if not stated / ALIKE <= by_curve <= stiffest:
            shown = f"{by_curve:.4g} {STIFFNESS.shown}" if deflection else "no deflection at all"
            found = f"a curve of {shown} and a stiffness of {show(stated, STIFFNESS)}"
            softest = show(stated / ALIKE, STIFFNESS)
            allowed = f"{softest} or more" if math.isinf(stiffest) else f"{softest} to {show(stiffest, STIFFNESS)}"
            allowed = f"a curve of {allowed} from end to end"
            hint = "Curve and stiffness are of different fixtures: enter both from one 'lostmotion blank'."
            raise refusal(found, allowed, hint, at="curve")
        return self


class QuadrantLine(Section):
    """Line T_out = offset + slope · T_in of one quadrant, and what its fit said of it where that is known.

    Without standard uncertainties 0.5 % of the slope and 0.5 N·m are assumed.
    """

    slope: Annotated[float, Field(gt=0, le=10000)]
    offset_nm: SignedTorque
    u_slope: Annotated[float, Field(ge=0, le=10000)] | None = None
    u_offset_nm: TorqueSpread | None = None
    correlation: Annotated[float, Field(ge=-1, le=1)] | None = None
    residual_sd_nm: TorqueSpread | None = None


class UnitLine(Section):
    """Line T_out = offset + slope · T_in that one unit had in one quadrant."""

    slope: Annotated[float, Field(gt=0, le=10000)]
    offset_nm: SignedTorque


class CalibratedUnit(Section):
    """One of the units that stored lines are the mean of: its own lines and transition."""

    serial: Annotated[Text, Field(min_length=1)]
    transition_rad: Travel | None = None
    load_positive: UnitLine
    unload_positive: UnitLine
    load_negative: UnitLine
    unload_negative: UnitLine


class Calibration(Section):
    """Stored torque ratio of one model on this bench, by sign of the torque and loading or unloading."""

    id: Name
    model: Name
    made: date
    due: date
    transition_rad: Travel | None = None
    """Angle at the input over which friction changes sides after a reversal; left out, that stretch is masked."""
    load_positive: QuadrantLine
    unload_positive: QuadrantLine
    load_negative: QuadrantLine
    unload_negative: QuadrantLine
    units: Annotated[tuple[CalibratedUnit, ...], Field(min_length=LEAST_UNITS, max_length=100)] | None = None
    """Units whose mean the lines are. Their spread is the uncertainty for another unit."""

    @model_validator(mode="after")
    def _in_order(self) -> Calibration:
        _due_after_made(self.made, self.due)
        return self

    @model_validator(mode="after")
    def _mean_of_units(self) -> Calibration:
        """Lines that are not those of their units say nothing of how wrong they are."""
        units = self.units or ()
        again = "Make the entry again with 'lostmotion calibration', from one run of each unit."
        for place, what, stated, own in _stated(self, units) if units else ():
            known = [value for value in own if value is not None]
            if len(known) < len(own):
                without = next(unit.serial for unit, value in zip(units, own, strict=True) if value is None)
                raise refusal(f"unit {without} without a {what}", f"a {what} of each unit", again, at="units")
            mean = sum(known) / len(known)
            if abs(stated - mean) > (NEAR_OFFSET_NM if what == "offset" else NEAR * stated):
                found = f"{what} {stated:.6g} where the mean of the {len(units)} units is {mean:.6g}"
                raise refusal(found, "the mean of the units", again, at=place)
        for first, second in combinations(units, 2):
            if first.serial == second.serial:
                raise refusal(f"unit {first.serial} twice", "each unit once", "Leave one of them out.", at="units")
            if all(getattr(first, quadrant) == getattr(second, quadrant) for quadrant in QUADRANTS):
                found = f"the same lines for unit {first.serial} and unit {second.serial}, to the last digit"
                raise refusal(
                    found, "lines of several units", "The same unit is listed twice: delete one entry.", at="units"
                )
        return self


Stated = tuple[str, str, float, list[float | None]]
"""What an entry states as a mean: its place, what it is, its value, and that of each unit."""


def _stated(entry: Calibration, units: Sequence[CalibratedUnit]) -> Iterator[Stated]:
    for quadrant in QUADRANTS:
        lines = [getattr(unit, quadrant) for unit in units]
        line: QuadrantLine = getattr(entry, quadrant)
        yield quadrant, "slope", line.slope, [own.slope for own in lines]
        yield quadrant, "offset", line.offset_nm, [own.offset_nm for own in lines]
    if entry.transition_rad is not None:
        yield "transition", "transition", entry.transition_rad, [unit.transition_rad for unit in units]


def _due_after_made(made: date, due: date) -> None:
    if due <= made:
        raise refusal(str(due), f"a day after {made}, when it was made", "Correct one of the two dates.", at="due")
