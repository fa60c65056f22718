"""`lostmotion show`: what was measured in one run."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.box import HEAVY
from rich.panel import Panel
from rich.text import Text

from station.documents.entries import plain
from station.documents.manifest import attempt_text
from station.records.chain.chain_file import CHAIN
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import EXIT_ALTERED, is_sealed, vouched_for
from station.reports.result_view import result_console, show_result
from station.reports.stored_result import stored_result


def show(name: str, data: Path, *, as_json: bool) -> int:
    """Print a stored run; its record is read back first, and a damaged or altered one says so; 3 when altered.

    Raises:
        StationError: there is no such run.

    """
    run = Store(data).find(name, alone=True)
    found = stored_result(run)
    code = EXIT_ALTERED if found.altered else 0
    if as_json:
        tell_alone(run)
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
        console.print(
            f"file {CHAIN} is missing in the data folder, so this run's record cannot be verified",
            style="yellow",
            highlight=False,
        )
    show_result(console, found)
    if found.altered:
        console.print(altered_banner(found.altered))
    return code


def tell_alone(run: RunRecord) -> None:
    """Say of a single run without its data folder that no chain vouches for it; of any other nothing."""
    if run.shown_alone and is_sealed(run.manifest()):
        # not by the store's own way to warn, which would load a database
        sys.stderr.write(
            f"WARNING  {run.id}: its folder lies in no data folder, so no {CHAIN} vouches for this record\n"
        )


def altered_banner(altered: Sequence[str]) -> Panel:
    """Return what nobody may overlook: this record is not what the run left."""
    text = Text(" RECORD ALTERED ", style="bold white on red", justify="center")
    for one in altered:
        text.append(f"\n{one}", style="bold red")
    return Panel(text, border_style="red", box=HEAVY, padding=(1, 2))
