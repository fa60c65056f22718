"""`lostmotion calibration`: the torque ratio that runs measured, as an entry of `calibrations` in a bench file.

One run gives the lines of its unit. Runs of three units or more give their mean, and how the units differ: that is how
wrong the lines may be for a unit that was not calibrated.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

from analysis import Verdict
from analysis.quadrants import QUADRANTS
from recipes.calibration_schema import LEAST_UNITS
from recipes.section import LONGEST_NAME
from station.commands.blocks import DIGITS, day_of, due_day, flow, print_block, rounded, scalar
from station.commands.stored_metric import objection
from station.errors import StationError
from station.record.run_record import RESULT, RunRecord
from station.record.seal import alterations
from station.record.store import Store

CALIBRATION = "calibration.json"
ONE_UNIT = "# of one unit: name a run of each of several units, and it says how far another unit may be from it"

Stored = dict[str, Any]


def calibration(runs: Sequence[str], data: Path, *, due: str | None, as_json: bool) -> int:
    """Print the torque ratio that runs measured as an entry of `calibrations` in a bench file; return 0.

    Raises:
        StationError: a run has measured none, was altered or is invalid, a unit stands twice, benches or models
            differ.

    """
    records = [Store(data).find(run) for run in runs]
    found = [_stored(record) for record in records]
    serials = [str(record.manifest()["serial"]) for record in records]
    _check_alike(found, serials, records)
    made = max(day_of(str(one["made"])) for one in found)
    several = len(found) > 1
    block: Stored = {
        "id": _id(records),
        "model": found[0]["model"],
        "made": made.isoformat(),
        "due": due_day(due, made).isoformat(),
    }
    lengths = [float(one["transition_rad"]) for one in found if one.get("transition_rad") is not None]
    if len(lengths) == len(found):
        block["transition"] = _length(sum(lengths) / len(lengths))
    for quadrant in QUADRANTS:
        block[quadrant] = _mean_line([one["quadrants"][quadrant] for one in found])
    if several:
        _check_of_several(found, records)
        block["units"] = [_unit(serial, one) for serial, one in zip(serials, found, strict=True)]
    print_block({"calibrations": [block]}, _calibration_yaml, as_json=as_json)
    return 0


def _id(records: Sequence[RunRecord]) -> str:
    """Return a name for a bench file: of the run, or of the moment of the last one where its serial is too long."""
    ending = f"-ratio-{len(records)}-units" if len(records) > 1 else "-ratio"
    last = max(record.id for record in records)
    return (last if len(last + ending) <= LONGEST_NAME else last.partition("-")[0]) + ending


def _stored(record: RunRecord) -> Stored:
    altered = alterations(record, samples=False)
    if altered:
        raise StationError(f"{record.id}: record altered: {altered[0]}; nothing is taken from it")
    if not (record.folder / CALIBRATION).is_file():
        raise StationError(
            f"{record.id}: the run measured no torque ratio; needed is a complete run of a recipe with a step calibrate"
        )
    _refuse_invalid(record)
    stored: Stored = record.read_json(CALIBRATION)
    return stored


def _refuse_invalid(record: RunRecord) -> None:
    """Refuse lines that nobody may rely on; of a unit that missed its limits they are right, and another's not."""
    result = record.read_json(RESULT)
    if result.get("scenario"):
        raise StationError(f"{record.id}: faults were injected ({result['scenario']}); nothing is taken from it")
    if said := objection(result):
        raise StationError(f"{record.id}: {said}; nothing is taken from it. Measure again")
    if result["verdict"] != Verdict.PASS:
        sys.stderr.write(
            f"WARNING  {record.id}: its unit is {result['verdict']}, and its friction counts as that of a good one\n"
        )


def _check_alike(found: Sequence[Stored], serials: Sequence[str], records: Sequence[RunRecord]) -> None:
    """Refuse runs whose lines have no mean: of other benches or models, or of one unit twice."""
    for one, record in zip(found, records, strict=True):
        for what, own, first in (
            ("bench", one["bench"]["name"], found[0]["bench"]["name"]),
            ("model", one["model"], found[0]["model"]),
        ):
            if own != first:
                raise StationError(
                    f"{record.id}: found {what} {own}; {records[0].id} is of {what} {first}, and a torque ratio is of "
                    f"one {what}"
                )
    twice = next((serial for serial in serials if serials.count(serial) > 1), None)
    if twice is not None:
        named = ", ".join(record.id for record, serial in zip(records, serials, strict=True) if serial == twice)
        raise StationError(
            f"unit {twice} stands {serials.count(twice)} times: {named}; needed is one run of each unit, for the "
            "spread is meant between units"
        )


def _check_of_several(found: Sequence[Stored], records: Sequence[RunRecord]) -> None:
    """Refuse too few units, and one unit under several serial numbers: neither shows how units differ."""
    if len(found) < LEAST_UNITS:
        raise StationError(
            f"found runs of {len(found)} units; needed are {LEAST_UNITS} or more, for their spread is taken for that "
            "of all units, or one, whose lines then are its own"
        )
    for (one, first), (other, second) in combinations(zip(found, records, strict=True), 2):
        if one["quadrants"] == other["quadrants"]:
            raise StationError(
                f"{second.id}: found the lines of {first.id}, to the last digit; needed is a run of another unit "
                "(on the virtual bench --unit P1:1, P1:2, ...)"
            )


def _mean_line(lines: Sequence[Stored]) -> Stored:
    """Return the mean of lines, with the covariance of a mean."""
    count = len(lines)
    mean = {name: sum(line[name] for line in lines) / count for name in ("slope", "offset_nm")}
    u_slope, u_offset = (math.hypot(*(line[name] for line in lines)) / count for name in ("u_slope", "u_offset_nm"))
    together = sum(line["correlation"] * line["u_slope"] * line["u_offset_nm"] for line in lines) / count**2
    residual = math.hypot(*(line["residual_sd_nm"] for line in lines)) / math.sqrt(count)
    return {
        "slope": rounded(mean["slope"]),
        "offset": _torque(mean["offset_nm"]),
        "u_slope": rounded(u_slope),
        "u_offset": _torque(u_offset),
        "correlation": rounded(together / (u_slope * u_offset) if u_slope * u_offset else 0.0),
        "residual_sd": _torque(residual),
    }


def _unit(serial: str, stored: Stored) -> Stored:
    unit: Stored = {"serial": serial}
    if stored.get("transition_rad") is not None:
        unit["transition"] = _length(stored["transition_rad"])
    for quadrant in QUADRANTS:
        line = stored["quadrants"][quadrant]
        unit[quadrant] = {"slope": rounded(line["slope"]), "offset": _torque(line["offset_nm"])}
    return unit


def _torque(torque_nm: float) -> str:
    return f"{torque_nm:.{DIGITS}g} N·m"


def _length(angle_rad: float) -> str:
    return f"{angle_rad:.{DIGITS}g} rad"


def _calibration_yaml(block: Stored) -> str:
    (entry,) = block["calibrations"]
    lines = [line for key, value in entry.items() for line in _option(key, value)]
    text = "\n".join(["calibrations:", f"  - {lines[0]}", *(f"    {line}" for line in lines[1:])])
    return text + ("\n" if "units" in entry else f"\n    {ONE_UNIT}\n")


def _option(key: str, value: Any) -> list[str]:
    """Return the lines of one option: a list has an entry per unit, everything else is one line."""
    if not isinstance(value, list):
        return [f"{key}: {flow(value) if isinstance(value, dict) else scalar(value)}"]
    lines = [f"{key}:"]
    for unit in value:
        options = [line for name, own in unit.items() for line in _option(name, own)]
        lines += [f"  - {options[0]}", *(f"    {line}" for line in options[1:])]
    return lines
