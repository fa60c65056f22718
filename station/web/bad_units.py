"""Bad units: which one is to be put away before another unit is measured, and whether the unit of a run may be bad.

What a record says counts only as it was sealed. One that is damaged, altered or gone may be that of a bad unit.
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import NamedTuple

from station.records.chain.lookup import ChainEnd
from station.records.data_folder import Store
from station.records.newest_runs import KnownRun, newest_runs
from station.records.run_record import RunRecord

LOOKED_AT = 20
"""Runs: of bad units before these, somebody was asked at each start since."""


class Bad(NamedTuple):
    """A run whose unit may be bad, and what the operator is told of it."""

    run: str
    text: str


def bad_unit_of(data: Path, confirmed: frozenset[str]) -> Bad | None:
    """Return the newest run whose unit may be bad and that nobody has put away; None where there is none.

    confirmed: runs whose unit is in the box. What is older than the newest of these was settled before it.

    Raises:
        StationError: the chain of the folder cannot be read.

    """
    for run in islice(newest_runs(data), LOOKED_AT):
        if run.id in confirmed:
            return None
        if why := _why_bad(run):
            return Bad(run.id, f"{why} Put it into the NOK box and confirm that.")
    return None


def unconfirmed(data: Path, confirmed: frozenset[str]) -> str:
    """Return the run of `bad_unit_of`, '' where there is none; StationError as there."""
    bad = bad_unit_of(data, confirmed)
    return "" if bad is None else bad.run


def may_be_bad(data: Path, run: str) -> bool:
    """Say whether the unit of a run may be bad; of one that was never begun it is not. StationError as above."""
    end = ChainEnd(data)
    known = KnownRun(RunRecord(data / run), end.created(run), end.sealed(run), end.id)
    is_run = known.created is not None or known.sealed is not None or Store(data).by_id(run) is not None
    return is_run and _why_bad(known) != ""


def _why_bad(run: KnownRun) -> str:
    """Return why the unit of a run may be bad, '' where it is not. A bad master part should fail.

    A unit of a study is measured again: it is the study's, and no unit of the production that goes into a box.
    """
    manifest = run.sound()
    if manifest is not None:
        bad = manifest.verdict == "FAIL" and manifest.unit.master != "FAIL" and manifest.study is None
        return f"Unit {run.serial} is bad." if bad else ""
    if not run.here and run.sealed is not None:
        return f"Unit {run.serial} is bad." if run.sealed.fields["verdict"] == "FAIL" else ""
    unit = f"its unit {run.serial}" if run.serial else "its unit"
    if run.can_be_read():
        return f"The record of run {run.id} is not as it was sealed, so {unit} may be bad."
    return f"The record of run {run.id} cannot be read, so {unit} may be bad."
