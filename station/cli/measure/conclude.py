"""`lostmotion conclude`: brings runs whose supervisor died to their result, when a person asks for it."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from recipes import RecipeError
from station.documents.entries import plain
from station.errors import StationError
from station.records.chain.writing import settle_killed
from station.records.data_folder import Store
from station.records.run_record import RECORDING, RunRecord
from station.records.seal import EXIT_ALTERED, alterations, is_sealed
from station.records.to_paste import to_paste
from station.run.way_back.left_behind import collect
from station.run.way_back.recover import recover, to_be_concluded

CONCLUDED, STILL_RUNNING, OWNED, FAILED, WITHOUT_VERDICT = (
    "concluded",
    "still running",
    "owned by another process",
    "not concluded",
    "interrupted",
)
NOT_DONE = (STILL_RUNNING, OWNED, FAILED)


def conclude_runs(name: str | None, data: Path, *, all_runs: bool, as_json: bool) -> int:
    """Conclude one run, or with `all_runs` every one whose supervisor died; 0 when none is left to conclude, else 1.

    3 where none is left and a record of them was altered.

    Raises:
        StationError: there is no such run or data folder, or neither one nor all were asked for.

    """
    if (name is None) is not all_runs:
        raise StationError("conclude: name a run, or give --all for every run whose supervisor process ended; not both")
    if all_runs and not data.is_dir():
        raise StationError(f"--data {data}: there is no such folder; name the one that 'lostmotion run' wrote to")
    settle_killed(data)
    store = Store(data)
    chosen = store.runs() if name is None else [store.find(name)]
    rows = [row for run in chosen if (row := _concluded(run, named=name is not None)) is not None]
    collected = [str(path) for path in collect(store)]
    if as_json:
        sys.stdout.write(json.dumps({"runs": plain(rows), "rings_removed": collected}, ensure_ascii=False) + "\n")
    else:
        place = data if name is None else chosen[0].folder.parent
        lines = [_line(row, place) for row in rows] or ["every run is concluded"]
        lines += [f"{path}: removed, no run needs it any more" for path in collected]
        sys.stdout.write("\n".join(lines) + "\n")
    if any(row.outcome in NOT_DONE for row in rows):
        return 1
    return EXIT_ALTERED if any(row.outcome == CONCLUDED and row.error for row in rows) else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ConcludedRow:
    """What came of a run that was to be concluded; `error` says why it was not, or why no verdict counts."""

    run: str
    outcome: str = FAILED
    records_brought: int = 0
    state: str | None = None
    verdict: str | None = None
    error: str = ""


def _concluded(run: RunRecord, *, named: bool) -> ConcludedRow | None:
    """Conclude one run and return what came of it; None for one that there is nothing to do with."""
    row = ConcludedRow(run=run.id)
    try:
        if not to_be_concluded(run, again=named):
            return _as_it_is(row, run) if named else None
        row = replace(row, records_brought=recover(run, again=named))
        if to_be_concluded(run):
            return replace(_as_it_is(row, run), outcome=STILL_RUNNING if run.scanning() else OWNED)
        return _as_it_is(row, run)
    except (StationError, RecipeError, OSError) as error:
        return replace(row, error=" ".join(str(error).split()))


def _as_it_is(row: ConcludedRow, run: RunRecord) -> ConcludedRow:
    """Return the row with what the run says of itself now; the verdict of an altered record is none."""
    manifest = run.manifest()
    if manifest.state == RECORDING:
        return replace(row, outcome=STILL_RUNNING, state=manifest.state)
    if not is_sealed(manifest):
        return replace(row, outcome=WITHOUT_VERDICT, state=manifest.state, error=manifest.trouble or "")
    if altered := alterations(run):
        return replace(row, outcome=CONCLUDED, state=manifest.state, error=altered[0])
    return replace(row, outcome=CONCLUDED, state=manifest.state, verdict=manifest.verdict)


def _line(row: ConcludedRow, data: Path) -> str:
    """Return one run as a line for a person; data: folder of the run."""
    if row.outcome == CONCLUDED:
        brought = f", {row.records_brought} scans brought from memory" if row.records_brought else ""
        found = f"no verdict, because the record was altered: {row.error}" if row.error else row.verdict
        return f"{row.run}: {row.state}, {found}{brought}"
    if row.outcome == STILL_RUNNING:
        return f"run {row.run} is still in progress. Take it over: '{to_paste('resume', row.run, data=data)}'"
    if row.outcome == OWNED:
        return f"run {row.run}: another process is using this run. Try again when that process has ended"
    if row.outcome == WITHOUT_VERDICT:
        return f"run {row.run} was interrupted and has no verdict: {row.error}"
    again = to_paste("conclude", row.run, data=data)
    return f"run {row.run} could not be concluded: {row.error}. Correct this, then run '{again}'"
