"""Another definition of a metric on trial: what evaluating each run alone by the draft says, kept in a ledger."""

from __future__ import annotations

import errno
import multiprocessing
import os
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from math import isnan
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here

from recipes import RecipeError, find_recipe, parse_recipe
from recipes.editing import changed
from station.archive.place import Place
from station.archive.push import push
from station.archive.settings import load_settings
from station.cli.runs.evaluate_anew import reevaluate
from station.documents.manifest import MANIFEST
from station.errors import StationError
from station.quality.limits_trial import Tried, draft_text
from station.quality.recipe_change import change_of, changed_recipe, definition_of, other_definitions
from station.records.data_folder import Store
from station.reevaluation import definition_trial as definition_trial_module
from station.reevaluation.definition_trial import definition_trial
from station.reevaluation.evaluate_one import Job, evaluate_one
from station.reevaluation.ledger import FOLDER
from station.reevaluation.question import Question
from station.store.quality.lot import Lot
from station.store.quality.trial import Rule
from station.web.definition_trials import DefinitionTrials, TrialState

LOT = Lot(virtual=True)
LONGEST_S = 180.0
RECIPE = "rv-40e-121-quick"
STRICT = 0.3
"""A limit of the lost motion [arcmin] that no unit keeps by the definition on trial."""

TRIED = {
    "another metric": Tried("lost_motion", definition="backlash_width_zero"),
    "another metric with another limit": Tried("lost_motion", limit_max=0.01, definition="backlash_width_zero"),
    "another choice without a guard band": Tried(
        "spring_constant", limit_min=10.0, guard_factor=0.0, definition="variant=direct branch=load"
    ),
    "the side alone": Tried("backlash_width_3pct", limit_max=5.0, definition="side=-"),
}


@pytest.fixture
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    copied: Path = request.getfixturevalue(request.param).copy(tmp_path / "runs").parent
    return copied


@pytest.fixture
def good_and_worn(quick_run: Any, quarter: Callable[[str], str], tmp_path: Path) -> Path:
    """A good unit that passed and a worn one that failed, by the same recipe."""
    data: Path = quick_run.copy(tmp_path / "runs").parent
    words = ("--virtual-time", "--unit", "worn", "--serial", "W1", "--no-report", "--data", str(data))
    assert here("run", quarter(RECIPE), *words).exit_code == 1
    return data


@pytest.fixture
def two_revisions(quick_run: Any, quarter: Callable[[str], str], tmp_path: Path) -> Path:
    """A run by the recipe as it is, and a newer one by a revision with a stricter limit and the simple rule."""
    data: Path = quick_run.copy(tmp_path / "runs").parent
    content = Path(quarter(RECIPE)).read_bytes()
    revision = parse_recipe(content, RECIPE).recipe.revision + 1
    content = changed(content, ("recipe", "revision"), str(revision))
    content = changed(content, ("metrics", 1, "max"), f"{STRICT} arcmin")
    file = tmp_path / "stricter.yaml"
    file.write_bytes(changed(content, ("decision", "rule"), "simple"))
    here("run", str(file), "--virtual-time", "--unit", "P1:4", "--serial", "SN 2", "--no-report", "--data", str(data))
    assert len(list(Store(data).runs())) == 2
    return data


def test_a_trial_says_what_evaluating_each_run_alone_by_the_draft_says(good_and_worn: Path, tmp_path: Path) -> None:
    runs = Store(good_and_worn).runs()
    before = {run.id: (run.manifest().verdict, (run.folder / MANIFEST).read_bytes()) for run in runs}
    for tried in TRIED.values():
        found = definition_trial(good_and_worn, LOT, tried)
        file = tmp_path / "draft.yaml"
        file.write_bytes(draft_text(good_and_worn, found))
        alone = {run.id: reevaluate(run, str(file), None) for run in runs}
        changes = Counter((before[run][0], one.verdict) for run, one in alone.items())
        assert {(was, new): number for was, new, number in found.verdicts} == changes, tried
        flipped = {run for run, one in alone.items() if before[run][0] != one.verdict}
        assert {one.run for one in found.flipped} == flipped, tried
        assert (found.flips, found.runs, found.evaluated, found.not_evaluated) == (len(flipped), 2, 2, ())
        for one in found.flipped:
            if alone[one.run].reasons:
                assert one.why.startswith(alone[one.run].reasons[0])
        told = [next(m for m in one.metrics if m.id in (tried.definition, tried.metric)) for one in alone.values()]
        means = {one.side: one.on_trial.mean for one in found.risks if one.on_trial and not isnan(one.on_trial.mean)}
        assert set(means) == {side for one in told for side in one.sides}
        for side, mean in means.items():
            values = [one.sides[side].value for one in told if side in one.sides]
            assert mean == pytest.approx(sum(values) / len(values), rel=1e-12)
    assert before == {run.id: (run.manifest().verdict, (run.folder / MANIFEST).read_bytes()) for run in runs}


def test_runs_of_an_older_revision_are_judged_by_the_limit_and_the_rule_of_the_draft(
    two_revisions: Path, tmp_path: Path
) -> None:
    """The limit on trial is that of the newest run already; the older one has another, and another rule."""
    found = definition_trial(two_revisions, LOT, Tried("lost_motion", limit_max=STRICT, definition="band=4%"))
    file = tmp_path / "draft.yaml"
    file.write_bytes(draft_text(two_revisions, found))
    runs = Store(two_revisions).runs()
    alone = {run.id: reevaluate(run, str(file), None) for run in runs}
    before = {run.id: run.manifest().verdict for run in runs}
    assert {one.verdict for one in alone.values()} == {"FAIL"}
    assert {(one.run, one.before, one.after) for one in found.flipped} == {
        (run, before[run], "FAIL") for run in before if before[run] != "FAIL"
    }
    assert sum(number for _, after, number in found.verdicts if after == "FAIL") == len(runs)


@pytest.mark.parametrize("folder", ["quick_run"], indirect=True)
def test_the_trace_of_the_archive_says_the_same_and_what_is_known_is_not_evaluated_again(folder: Path) -> None:
    tried = TRIED["another metric with another limit"]
    here_found = definition_trial(folder, LOT, tried)
    again = definition_trial(folder, LOT, tried)
    assert (again.evaluated, again.known, again.verdicts) == (0, 1, here_found.verdicts)
    (folder / "archive.yaml").write_text(f"url: {folder.parent / 'archive'}\n", encoding="utf-8")
    push(folder, Place(load_settings(folder)))
    for ledger in (folder / FOLDER).glob("*.jsonl"):
        ledger.unlink()
    archived = definition_trial(folder, LOT, tried)
    assert archived == replace(here_found, evaluated=1, known=0)
    run = Store(folder).find("last")
    (run.folder / "samples.bin").unlink(missing_ok=True)  # the trace of the archive is enough
    kept = next((folder / FOLDER).glob("*.jsonl")).read_text(encoding="utf-8")
    assert kept.count("\n") == 1


@pytest.mark.parametrize("folder", ["quick_run"], indirect=True)
def test_a_run_that_cannot_be_evaluated_is_named_and_not_counted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = Store(folder).find("last")
    real = definition_trial_module.jobs_for

    def altered(*asked: Any) -> Any:
        (run.folder / "result.json").write_bytes(b"{}")
        return real(*asked)

    monkeypatch.setattr(definition_trial_module, "jobs_for", altered)
    found = definition_trial(folder, LOT, TRIED["another metric"])
    assert (found.runs, found.flips) == (0, 0)
    assert found.not_evaluated[0][0] == run.id
    assert "altered: result.json" in found.not_evaluated[0][1]


REFUSED = {
    "a unit of another kind": ("windup", "hysteresis_energy", "windup are in arcmin"),
    "a limit": ("lost_motion", "backlash_width_zero max=2", "found the limit max=2"),
    "no metric": ("lost_motion", "lost_moton", "lost_motion"),
    "no choice of it": ("lost_motion", "lost_motion fit=six_segment", "fit"),
    "the same definition": ("lost_motion", "lost_motion", "what the recipe has"),
    "the same by its default": ("spring_constant", "branch=mean", "what the recipe has"),
}


@pytest.mark.parametrize("folder", ["quick_run"], indirect=True)
def test_what_cannot_be_tried_is_refused_before_a_run_is_evaluated(folder: Path) -> None:
    for metric, text, said in REFUSED.values():
        with pytest.raises((StationError, RecipeError), match=said):
            definition_trial(folder, LOT, Tried(metric, definition=text))
    assert not (folder / FOLDER).exists()
    told = here(
        "quality", "trial", "--metric", "windup", "--definition", "hysteresis_energy", "--virtual", "--data", folder
    )
    assert told.exit_code == 2
    assert "Choose a metric in arcmin" in " ".join(told.err.split())


@pytest.mark.parametrize("folder", ["quick_run"], indirect=True)
def test_the_command_prints_both_definitions_and_saves_the_draft(folder: Path) -> None:
    words = ("quality", "trial", "--metric", "lost_motion", "--definition", "backlash_width_zero", "--max", "0.01",
             "--virtual", "--workers", "1", "--data", folder)  # fmt: skip
    told = here(*words)
    assert told.exit_code == 0, told.err
    assert "1 of 1 verdicts flip" in told.out
    assert "'backlash_width_zero': ≤ 0.01 arcmin" in told.out
    assert "1 evaluated now, 0 known before" in told.out
    said = here(*words, "--save-draft", "A. Tester", "--json").json
    assert (said["known"], said["evaluated"], said["definition"]) == (1, 0, "backlash_width_zero")
    assert said["draft"]


def test_every_definition_that_is_offered_can_be_tried_and_is_another_one() -> None:
    text = find_recipe(RECIPE).read_bytes()
    recipe = parse_recipe(text, RECIPE)
    reference_nm, rule = recipe.measurement.reference_torque_nm, Rule(None, None, None)
    for one in recipe.metrics:
        offered = other_definitions(recipe, one.id)
        assert len(set(offered)) == len(offered)
        for said in offered:
            wanted, options = definition_of(recipe, one.id, said)
            draft = parse_recipe(changed_recipe(text, change_of(one.id, rule, rule, options)), "draft")
            keys = [metric.key(reference_nm) for metric in draft.metrics]
            assert wanted.key(reference_nm) in keys
            assert wanted.key(reference_nm) != one.key(reference_nm)
    assert "spring_constant fit=three_region" in other_definitions(recipe, "spring_constant")
    assert "backlash_width_zero" in other_definitions(recipe, "lost_motion")


def test_choices_that_are_not_said_any_more_leave_the_recipe_and_comments_stay() -> None:
    text = find_recipe(RECIPE).read_bytes()
    text = changed(text, ("metrics", 2, "branch"), "load")
    recipe = parse_recipe(text, RECIPE)
    _, options = definition_of(recipe, "spring_constant", "variant=centred")
    rules = Rule(108.0, None, 0.5), Rule(None, 130.0, None)
    change = change_of("spring_constant", *rules, options)
    found = changed_recipe(text, change)
    one = parse_recipe(found, RECIPE).metrics[2]
    assert (one.branch, one.variant, one.min, one.max) == (None, "centred", None, 130.0)
    assert parse_recipe(found, RECIPE).decision.rule == "simple"
    assert [line for line in found.decode().splitlines() if "#" in line] == [
        line for line in text.decode().splitlines() if "#" in line
    ]
    said = "spring_constant with variant centred, min none, max 130 N·m/arcmin, guard_factor none, rule simple"
    assert change.text == said


def test_a_recipe_that_has_the_metric_twice_is_refused_as_the_run_is(quick_run: Any) -> None:
    run = Store(quick_run.data).find("last")
    question = Question(change=change_of("stiffness_at", Rule(None, None, None), Rule(1.0, None, None)))
    job = Job(run.id, "SN 1", "", "PASS", folder=str(run.folder))
    assert "has 0 entries of stiffness_at" in evaluate_one(job, question).error


def _ended(trials: DefinitionTrials) -> TrialState:
    until = time.monotonic() + LONGEST_S
    while (now := trials.state) is None or now.running:
        assert time.monotonic() < until, now
        time.sleep(0.05)
    return now


def test_a_process_that_cannot_be_started_is_said_and_keeps_no_other_trial_waiting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trials = DefinitionTrials()

    def no_memory(_process: object) -> None:
        raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

    monkeypatch.setattr(SpawnProcess, "start", no_memory)
    for _ in range(2):
        with pytest.raises(StationError, match="The trial cannot be started: Cannot allocate memory"):
            trials.start(tmp_path, LOT, TRIED["another metric"])
    assert trials.state is None
    trials.close()


@pytest.mark.wires
@pytest.mark.parametrize("folder", ["quick_run"], indirect=True)
def test_a_server_evaluates_one_trial_at_a_time_and_one_that_was_stopped_goes_on(folder: Path) -> None:
    trials, tried = DefinitionTrials(), TRIED["another metric with another limit"]
    try:
        trials.start(folder, LOT, tried)
        with pytest.raises(StationError, match="'backlash_width_zero' is on trial"):
            trials.start(folder, LOT, tried)
        trials.stop()
        assert "Stopped after" in _ended(trials).error
        trials.start(folder, LOT, tried)
        now = _ended(trials)
        assert now.found is not None, now.error
        assert (now.found.flips, now.done, now.of) == (1, 1, 1)
        trials.start(folder, LOT, Tried("windup", definition="hysteresis_energy"))
        assert "Choose a metric in arcmin" in _ended(trials).error
        trials.start(folder, LOT, tried)
        trials._process.kill()
        assert "ended" in _ended(trials).error
    finally:
        trials.close()


@pytest.mark.wires
@pytest.mark.parametrize("folder", ["quick_run"], indirect=True)
def test_a_trial_that_is_stopped_leaves_no_folder_of_its_processes(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(multiprocessing.current_process()._config, "tempdir", raising=False)
    with tempfile.TemporaryDirectory() as place:  # its path is short, as that of a socket must be
        monkeypatch.setenv("TMPDIR", place)
        trials, until = DefinitionTrials(), time.monotonic() + LONGEST_S
        try:
            trials.start(folder, LOT, TRIED["another metric with another limit"])
            while not list(Path(place).glob("pymp-*")):
                assert time.monotonic() < until
                assert trials.state is not None
                assert trials.state.running, trials.state
                time.sleep(0.01)
        finally:
            trials.close()
        assert list(Path(place).glob("pymp-*")) == []
