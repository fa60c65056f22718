"""Concluded runs with values that a test chooses: a real store with sealed records, without a bench behind them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from station_samples import SETUP

from station.cli.line.stored_metric import Ask
from station.documents.entries import plain
from station.documents.manifest import RecipeSource, StudyPlace, Unit
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import seal
from station.store.table_counts import all_rows
from station.store.view import look_at

BENCH_TEXT = b"bench: {name: b, revision: 1, embedded: true}\n"
START = datetime(2026, 1, 5, 8, tzinfo=UTC)
ASK = Ask("lost_motion", recipe="inverse")
"""Asks for the values of the runs of `store_lot`."""


def recipe_text(name: str, revision: int) -> bytes:
    """Return a recipe that says how it is called, and nothing else."""
    return f"recipe: {{name: {name}, revision: {revision}}}\n".encode()


def metric(value: float | None, **changes: Any) -> dict[str, Any]:
    """A metric of a result, sided, with a limit."""
    sides = {side: {"value": value, "uncertainty": None, "verdict": "PASS"} for side in ("+", "-")}
    found: dict[str, Any] = {"id": "lost_motion", "definition": "centreline", "value": value, "unit": "arcmin"}
    found |= {"uncertainty": None, "branch": "mean", "side": "+", "estimator": "interpolation", "band": 0.03}
    found |= {"torque_nm": None, "cycles": 3, "limits": {"min": None, "max": 1.0}, "verdict": "PASS", "sides": sides}
    return found | changes


def store_run(
    data: Path,
    serial: str,
    metrics: Sequence[Mapping[str, Any]],
    *,
    day: float = 0.0,
    reasons: Sequence[str] = (),
    state: str = "complete",
    recipe: str = "inverse",
    operator: str | None = None,
    revision: int = 1,
    converted: bool | None = None,
    scenario: str | None = None,
    calibration: Mapping[str, Any] | None = None,
    virtual: str | None = None,
    failed: str | None = None,
    key: str | None = None,
    master: str | None = None,
    text: bytes | None = None,
    study: StudyPlace | None = None,
    fixture: str | None = None,
    lock_angle_deg: float | None = None,
    gates: Sequence[Mapping[str, Any]] = (),
) -> RunRecord:
    """Store one concluded run; `day` moves its start, `converted` says where its output torque comes from.

    calibration: the torque ratio that it measured. virtual: its unit on the virtual bench. failed: why its unit did.
    key: public key that the bench file names. master: verdict that the unit, a master part, should have.
    text: of its recipe, `recipe_text` where None. study: step of a guided study that it measures.
    fixture: its name in the bench file. gates: its validity checks.
    """
    files = {"recipe.yaml": recipe_text(recipe, revision) if text is None else text, "bench.yaml": BENCH_TEXT}
    sha = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    setup = replace(
        SETUP,
        bench=replace(SETUP.bench, sha256=sha["bench.yaml"], public_key=key, fixture=fixture),
        unit=Unit(model="RV", virtual=virtual, master=master),
        recipe=RecipeSource(name=recipe, revision=revision, sha256=sha["recipe.yaml"]),
        operator=operator,
        scenario=scenario,
        study=study,
    )
    run = Store(data).create(serial, setup, files)
    run.samples.touch()
    verdict = "NOT DECIDABLE" if reasons or state != "complete" else "PASS" if failed is None else "FAIL"
    shown = [
        dict(one) | ({"verdict": None if failed is None else "FAIL"} if verdict != one.get("verdict") else {})
        for one in metrics
    ]
    result: dict[str, Any] = {"run": run.id, "serial": serial, "state": state, "verdict": verdict, "metrics": shown}
    result |= {
        "reasons": [*reasons, *([] if failed is None else [failed])],
        "recipe": plain(setup.recipe),
        "bench": plain(setup.bench),
        "unit": plain(setup.unit),
        "clock": "real",
    }
    result |= {"gates": [dict(gate) for gate in gates]}
    result |= {} if scenario is None else {"scenario": scenario}
    result |= {} if lock_angle_deg is None else {"lock_angle_deg": lock_angle_deg}
    result |= {} if converted is None else {"stages": [{"stage": "output torque", "applied": converted}]}
    run.write_json("result.json", result)
    if calibration is not None:
        run.write_json("calibration.json", {"id": f"{run.id}-ratio", **calibration})
    started = (START + timedelta(days=day)).isoformat(timespec="milliseconds")
    seal(run, started=started, state=state, verdict=verdict, records=0)
    return run


def store_lot(data: Path) -> Path:
    """Store five units, the first one measured twice, and runs that do not count, or not with the others."""
    for number, value in enumerate((0.40, 0.42, 0.38, 0.41, 0.39)):
        store_run(data, f"U{number}", [metric(value)], day=number)
    store_run(data, "U0", [metric(0.5)], day=6)
    store_run(data, "U5", [], state="stopped")
    store_run(data, "U6", [metric(9.0)], reasons=["measurement invalid: drift"])
    store_run(data, "U7", [metric(None)])
    store_run(data, "U8", [metric(9.0)], recipe="other")
    return data


def rows_in(data: Path) -> dict[str, list[tuple[Any, ...]]]:
    """Bring the store of a data folder up, and return its rows by table."""
    with look_at(data) as view:
        return all_rows(view.database, view.chain)
