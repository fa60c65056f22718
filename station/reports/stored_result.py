"""The result of a stored run as it may be shown: of a record that is not as it was left, nothing keeps its verdict."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace

from rich.console import Console
from rich.errors import ConsoleError

from station.documents.manifest import Manifest
from station.documents.result import Result
from station.errors import RecordError
from station.records.run_record import INTERRUPTED, NOT_CONCLUDED, RECORDING, RESULT, RunRecord
from station.records.run_ring import records_waiting
from station.records.samples.samples import check_samples
from station.records.seal import alterations, is_sealed
from station.records.to_paste import to_its_result, to_paste
from station.reports.result_view import show_result

SHAPELESS = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, ConsoleError)
"""What an altered result raises that cannot be shown; of one that nobody altered these are errors of the program."""


def stored_result(run: RunRecord) -> Result:
    """Return a run's result; for a run that was not concluded, what is known; for a doubtful record, no verdict.

    Of a record that does not read back, or is not as it was when the run was concluded, no row keeps its verdict.
    """
    return result_and_doubts(run)[0]


def result_and_doubts(run: RunRecord) -> tuple[Result, tuple[str, ...]]:
    """Return a run's result as `stored_result`, and what speaks against its record; nothing where it is as it was left.

    Raises:
        RecordError: run.json cannot be read.

    """
    manifest, state = run.manifest(), run.state()
    if not is_sealed(manifest):
        return _without_result(run, manifest, state), ()
    altered, damaged = alterations(run), check_samples(run, manifest.records).problems
    try:
        # The record is where it is now: a data folder may have been copied or moved.
        result = replace(run.read(Result, RESULT), record=str(run.folder), records=run.records())
    except RecordError:
        result = _without_result(run, manifest, state)
    doubts = (*(f"record altered: {one}" for one in altered), *(f"the record is damaged: {one}" for one in damaged))
    if not doubts:
        return result, ()
    if not altered:
        return without_verdicts(result, doubts), doubts
    try:
        shown = without_verdicts(replace(result, altered=altered), doubts)
        show_result(Console(file=io.StringIO(), markup=False, emoji=False), shown)
    except SHAPELESS:
        shown = without_verdicts(replace(_without_result(run, manifest, state), altered=altered), doubts)
    return shown, doubts


def refuse_doubtful(run: RunRecord) -> None:
    """Refuse a run that has no verdict: it is not concluded, or its record is not as it was left.

    Raises:
        RecordError: it has none.

    """
    manifest = run.manifest()
    if not is_sealed(manifest):
        raise RecordError(f"run {run.id} is not concluded yet, so there is no result. Run '{to_its_result(run)}'")
    doubts = [*alterations(run), *check_samples(run, manifest.records).problems]
    if doubts:
        raise RecordError(
            f"run {run.id}: the record was altered, so its verdict does not count: {doubts[0]}. Restore the "
            "run from a backup"
        )


def without_verdicts(result: Result, reasons: Sequence[str]) -> Result:
    """Return a result that decides nothing, in no row either, and says why; its other reasons follow."""
    metrics = tuple(
        replace(
            metric,
            verdict=None,
            sides={side: replace(found, verdict=None) for side, found in metric.sides.items()},
        )
        for metric in result.metrics
    )
    return replace(result, verdict="NOT DECIDABLE", reasons=(*reasons, *result.reasons), metrics=metrics)


def _without_result(run: RunRecord, manifest: Manifest, state: str) -> Result:
    pid = run.scanning()
    on_disk, waiting = run.records(), records_waiting(run)
    rest = f", {waiting} more in memory" if waiting else ""
    reasons = {
        RECORDING: f"still running (pid {pid})" if pid else "the run is still going on",
        INTERRUPTED: "the run was interrupted before it was evaluated; its samples are kept. "
        f"'{to_paste('conclude', run.id, data=run.folder.parent)}' tries again",
        NOT_CONCLUDED: f"still running (pid {pid}) without its supervisor process. Take it over: '{to_its_result(run)}'"
        if pid
        else f"not concluded: the supervisor process ended before the evaluation; {on_disk} scans on disk{rest}. "
        f"Run '{to_its_result(run)}'",
    }
    why = [reasons.get(state, f"the run ended as {state} without a result"), manifest.trouble]
    return Result(
        run=run.id,
        serial=manifest.serial,
        recipe=manifest.recipe.head,
        scenario=manifest.scenario,
        operator=manifest.operator,
        state=state,
        verdict="NOT DECIDABLE",
        reasons=tuple(text for text in why if text),
        metrics=(),
        record=str(run.folder),
        records=on_disk,
        waiting=waiting or None,
    )
