"""Runs and their exports that a block of a bench file may be made of: what was measured on the bench, and is as it was.

Such a block is in every later result of the bench, where nobody sees any more what it was made of.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from analysis.validity import record_checks
from definitions.checks import CHECKS
from recipes import Bench
from station.documents.exported import ExportedRun
from station.documents.manifest import Manifest
from station.errors import StationError
from station.records.run_record import RunRecord, only_simulated
from station.records.seal import alterations
from station.reports.headline import INVALID

OF_A_UNIT = tuple(f"{INVALID}: {name}: " for name in CHECKS if name not in record_checks.FIGURES)
"""How the reason of a check begins that asks more than how the trace was recorded: a rigid dummy may fail it."""


def usable(record: RunRecord) -> Manifest:
    """Return the manifest of a run that was measured on its bench as it is.

    Raises:
        StationError: it was altered, its bench was only simulated, or faults were injected.

    """
    altered = alterations(record, samples=False)
    if altered:
        raise StationError(f"run {record.id} was not used: its record was altered ({altered[0]}). Choose another run")
    manifest = record.manifest()
    check_measured(f"run {record.id}", manifest)
    return manifest


def check_measured(what: str, run: Manifest | ExportedRun) -> None:
    """Refuse a run that says nothing of its bench; `what` is it or its export, as it is named."""
    if only_simulated(run):
        raise StationError(
            f"{what} was not used: bench {run.bench.name} was only simulated (--virtual-time), nothing was measured on "
            "it. Measure on the bench itself"
        )
    if run.scenario:
        raise StationError(f"{what} was not used: faults were injected on purpose ({run.scenario}). Choose another run")


def check_same_bench(what: str, run: Manifest | ExportedRun, bench: Bench) -> None:
    """Refuse the bench file of another bench than the run was measured on: the block would be of neither."""
    if bench.bench.name != run.bench.name:
        raise StationError(
            f"{what} was not used: it was measured on bench {run.bench.name}; --bench: found bench {bench.bench.name}. "
            f"Name the bench file of {run.bench.name}, or leave --bench out"
        )


def check_recorded(what: str, verdict: str | None, reasons: Sequence[str]) -> None:
    """Refuse a blank test that was recorded badly; warn of one that is not decidable for another reason.

    A rigid dummy is no reducer: checks that know how one behaves say nothing of it.
    """
    of_record = next((one for one in reasons if one.startswith(INVALID) and not one.startswith(OF_A_UNIT)), "")
    if of_record:
        raise StationError(f"{what} was not used: {of_record}. Measure the dummy again")
    if verdict == "NOT DECIDABLE":
        sys.stderr.write(
            f"WARNING  {what}: NOT DECIDABLE ({next(iter(reasons), 'no reason is known')}). A rigid dummy may fail the "
            "checks of a reducer; any other reason makes the curve wrong\n"
        )
