"""The list of runs for a person: a table as wide as it needs, or less of it on a narrow terminal.

A run id is never cut off, for it is there to be copied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table
from rich.text import Text

from station.documents.entries import left_out
from station.documents.manifest import attempt_text
from station.errors import RecordError
from station.records.begun_by import BEGUN
from station.records.chain.chain_file import Chain
from station.records.run_record import RunRecord
from station.records.seal import alterations
from station.reports.result_text import VERDICT_STYLES

STATE_STYLES = {"complete": "", "recording": "cyan", "stopped": "yellow", BEGUN: "yellow"}
GAP = 2

WIDE = ("run", "serial", "attempt", "recipe", "state", "verdict", "scans")
NARROW = ("run", "recipe", "result")
"""The run id ends with the serial number, and a verdict says that a run is complete."""

BEFORE = "attempts before"
"""Column of a list with a unit that was measured again."""

RIGHT = ("attempt", "scans")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRow:
    """A run in the list; None for what nobody knows of it.

    attempts: which one it is and what became of those before, in words.
    scanning: process id of its scan process. altered: why it is not as it was when it was concluded. error: what is
    wrong with a run.json that cannot be read.
    """

    run: str
    serial: str | None = None
    attempt: int | None = None
    attempts: str | None = None
    recipe: str | None = None
    revision: int | None = None
    started: str | None = None
    state: str
    scanning: int | None = None
    verdict: str | None = None
    records: int | None = 0
    altered: tuple[str, ...] | None = left_out()
    error: str | None = left_out()


def print_runs(console: Console, rows: Sequence[RunRow], *, fits: bool) -> None:
    """Print runs; `fits` tells that the console's width is that of a terminal, and lines must not be wider.

    On a terminal that is too narrow for a table too, a run takes two lines.
    """
    cells = [_cells(one) for one in rows]
    again = (BEFORE,) if any(one[BEFORE].plain for one in cells) else ()
    for columns in ((*WIDE, *again), (*NARROW, *again)):
        width = _width(cells, columns)
        if not fits or width <= console.width:
            console.width = max(console.width, width)
            console.print(_table(cells, columns))
            return
    for one in cells:
        console.print(one["run"], soft_wrap=True)
        attempt = f"  attempt {one['attempt']}" if one["attempt"].plain else ""
        before = f"; {one[BEFORE]}" if one[BEFORE].plain else ""
        said = ("  ", one["recipe"], "  ", one["result"], attempt, before)
        console.print(Text.assemble(*said), soft_wrap=True)


def state_text(one: RunRow) -> str:
    """Return the state of a run, with the process that still scans it."""
    return f"still running (pid {one.scanning})" if one.scanning else one.state


def _cells(one: RunRow) -> dict[str, Text]:
    verdict = one.verdict or ""
    state = Text(state_text(one), style=STATE_STYLES.get(one.state, "bold red"))
    decided = Text(verdict, style=" ".join(VERDICT_STYLES.get(verdict, "").split()[-1:]))
    shown = {
        "run": Text(one.run),
        "serial": Text(one.serial or ""),
        "attempt": Text(str(one.attempt or "")),
        "recipe": Text(f"{one.recipe} r{one.revision}" if one.recipe else ""),
        "state": state,
        "verdict": decided,
        "scans": Text(str(one.records)),
        BEFORE: Text((one.attempts or "").partition("; ")[2]),
    }
    return shown | {"result": decided if one.state == "complete" and verdict else state}


def _width(cells: list[dict[str, Text]], columns: tuple[str, ...]) -> int:
    return sum(max(len(name), *(one[name].cell_len for one in cells)) + GAP for name in columns)


def _table(cells: list[dict[str, Text]], columns: tuple[str, ...]) -> Table:
    table = Table(box=None, padding=(0, GAP, 0, 0), header_style="dim")
    for name in columns:
        table.add_column(name, justify="right" if name in RIGHT else "left", no_wrap=True)
    for one in cells:
        table.add_row(*(one[name] for name in columns))
    return table


def row(run: RunRecord, chain: Chain | None = None) -> RunRow:
    """Return one run as a row of the list; a manifest that cannot be read is a row as well.

    An altered run has no verdict. Its samples are compared by their size alone: `show` and `analyze` read them.
    chain: that of its data folder, for who looks at many runs.
    """
    try:
        manifest = run.manifest()
        altered = alterations(run, samples=False, chain=chain)
        return RunRow(
            run=run.id,
            serial=manifest.serial,
            attempt=manifest.attempt,
            attempts=attempt_text(manifest.attempt, manifest.before, None),
            recipe=manifest.recipe.name,
            revision=manifest.recipe.revision,
            started=manifest.started,
            state="altered" if altered else run.state(),
            scanning=run.scanning() or None,
            verdict=None if altered else manifest.verdict,
            records=run.records(),
            altered=altered or None,
        )
    except RecordError as error:
        return RunRow(run=run.id, state="damaged", records=run.records(), error=str(error))
