"""A calibration that was in date when a run was made: what is computed from the run later does not ask for another."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pytest
from lostmotion_command import here
from patient import GOLDEN_RECIPE, VIRTUAL_BENCH

import recipes.checks.cross_check
from recipes import RecipeError
from station.bench.request import load_job, stored_job
from station.errors import RecordError
from station.records.run_record import RunRecord

DUE = date(2099, 12, 31)
LINE = "{slope: 94.7, offset: -13.9 N·m}"
CALIBRATION = (
    f"calibrations:\n  - {{id: c1, model: RV-40E-121, made: 2026-01-01, due: {DUE}, load_positive: {LINE}, "
    f"unload_positive: {LINE}, load_negative: {LINE}, unload_negative: {LINE}}}"
)
RECIPE_EDITS = {
    "output_torque: reaction": "output_torque: calibrated\n  calibration: stored\n  reference_torque: 30 %",
    "  - calibrate: {peak_torque: 30 %, torque_rate: 300 N·m/s, dwell: 40 ms}\n": "",
    "{id: torque_ratio_slope}": "{id: windup}",
}


def changed(source: Path, target: Path, edits: dict[str, str]) -> str:
    text = source.read_text(encoding="utf-8")
    for old, new in edits.items():
        assert old in text
        text = text.replace(old, new)
    target.write_text(text, encoding="utf-8")
    return str(target)


@pytest.fixture
def files(tmp_path: Path) -> tuple[str, str]:
    recipe = changed(GOLDEN_RECIPE, tmp_path / "recipe.yaml", RECIPE_EDITS)
    return recipe, changed(VIRTUAL_BENCH, tmp_path / "bench.yaml", {"calibrations: []": CALIBRATION})


@pytest.fixture
def run(files: tuple[str, str], stored_once: Callable, tmp_path: Path) -> RunRecord:
    """A run by a stored calibration, made while it was in date."""
    recipe, bench = files
    stored = stored_once("by-stored-lines", recipe, "--bench", bench, "--serial", "C", "--no-report")
    assert stored.ran.json["state"] == "complete", stored.ran
    return RunRecord(stored.copy(tmp_path / "runs"))


@pytest.fixture
def later(monkeypatch: pytest.MonkeyPatch) -> None:
    """From here on it is the day after the calibration was due."""

    class Later(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.combine(DUE + timedelta(days=1), datetime.min.time(), tz)

    monkeypatch.setattr(recipes.checks.cross_check, "datetime", Later)


WORDS = [
    ("replay", "--json"),
    ("replay", "--recipe", "OWN", "--json"),
    ("report", "--json"),
    ("show", "--json"),
    ("analyze", "--json"),
    ("export", "--out", "OUT", "--json"),
]


@pytest.mark.parametrize("words", WORDS, ids=" ".join)
def test_a_run_says_the_same_when_its_calibration_is_overdue(
    words: tuple[str, ...], run: RunRecord, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    other = {"OWN": str(run.folder / "recipe.yaml"), "OUT": str(tmp_path)}
    asked = [words[0], str(run.folder), *(other.get(word, word) for word in words[1:])]
    before = here(*asked)
    request.getfixturevalue("later")
    after = here(*asked)
    assert (after.exit_code, after.err) == (before.exit_code, before.err)
    unlike = ("seconds", "scans_per_s")
    assert {**after.json, **dict.fromkeys(unlike)} == {**before.json, **dict.fromkeys(unlike)}


def test_an_overdue_run_replays_to_its_last_scan(run: RunRecord, later: None) -> None:  # noqa: ARG001
    ran = here("replay", str(run.folder), "--json")
    assert (ran.exit_code, ran.json["identical_scans"], ran.json["program_differs"]) == (0, run.records(), [])


def test_no_run_is_begun_by_an_overdue_calibration(files: tuple[str, str], run: RunRecord, later: None) -> None:  # noqa: ARG001
    with pytest.raises(RecipeError, match=f"was due on {DUE}"):
        load_job(*files)
    assert stored_job(run).bench.newest_calibration("RV-40E-121") is not None


def test_the_day_of_a_run_is_that_of_its_start(run: RunRecord) -> None:
    assert abs(run.day() - datetime.now(tz=UTC).date()) <= timedelta(days=1)
    run.update(started="2031-05-06T23:59:59.999+00:00")
    assert run.day() == date(2031, 5, 6)
    run.update(started="yesterday")
    with pytest.raises(RecordError, match="is damaged: started"):
        run.day()
