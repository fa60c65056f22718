"""`lostmotion list`: the runs of a data folder, and what is missing or altered there."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from rich.console import Console

from station.documents.entries import plain
from station.errors import StationError
from station.records.begun_by import BEGUN, begun_and_left, begun_text
from station.records.chain.chain_file import Chain
from station.records.run_record import NOT_CONCLUDED, RunRecord
from station.records.to_paste import to_paste
from station.run.run_list import RunRow, print_runs, row
from station.store.attempts import attempts_told
from station.store.stored_runs import StoredRun, believed, runs_named
from station.store.view import View, look_at

NEWEST = 50
"""Runs that are read from their folders each time, so that nothing but folder and chain has a say in what they are."""

MOST_LOOKS = 5
"""Looks at a folder in which units are measured, as long as something there is in doubt."""

MOST_PROBLEMS = 20
"""Problems that are told; `lostmotion verify` tells all."""


def list_runs(data: Path, limit: int | None, *, as_json: bool) -> int:
    """Print the newest runs, newest last; limit: how many, None for all.

    Raises:
        StationError: the data folder is not there.

    """
    if not data.is_dir():
        what = "is a file" if data.exists() else "there is no such folder"
        raise StationError(f"--data {data}: {what}; a folder that holds runs is needed, as 'lostmotion run' makes it")
    for _ in range(MOST_LOOKS):
        before = Chain(data).seen_now()
        with look_at(data) as view:
            left_out = 0 if limit is None else max(len(view.runs) - limit, 0)
            rows = list_rows(view, view.runs[left_out:])
        if before == Chain(data).seen_now() or not (view.problems or any(one.altered or one.error for one in rows)):
            break  # else a run was begun or concluded meanwhile, and what is in doubt may only be newer than the look
    if as_json:
        sys.stdout.write(json.dumps(plain(rows), ensure_ascii=False) + "\n")
    elif not rows:
        sys.stdout.write(f"{data}: holds no runs\n")
    else:
        console = Console(markup=False, emoji=False)
        print_runs(console, rows, fits=console.is_terminal)
    stream = sys.stderr if as_json else sys.stdout
    stream.writelines(f"{line}\n" for line in [*_below(view, rows), *_notes(view, left_out)])
    return 0


def _below(view: View, rows: list[RunRow]) -> list[str]:
    """Return what is said of damaged runs, each with its damage, of one that was only begun, and how to conclude."""
    lines = [f"damaged  {one.run}: {one.error}" for one in rows if one.state == "damaged"]
    begun = begun_and_left(view.data, [one.run for one in rows if one.state == BEGUN])
    lines += [] if begun is None else [begun_text(begun)]
    waiting = sum(one.state == NOT_CONCLUDED and not one.scanning for one in rows)
    if waiting:
        every = to_paste("conclude", "--all", data=view.data)
        lines.append(f"runs that are not evaluated yet: {waiting}. '{every}' evaluates them")
    return lines


def list_rows(view: View, runs: list[str]) -> list[RunRow]:
    """Return runs as rows of the list. The newest ones are read from their folders, older ones from the store."""
    view.chain.index()
    stored: dict[str, StoredRun] = {}
    told: dict[str, str] = {}
    if len(runs) > NEWEST:
        with view.database.reading() as connection:
            stored = runs_named(connection, view.chain, runs[:-NEWEST])
            told = attempts_told(connection, view.chain, view.trust, stored.values())
    missing = set(view.missing)
    rows = []
    for run in runs:
        if run in missing:
            rows.append(_missing_row(view, run))
        elif run in stored:
            rows.append(_stored_row(believed(stored[run], view.chain, view.trust), told.get(run)))
        else:
            rows.append(row(RunRecord(view.data / run), view.chain))
    return rows


def _missing_row(view: View, run: str) -> RunRow:
    created = next((entry.fields for entry in view.chain.entries_of(run)), {})
    # Anybody can lay the file of a begun run where another was deleted, which is told as a problem.
    lost = any(one.kind == "missing" and one.run == run for one in view.problems)
    state = "missing" if lost or begun_and_left(view.data, [run]) is None else BEGUN
    return RunRow(run=run, state=state, serial=created.get("serial"), attempt=created.get("attempt"))


def _stored_row(stored: StoredRun, attempts: str | None) -> RunRow:
    return RunRow(
        run=stored.run,
        serial=stored.serial,
        attempt=stored.attempt,
        attempts=attempts,
        recipe=stored.recipe,
        revision=stored.revision,
        started=stored.started,
        state="altered" if stored.altered else stored.state,
        verdict=stored.verdict,
        records=stored.records,
        altered=tuple(stored.altered.splitlines()) or None,
    )


def _notes(view: View, left_out: int) -> list[str]:
    every = to_paste("list", "--all", data=view.data)
    notes = [f"{left_out} older runs are not shown. All: '{every}'"] if left_out else []
    texts = [problem.text for problem in view.problems]
    notes += [f"PROBLEM  {text}" for text in texts[:MOST_PROBLEMS]]
    return notes + ([f"{len(texts)} found: see '{to_paste('verify', data=view.data)}'"] if texts else [])
