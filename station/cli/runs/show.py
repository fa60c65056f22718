"""`lostmotion show`: what was measured in one run."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.box import HEAVY
from rich.console import Console
from rich.errors import ConsoleError
from rich.panel import Panel
from rich.text import Text

from station.documents.manifest import Manifest, attempt_text
from station.documents.reading import plain
from station.documents.result import Result
from station.errors import RecordError
from station.records.chain.chain_file import CHAIN
from station.records.data_folder import Store
from station.records.run_record import INTERRUPTED, NOT_CONCLUDED, RECORDING, RESULT, RunRecord
from station.records.run_ring import records_waiting
from station.records.samples.samples import check_samples
from station.records.seal import EXIT_ALTERED, alterations, is_sealed, vouched_for
from station.reports.result_view import result_console, show_result

SHAPELESS = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, ConsoleError)
"""What an altered result raises that cannot be shown; of one that nobody altered these are errors of the program."""


def show(name: str, data: Path, *, as_json: bool) -> int:
    """Print a stored run; its record is read back first, and a damaged or altered one says so; 3 when altered.

    Raises:
        StationError: there is no such run.

    """
    run = Store(data).find(name)
    found = stored_result(run)
    code = EXIT_ALTERED if found.altered else 0
    if as_json:
        sys.stdout.write(json.dumps(plain(found), ensure_ascii=False) + "\n")
        return code
    console = result_console()
    manifest = run.manifest()
    by = f" by {manifest.operator}" if manifest.operator else ""
    attempt = attempt_text(manifest.attempt, manifest.before, manifest.retest_reason)
    console.print(
        f"{run.id}  {attempt}, started {manifest.started}{by}, {run.records()} scans on disk",
        highlight=False,
        soft_wrap=True,
    )
    if is_sealed(manifest) and not vouched_for(run):
        console.print(f"no {CHAIN} beside this run: its run.json cannot be verified", style="yellow", highlight=False)
    show_result(console, found)
    if found.altered:
        console.print(altered_banner(found.altered))
    return code


def altered_banner(altered: Sequence[str]) -> Panel:
    """Return what nobody may overlook: this record is not what the run left."""
    text = Text(" RECORD ALTERED ", style="bold white on red", justify="center")
    for one in altered:
        text.append(f"\n{one}", style="bold red")
    return Panel(text, border_style="red", box=HEAVY, padding=(1, 2))


def stored_result(run: RunRecord) -> Result:
    """Return a run's result; for a run that was not concluded, what is known; for a doubtful record, no verdict.

    Of a record that does not read back, or is not as it was when the run was concluded, no row keeps its verdict.
    """
    manifest, state = run.manifest(), run.state()
    if not is_sealed(manifest):
        return _without_result(run, manifest, state)
    altered = alterations(run)
    try:
        # The record is where it is now: a data folder may have been copied or moved.
        result = replace(run.read(Result, RESULT), record=str(run.folder), records=run.records())
    except RecordError:
        result = _without_result(run, manifest, state)
    read_back = check_samples(run, manifest.records)
    doubts = [f"record altered: {one}" for one in altered]
    doubts += [f"the record is damaged: {problem}" for problem in read_back.problems]
    if not doubts:
        return result
    if not altered:
        return without_verdicts(result, doubts)
    try:
        shown = without_verdicts(replace(result, altered=altered), doubts)
        show_result(Console(file=io.StringIO()), shown)
    except SHAPELESS:
        shown = without_verdicts(replace(_without_result(run, manifest, state), altered=altered), doubts)
    return shown


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
        f"'lostmotion conclude {run.id}' tries again",
        NOT_CONCLUDED: f"still running (pid {pid}) without its supervisor process. "
        f"Take it over: 'lostmotion resume {run.id}'"
        if pid
        else f"not concluded: the supervisor process ended before the evaluation; {on_disk} scans on disk{rest}. "
        f"Run 'lostmotion conclude {run.id}'",
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
