"""Re-evaluation at scale: what `analyze` says of each run, noted once, whoever dies; no stored verdict changes."""

from __future__ import annotations

import csv
import io
import multiprocessing
import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from stored_runs import metric, store_run

from recipes import Selection
from station.archive.place import Place
from station.archive.push import push
from station.archive.settings import load_settings
from station.archive.trace_rows import trace_in
from station.cli.runs.evaluate_anew import reevaluate
from station.documents.result import Evaluation
from station.records.data_folder import Store
from station.reevaluation import evaluate_one as evaluate_one_module
from station.reevaluation import run_question, workers
from station.reevaluation.evaluate_one import Job, Outcome, evaluate_one
from station.reevaluation.jobs import Where, jobs_of, where_of
from station.reevaluation.ledger import FOLDER
from station.reevaluation.question import Question, question_of
from station.reevaluation.run_question import Means, ask_of_runs
from station.results.evaluation import LOADED_AHEAD

METRICS = ("lost_motion", "stiffness_at torque=50% branch=load")


@pytest.fixture(scope="module")
def folder(quick_run: Any, worn_run: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good unit and a worn one with whole records, archived, each in a folder of its own below."""
    base = tmp_path_factory.mktemp("reevaluation")
    for name, stored in (("good", quick_run), ("worn", worn_run)):
        data = base / name
        shutil.copytree(stored.data, data)
        (data / "archive.yaml").write_text(f"url: {base / 'archive'}\n", encoding="utf-8")
        push(data, Place(load_settings(data)))
    return base


@pytest.fixture(scope="module")
def stricter(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The quick recipe with a limit that no unit passes."""
    from recipes import find_recipe  # noqa: PLC0415

    text = find_recipe("rv-40e-121-quick").read_text(encoding="utf-8")
    file = tmp_path_factory.mktemp("recipe") / "stricter.yaml"
    file.write_text(
        text.replace("{id: lost_motion, max: 1 arcmin}", "{id: lost_motion, max: 0.01 arcmin}"), encoding="utf-8"
    )
    return file


def STRICTER(text: str) -> str:  # noqa: N802
    head, _, tail = text.partition("max: ")
    return f"{head}max: 0.001{tail[tail.index(' arcmin') :]}"


def jobs(data: Path, *, whole: bool, archive: bool) -> list[Job]:
    return jobs_of(data, Where(), load_settings(data), whole_record=whole, from_archive=archive).jobs


def said(outcome: Outcome) -> tuple[Any, ...]:
    return (
        outcome.error,
        outcome.verdict,
        outcome.reasons,
        tuple((one.id, one.value, one.uncertainty) for one in outcome.metrics),
    )


def alone(found: Evaluation) -> tuple[Any, ...]:
    return "", found.verdict, found.reasons, tuple((one.id, one.value, one.uncertainty) for one in found.metrics)


@pytest.mark.parametrize("unit", ["good", "worn"])
def test_trace_and_record_here_and_in_the_archive_say_what_analyze_says(
    folder: Path, stricter: Path, unit: str
) -> None:
    data = folder / unit
    run = Store(data).find("last")
    by_metric, by_recipe = Question(selection=Selection(None, METRICS)), question_of(str(stricter), None, ())
    expected = alone(reevaluate(run, None, None, by_metric.selection))
    (trace,) = jobs(data, whole=False, archive=True)
    assert trace.trace_sha256, "definitions of metrics need the trace alone"
    assert said(evaluate_one(trace, by_metric)) == expected
    expected = alone(reevaluate(run, str(stricter), None))
    (record,), (archived,) = jobs(data, whole=True, archive=False), jobs(data, whole=True, archive=True)
    assert (record.folder, archived.folder) == (str(run.folder), "")
    assert said(evaluate_one(record, by_recipe)) == said(evaluate_one(archived, by_recipe)) == expected
    assert expected[1] == "FAIL"


def test_of_a_trace_that_does_not_say_whether_a_ramp_was_held_the_record_is_read(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As older versions archived it; the record in the archive says it, and U depends on it."""
    (job,) = jobs(folder / "good", whole=False, archive=True)
    question, read = Question(selection=Selection(None, METRICS)), []

    def trace_of_before(*asked: Any) -> Any:
        facts, trace = trace_in(*asked)
        return replace(facts, counts=replace(facts.counts, holds=None)), trace

    def from_record(asked: Job, question: Question) -> Any:
        read.append(asked.object)
        return whole(asked, question)

    whole = evaluate_one_module._from_record
    expected = said(evaluate_one(job, question))
    monkeypatch.setattr(evaluate_one_module, "_from_record", from_record)
    assert said(evaluate_one(job, question)) == expected
    assert not read
    monkeypatch.setattr(evaluate_one_module, "trace_in", trace_of_before)
    assert said(evaluate_one(job, question)) == expected
    assert read == [job.whole]


def test_what_is_not_as_it_was_archived_or_sealed_is_no_outcome(folder: Path, tmp_path: Path) -> None:
    (job,) = jobs(folder / "good", whole=False, archive=True)
    question = Question(selection=Selection(None, METRICS))
    for wrong in (replace(job, trace_sha256="0" * 64), replace(job, sha256="0" * 64), replace(job, group=7)):
        told = evaluate_one(wrong, question).error
        assert job.object in told
        assert "estore" in told
    (record,) = jobs(folder / "good", whole=True, archive=False)
    copy = Path(shutil.copytree(folder / "good", tmp_path / "runs"))
    run = copy / record.run
    (run / "result.json").write_bytes(b"{}")
    assert (
        "the record of the run was altered: result.json"
        in evaluate_one(replace(record, folder=str(run)), question).error
    )


@pytest.fixture
def many(tmp_path: Path) -> Path:
    """Thirty small runs."""
    data = tmp_path / "runs"
    for number in range(30):
        store_run(data, f"U{number}", [metric(0.4 + 0.01 * number)], day=number)
    return data


def dying(job: Job, question: Question) -> Outcome:
    """Answer by the serial number; the process of every seventh run ends at its first try, without a folder always."""
    mark = Path(question.recipe_file) / job.run
    if int(job.serial[1:]) % 7 == 3 and not (question.recipe_file and mark.exists()):
        if question.recipe_file:
            mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return Outcome(job.run, "FAIL" if int(job.serial[1:]) % 5 == 0 else "PASS", software=run_question.software_key())


def question_for(tmp_path: Path) -> Question:
    marks = tmp_path / "marks"
    marks.mkdir(exist_ok=True)
    return Question(b"x", str(marks))


@pytest.fixture
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that are forks of this one, so that they evaluate as the test does."""
    real = workers.multiprocessing.get_context

    class Forking:
        def __init__(self) -> None:
            self._context = real("fork")
            self.Pipe, self.Process = self._context.Pipe, self._context.Process

        def set_forkserver_preload(self, _: list[str]) -> None: ...

    monkeypatch.setattr(workers.multiprocessing, "get_context", lambda _: Forking())
    monkeypatch.setattr(workers, "evaluate_one", dying)


@pytest.mark.usefixtures("forked")
def test_processes_that_die_are_replaced_and_the_ledger_has_each_run_once(many: Path, tmp_path: Path) -> None:
    question, before = question_for(tmp_path), {run.id: run.manifest().verdict for run in Store(many).runs()}
    found = ask_of_runs(many, question, Where(), Means(3))
    assert (found.evaluated, found.known, found.died, found.twice, found.failed) == (30, 0, 4, 0, {})
    assert len({line.sha256 for line in found.lines}) == len(found.ledger.read_text("utf-8").splitlines()) == 30
    assert [line.serial for line in found.flips()] == [f"U{number}" for number in range(0, 30, 5)]
    again = ask_of_runs(many, question, Where(), Means(3))
    assert (again.evaluated, again.known, again.digest) == (0, 30, found.digest)
    assert {run.id: run.manifest().verdict for run in Store(many).runs()} == before


@pytest.mark.usefixtures("forked")
def test_a_ledger_that_was_cut_short_is_finished_and_equal(many: Path, tmp_path: Path) -> None:
    question = question_for(tmp_path)
    whole = ask_of_runs(many, question, Where(), Means(2))
    lines = whole.ledger.read_bytes()
    whole.ledger.write_bytes(lines[: len(lines) // 2])
    rest = ask_of_runs(many, question, Where(), Means(2))
    assert 10 < rest.evaluated < 20
    assert (rest.digest, rest.twice) == (whole.digest, 0)
    other = ask_of_runs(many, replace(question, recipe=b"y"), Where(serial="U3"), Means(2))
    assert (other.ledger == whole.ledger, other.evaluated) == (False, 1)


@pytest.mark.usefixtures("forked")
def test_a_run_whose_processes_always_die_is_left_out_with_its_reason(many: Path) -> None:
    found = ask_of_runs(many, Question(b"x"), where_of(["serial=U3", "until=2026-02-12"]), Means(2))
    assert list(found.failed.values()) == ["its process ended 3 times without an answer"]
    assert (found.died, found.lines) == (3, [])


def test_limits_are_one_statement_with_a_ledger_like_any_other(golden_run: Any, tmp_path: Path) -> None:
    data = golden_run.copy(tmp_path / "runs").parent
    words = ("reevaluate", "--limits", "torque_ratio_slope max=1.0", "--data", str(data))
    told = here(*words, "--json")
    assert told.exit_code == 0, told
    assert told.json["changes"] == [{"before": "NOT DECIDABLE", "after": "FAIL", "runs": 1}]
    assert [one["serial"] for one in told.json["flips"]] == ["R"]
    assert "is beyond max 1" in told.json["flips"][0]["reasons"][0]
    again = here(*words)
    assert [text in again.out for text in ("0 evaluated", "1 known before", "1 verdict would be another one")] == [
        True
    ] * 3
    rows = list(csv.reader(io.StringIO(here(*words, "--csv").out)))
    assert (len(rows), rows[1][4]) == (2, "yes")
    assert {path.suffix for path in (data / FOLDER).iterdir()} == {".jsonl", ".txt", ".lock"}


def test_the_command_evaluates_real_runs_in_processes_of_its_own(folder: Path, stricter: Path) -> None:
    told = here(
        "reevaluate", "--recipe", str(stricter), "--archive", "--workers", "1", "--data", str(folder / "good"), "--json"
    )
    assert told.exit_code == 0, told
    assert told.json["changes"] == [{"before": "PASS", "after": "FAIL", "runs": 1}]
    assert Store(folder / "good").find("last").manifest().verdict == "PASS"


def test_what_an_evaluation_loads_is_there_before_a_process_is_forked() -> None:
    """Else each process, and each one in its place, would load it again."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["station.reevaluation.forked"])
    code = f"import os, sys; os._exit(len(set({LOADED_AHEAD}) - set(sys.modules)))"
    process = context.Process(target=exec, args=(code,))
    process.start()
    process.join()
    assert process.exitcode == 0


def test_a_metric_without_a_limit_flips_nothing(folder: Path) -> None:
    """It says a value; that the run would not pass by it alone is no other verdict."""
    words = ("reevaluate", "--metric", METRICS[1], "--archive", "--workers", "1", "--data", str(folder / "good"))
    told = here(*words, "--json")
    assert told.json["changes"] == [{"before": "PASS", "after": "NOT DECIDABLE", "runs": 1}]
    assert told.json["flips"] == []
    shown = here(*words).out
    assert ("no limit was asked for" in shown, "flip" in shown) == (True, False)


REFUSED = {
    "nothing is asked": ((), "--recipe, --metric, --preset or --limits"),
    "limits of nothing": (("--limits", "lost_motion"), "a metric and its new limits"),
    "a limit that is no number": (("--limits", "lost_motion max=wide"), "a number"),
    "an option that is none": (("--limits", "lost_motion upper=1"), "(min, max, guard, branch)"),
    "two questions": (("--limits", "lost_motion max=1", "--preset", "nabtesco"), "cannot be combined"),
    "a condition that is none": (("--preset", "nabtesco", "--where", "colour=red"), "allowed is NAME=VALUE"),
    "a date that is none": (("--preset", "nabtesco", "--where", "since=monday"), "a date"),
    "a preset that is none": (("--preset", "nobody"), "allowed are"),
    "no run fits": (("--preset", "nabtesco", "--where", "model=none"), "no complete run fits"),
    "no archive": (("--preset", "nabtesco", "--archive"), "archive.yaml"),
    "a cluster without an archive": (("--preset", "nabtesco", "--cluster", "local"), "archive.yaml"),
    "limits by a serial number": (
        ("--limits", "lost_motion max=1", "--where", "serial=U1"),
        "cannot be used together with --limits",
    ),
}


def test_what_cannot_be_asked_is_refused(many: Path) -> None:
    for case, (words, told) in REFUSED.items():
        refused = here("reevaluate", *words, "--data", str(many))
        assert (refused.exit_code, told in refused.err) == (2, True), (case, refused)


def test_a_cluster_without_a_token_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"):
        monkeypatch.delenv(name, raising=False)
    told = here("reevaluate", "--preset", "nabtesco", "--cluster", "local", "--data", str(folder / "good"))
    assert (told.exit_code, "no token is set" in told.err) == (2, True), told
