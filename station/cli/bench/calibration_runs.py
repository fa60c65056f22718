"""The runs that a stored torque ratio is made of: what each has measured, and which of them say nothing of a unit.

A ratio speaks for units of one lot. It takes nothing from a run that nobody may rely on, whose unit failed, or that was
measured otherwise than the others; and their spread is that of units only where no unit is among them twice.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

from analysis.evaluation.verdict import Verdict
from analysis.torque_ratio.quadrants import QUADRANTS
from recipes.schema.calibration_schema import LEAST_UNITS
from station.bench.virtual_unit import NOT_NAMED
from station.cli.bench.usable_runs import usable
from station.documents.ratio import RatioLine, RatioRecord
from station.documents.result import Result
from station.errors import StationError
from station.records.run_record import CALIBRATION, RESULT, RunRecord
from station.reports.headline import objection
from station.reports.result_text import COVERAGE, coverage_factor

ONE_UNIT_WITHIN = 5.0
"""Standard uncertainties of their difference within which two lines are those of one unit.

Three runs of one unit were 1.6 to 3.4 apart in the coefficient that differs most; two units of the virtual lot 160.
"""

OTHER_UNIT = "Name runs of different units (on the virtual bench: --unit P1:1, P1:2, ...)"


class MeasuredRatio(NamedTuple):
    """Torque ratio that a run measured (`calibration.json`), with what it was measured by and on."""

    run: str
    serial: str
    recipe: str
    virtual: str | None
    """The unit of a virtual bench."""
    stored: RatioRecord

    @property
    def quadrants(self) -> Mapping[str, RatioLine]:
        """Line of each quadrant."""
        return self.stored.quadrants


def measured_ratio(record: RunRecord) -> MeasuredRatio:
    """Return the torque ratio that a run measured.

    Raises:
        StationError: it has measured none, is not `usable` or is invalid, a ramp was interrupted, or its unit failed.

    """
    manifest = usable(record)
    if not (record.folder / CALIBRATION).is_file():
        raise StationError(
            f"run {record.id} measured no torque ratio. Name a complete run of a recipe with a step 'calibrate'"
        )
    _refuse_unreliable(record)
    recipe = f"{manifest.recipe.name} revision {manifest.recipe.revision}"
    measured = record.read(RatioRecord, CALIBRATION)
    return MeasuredRatio(record.id, manifest.serial, recipe, manifest.unit.virtual, measured)


def check_together(found: Sequence[MeasuredRatio]) -> None:
    """Refuse runs whose lines have no mean, or whose spread is not that of units.

    Raises:
        StationError: recipes, benches or models differ; there are too few units, or one of them stands twice.

    """
    _check_alike(found)
    _check_serials(found)
    if len(found) == 1:
        return
    if len(found) < LEAST_UNITS:
        raise StationError(
            f"found runs of {len(found)} units; expected {LEAST_UNITS} or more units, to know the spread between them. "
            "Name more runs, or only one: the torque ratio is then valid for that unit only"
        )
    for first, second in combinations(found, 2):
        _refuse_one_unit(first, second)


def _refuse_unreliable(record: RunRecord) -> None:
    """Refuse lines that nobody may rely on, or that may be those of a defect; warn of a unit that did not pass."""
    result = record.read(Result, RESULT)
    if said := objection(result):
        raise StationError(f"run {record.id} was not used: {said}. Measure the unit again")
    if coverage_factor(result.metrics) > COVERAGE:  # its lines would be in every later run, whose U has the usual k
        raise StationError(
            f"run {record.id} was not used: a ramp was interrupted, so its lines are less sure than they say. Measure "
            "the unit again"
        )
    if result.verdict == Verdict.FAIL:
        why = next(iter(result.reasons), "its verdict is FAIL")
        raise StationError(
            f"run {record.id} was not used: its unit failed ({why}), and the defect may change the friction. Name a "
            "run of a unit that passed"
        )
    if result.verdict != Verdict.PASS:
        sys.stderr.write(
            f"WARNING  {record.id}: its unit is {result.verdict}, and its friction counts as that of a good one\n"
        )


def _check_alike(found: Sequence[MeasuredRatio]) -> None:
    first = found[0]
    for one in found:
        for what, own, others in (
            ("bench", one.stored.bench.name, first.stored.bench.name),
            ("model", one.stored.model, first.stored.model),
            ("recipe", one.recipe, first.recipe),
        ):
            if own != others:
                raise StationError(
                    f"runs {first.run} and {one.run} cannot be combined: they differ in {what} ({others}, {own}). Name "
                    "runs of one bench, one model, and one recipe and revision"
                )


def _check_serials(found: Sequence[MeasuredRatio]) -> None:
    serials = [one.serial for one in found]
    twice = next((serial for serial in serials if serials.count(serial) > 1), None)
    if twice is not None:
        named = ", ".join(one.run for one in found if one.serial == twice)
        raise StationError(
            f"unit {twice} was measured in {serials.count(twice)} of the runs: {named}; expected one run of each unit, "
            "because the spread between units is calculated. Leave out the others"
        )


def _refuse_one_unit(first: MeasuredRatio, second: MeasuredRatio) -> None:
    """Refuse one unit under two serial numbers: its lines differ by noise, and as units they would have no spread."""
    if first.virtual not in (None, NOT_NAMED) and first.virtual == second.virtual:
        raise StationError(
            f"runs {first.run} and {second.run} measured the same virtual unit, {second.virtual}. {OTHER_UNIT}"
        )
    if first.quadrants == second.quadrants:
        raise StationError(
            f"runs {first.run} and {second.run} have the same torque ratio to the last digit, so both measured the "
            f"same unit. {OTHER_UNIT}"
        )
    if apart(first, second) <= ONE_UNIT_WITHIN:
        raise StationError(
            f"runs {first.run} and {second.run} seem to have measured the same unit: in every quadrant their torque "
            f"ratios agree within {ONE_UNIT_WITHIN:g} standard uncertainties. {OTHER_UNIT}"
        )


def apart(first: MeasuredRatio, second: MeasuredRatio) -> float:
    """Return the largest difference of any offset or slope, in standard uncertainties of that difference."""
    return max(
        _in_uncertainties(own - others, math.hypot(u_own, u_others))
        for line, other in ((first.quadrants[quadrant], second.quadrants[quadrant]) for quadrant in QUADRANTS)
        for own, others, u_own, u_others in (
            (line.offset_nm, other.offset_nm, line.u_offset_nm, other.u_offset_nm),
            (line.slope, other.slope, line.u_slope, other.u_slope),
        )
    )


def _in_uncertainties(difference: float, u: float) -> float:
    if u > 0.0:
        return abs(difference) / u
    return math.inf if difference else 0.0
