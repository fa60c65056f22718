"""`lostmotion faults exits`: every way in which a run can end, measured in virtual time."""

from __future__ import annotations

import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path

from faultlab.exits.judge import Measured
from faultlab.exits.page import page
from faultlab.exits.rows import EXITS
from faultlab.exits.run import measure_exit
from station.cli.out_file import refuse_early, writing
from station.errors import StationError


def exits(names: list[str], path: Path | None, workers: int, *, as_json: bool) -> int:
    """Measure the exits and say each; 0 when all keep their bounds, 1 when not.

    Raises:
        StationError: there is no such exit, a page of some of them was asked for, or it cannot be written.

    """
    known = [row.id for row in EXITS]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise StationError(f"{', '.join(unknown)}: unknown shutdown path; allowed are {', '.join(known)}")
    if names and path is not None:
        raise StationError("--page: the page shows all shutdown paths; leave the ids out")
    refuse_early(path, "--page")
    chosen = names or known
    found: dict[str, Measured | None] = {}
    with ProcessPoolExecutor(workers) as pool:
        for name, one in zip(chosen, pool.map(measure_exit, chosen), strict=True):
            found[name] = one
            if not as_json:
                sys.stdout.write(line(name, one) + "\n")
                sys.stdout.flush()
    if path is not None:
        with writing(path, "--page"):
            path.write_text(page(found), encoding="utf-8")
    if as_json:
        sys.stdout.write(json.dumps({name: one and asdict(one) for name, one in found.items()}) + "\n")
    bad = [name for name, one in found.items() if one is None or one.wrong]
    if not as_json:
        measured = sum(one is not None for one in found.values())
        missed = ", ".join(bad) or "none"
        sys.stdout.write(
            f"{measured} of {len(found)} shutdown paths measured; not measured, or outside their limits: {missed}\n"
        )
    return 1 if bad else 0


def line(name: str, one: Measured | None) -> str:
    """One exit as a line of text."""
    if one is None:
        return f"{name:26} NOT MEASURED: the fault did not occur"
    times = (f"{value:.3f} s" if value is not None else "never" for value in (one.down_s, one.low_s))
    opened = "" if one.opened_nm is None else f"  lock opened at {one.opened_nm:.1f} N·m"
    wrong = f"  WRONG: {'; '.join(one.wrong)}" if one.wrong else ""
    came = f"{one.begin_state}, {one.begin_nm:.0f} N·m, peak {one.peak_nm:.0f} N·m"
    down, low = times
    torque = f"torque falls after {down}, is low after {low}, in the end {one.rest_nm:.1f} N·m"
    return f"{name:26} {came}: {torque}; state {one.state}{opened}{wrong}"
