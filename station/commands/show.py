"""`lostmotion show` and `lostmotion list`: what was measured."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from rich.box import HEAVY
from rich.console import Console
from rich.panel import Panel
from rich.text import Text

from station.errors import RecordError, StationError
from station.record.check import check_file
from station.record.run_index import INDEX, has_index
from station.record.run_record import RESULT, RunRecord
from station.record.seal import alterations, is_sealed
from station.record.store import Store
from station.reports.result_view import result_console, show_result
from station.run.recovery import recover_all
from station.run.run_list import print_runs

ROW_KEYS = frozenset({"id", "value", "unit", "uncertainty", "branch", "side", "limits", "verdict"})


def show(name: str, data: Path, *, as_json: bool) -> int:
    """Print a stored run; its record is read back first, and a damaged or altered one says so.

    Raises:
        StationError: there is no such run.

    """
    store = Store(data)
    recover_all(store)
    run = store.find(name)
    found = stored_result(run)
    if as_json:
        sys.stdout.write(json.dumps(found, ensure_ascii=False) + "\n")
        return 0
    console = result_console()
    manifest = run.manifest()
    by = f" by {manifest['operator']}" if manifest.get("operator") else ""
    console.print(
        f"{run.id}  attempt {manifest['attempt']}, started {manifest['started']}{by}, {run.records()} scans on disk",
        highlight=False,
        soft_wrap=True,
    )
    if is_sealed(manifest) and not has_index(run):
        console.print(f"no {INDEX} beside this run: nothing vouches for its run.json", style="yellow", highlight=False)
    show_result(console, found)
    if found.get("altered"):
        console.print(altered_banner(found["altered"]))
    return 0


def altered_banner(altered: list[str]) -> Panel:
    """Return what nobody may overlook: this record is not what the run left."""
    text = Text(" RECORD ALTERED ", style="bold white on red", justify="center")
    for one in altered:
        text.append(f"\n{one}", style="bold red")
    return Panel(text, border_style="red", box=HEAVY, padding=(1, 2))


def stored_result(run: RunRecord) -> dict[str, Any]:
    """Return a run's result; for a run that was not concluded, what is known; for a doubtful record, no verdict.

    Of a record that does not read back, or is not as it was when the run was concluded, no row keeps its verdict.
    """
    manifest, state = run.manifest(), run.state()
    if not is_sealed(manifest):
        return _without_result(run, manifest, state)
    altered = alterations(run)
    result = _without_result(run, manifest, state)
    try:
        result |= run.read_json(RESULT)
        # An altered result may be of any shape, and rows that cannot be shown must not keep the alteration from it.
        result |= {"metrics": [one for one in result["metrics"] if set(one) >= ROW_KEYS]}
        result |= {"record": str(run.folder)}  # where it is now: a data folder may have been copied or moved
    except (RecordError, TypeError, ValueError):
        result = _without_result(run, manifest, state)
    read_back = check_file(run.samples, manifest.get("records"))
    doubts = [f"record altered: {one}" for one in altered]
    doubts += [f"the record is damaged: {problem}" for problem in read_back.problems]
    if not doubts:
        return result
    result |= {"altered": list(altered)} if altered else {}
    return without_verdicts(result, doubts)


def without_verdicts(result: dict[str, Any], reasons: list[str]) -> dict[str, Any]:
    """Return a result that decides nothing, in no row either, and says why; its other reasons follow."""
    metrics = [
        metric
        | {"verdict": None}
        | {"sides": {side: found | {"verdict": None} for side, found in metric.get("sides", {}).items()}}
        for metric in result["metrics"]
    ]
    return result | {"verdict": "NOT DECIDABLE", "reasons": [*reasons, *result["reasons"]], "metrics": metrics}


def _without_result(run: RunRecord, manifest: dict[str, Any], state: str) -> dict[str, Any]:
    reasons = {
        "recording": "the run is still going on",
        "interrupted": "the run was interrupted before it was evaluated; its samples are kept",
    }
    trouble = manifest.get("trouble")
    if run.scanning():
        reasons["interrupted"] = (
            f"still running (pid {run.scanning()}) without its desk. Take it over: 'lostmotion resume'"
        )
        reasons["recording"] = f"still running (pid {run.scanning()})"
    return {
        "run": run.id,
        "serial": manifest["serial"],
        "recipe": {key: manifest["recipe"][key] for key in ("name", "revision", "sha256")},
        "scenario": manifest.get("scenario"),
        "operator": manifest.get("operator"),
        "state": state,
        "verdict": "NOT DECIDABLE",
        "reasons": [reasons.get(state, f"the run ended as {state} without a result"), *([trouble] if trouble else [])],
        "metrics": [],
        "timing": None,
        "alarms": [],
        "record": str(run.folder),
        "records": run.records(),
    }


def row(run: RunRecord) -> dict[str, Any]:
    """Return one run as a row of the list; a manifest that cannot be read is a row as well.

    An altered run has no verdict. Its samples are compared by their size alone: `show` and `analyze` read them.
    """
    try:
        manifest = run.manifest()
        altered = alterations(run, samples=False)
        found = {
            "run": run.id,
            "serial": manifest["serial"],
            "attempt": manifest["attempt"],
            "recipe": manifest["recipe"]["name"],
            "revision": manifest["recipe"]["revision"],
            "started": manifest["started"],
            "state": "altered" if altered else run.state(),
            "scanning": run.scanning() or None,
            "verdict": None if altered else manifest["verdict"],
            "records": run.records(),
        }
        return found | ({"altered": list(altered)} if altered else {})
    except (RecordError, KeyError, TypeError, AttributeError) as error:
        damaged = dict.fromkeys(("serial", "attempt", "recipe", "revision", "started", "verdict"))
        return {"run": run.id, **damaged, "state": "damaged", "records": run.records(), "error": str(error)}


def list_runs(data: Path, *, as_json: bool) -> int:
    """Print all runs, newest last.

    Raises:
        StationError: the data folder is not there.

    """
    if not data.is_dir():
        what = "is a file" if data.exists() else "there is no such folder"
        raise StationError(f"--data {data}: {what}; a folder that holds runs is needed, as 'lostmotion run' makes it")
    store = Store(data)
    recover_all(store)
    rows = [row(run) for run in store.runs()]
    if as_json:
        sys.stdout.write(json.dumps(rows, ensure_ascii=False) + "\n")
        return 0
    if not rows:
        sys.stdout.write(f"{data}: holds no runs\n")
        return 0
    console = Console()
    print_runs(console, rows, fits=console.is_terminal)
    return 0
