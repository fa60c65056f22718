"""Rules of retention: what they remove is in a backup, has its signed line, and is told apart from what is missing."""

from __future__ import annotations

import json
import shutil
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from older_store import to_version_0005
from station_samples import SETUP
from stored_runs import START, metric, store_run

import station.atomic_file
from recipes import RecipeError
from station.errors import StationError
from station.records.backup import back_up, backed_up, restore
from station.records.certificate_code import GENUINE, check_code, code_of
from station.records.chain.chain_file import CHAIN
from station.records.chain.walk import Trust
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import fingerprint
from station.records.traces import FOLDER
from station.records.verify import verify_folder
from station.store import outbox
from station.store.engines import IN_MEMORY
from station.store.plant.removals import removals, removals_now
from station.store.retention import _trace_of, apply, load_rules, plan
from station.store.run_search import MISSING, search
from station.store.stored_runs import Wanted
from station.store.table_counts import all_rows
from station.store.view import look_at, opened
from station.web.people import audit
from station.web.people.database import StationDatabase

RULES = """
rules:
  - {id: good, class: virtual, verdict: PASS, keep_days: 30, then: nothing}
  - {id: bad, class: virtual, verdict: FAIL, keep_days: 90, then: nothing}
  - {id: injected, class: injected, keep_days: 1, then: nothing}
"""
LATER = START + timedelta(days=60)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Two good units, a bad one, one with injected faults, one that was not concluded, and the newest of the bench."""
    folder = tmp_path / "runs"
    store_run(folder, "GOOD-1", [metric(0.4)])
    store_run(folder, "GOOD-2", [metric(0.4)])
    store_run(folder, "BAD-1", [metric(0.4)], failed="too wide")
    store_run(folder, "GOOD-1", [metric(0.4)], scenario="s")
    store_run(folder, "GOOD-1", [metric(0.4)], day=59.0)
    Store(folder).create("OPEN", SETUP, {})
    store_run(folder, "LAST", [metric(0.4)], day=59.0)
    (folder / "retention.yaml").write_text(RULES, encoding="utf-8")
    database = StationDatabase(folder)
    with database.writing() as connection:
        audit.write(connection, "admin", "enter", audit.DONE, {})
    database.close()
    return folder


def planned(data: Path) -> dict[tuple[str, str], str]:
    return {(one.serial, one.rule): one.why_not for one in plan(data, load_rules(data), LATER)}


def test_the_first_rule_that_fits_counts_and_what_the_next_start_is_judged_by_stays(data: Path) -> None:
    found = planned(data)
    assert found == {
        ("GOOD-1", "good"): "",
        ("GOOD-2", "good"): "this is the newest run of its bench or of its serial number",
        ("GOOD-1", "injected"): "",
    }, "the bad unit has days left, and what was not concluded is of no rule's verdict"
    bad = next(run for run in Store(data).runs() if run.serial() == "GOOD-1")
    (bad.folder / "result.json").write_text("{}", encoding="utf-8")
    assert planned(data)["GOOD-1", "good"].startswith("the run has changed")


def test_nothing_goes_that_is_not_in_the_backup_as_it_is(data: Path) -> None:
    files = dict.fromkeys((path.relative_to(data).as_posix() for path in data.rglob("*")), "0" * 64)
    for backup in ({}, files):
        done = apply(data, plan(data, load_rules(data), LATER), backup, "A. Tester")
        assert not done.removed
        assert all(one.why_not for one in done.kept)
    assert len(Store(data).runs()) == 7


def test_a_run_whose_folder_is_a_link_stays_and_has_no_line(data: Path, tmp_path: Path) -> None:
    linked = next(run for run in Store(data).runs() if run.serial() == "GOOD-1")
    linked.folder.rename(tmp_path / linked.id)
    linked.folder.symlink_to(tmp_path / linked.id)
    files = {path.relative_to(data).as_posix(): fingerprint(path).sha256 for path in linked.folder.iterdir()}
    before = (data / CHAIN).read_bytes()
    only = tuple(one for one in plan(data, load_rules(data), LATER) if one.run == linked.id)
    done = apply(data, only, files, "A. Tester")
    assert ([one.run for one in done.kept], done.removed) == ([linked.id], ())
    assert (data / CHAIN).read_bytes() == before


def test_what_was_removed_is_named_and_a_restore_brings_it_all_back(data: Path, tmp_path: Path) -> None:
    file = tmp_path / "backup.tar"
    for run in Store(data).runs():  # a backup is not made while a run is open
        if run.serial() == "OPEN":
            run.update(state="interrupted")
    back_up(data, file)
    verdicts = {run.id: run.manifest().verdict for run in Store(data).runs()}
    gone = next(run for run in Store(data).runs() if run.serial() == "GOOD-1")
    code = code_of(gone)
    done = apply(data, plan(data, load_rules(data), LATER), backed_up(file), "A. Tester")
    assert [one.serial for one in done.removed] == ["GOOD-1", "GOOD-1"]
    found = verify_folder(data)
    assert (found.removed, [one.kind for one in found.problems if one.run == gone.id]) == (2, [])
    assert "removed" in (data / CHAIN).read_text(encoding="utf-8").splitlines()[-1]
    (row,) = [one for one in search(data, Wanted(serial="GOOD-1")).rows if one.run == gone.id]
    assert "retention rule good" in row.altered
    assert row.verdict is None
    assert (check_code(data, code).standing, check_code(data, code).verdict) == (GENUINE, "PASS")
    assert check_code(data, code.lower()).standing == GENUINE, "the chain alone knows how it is written"
    missing = next(run for run in Store(data).runs() if run.serial() == "BAD-1")
    shutil.rmtree(missing.folder)
    assert [one.run for one in verify_folder(data).problems if one.kind == "missing"] == [missing.id]
    assert MISSING in {one.altered for one in search(data, Wanted(serial="BAD-1")).rows}
    shutil.rmtree(data)
    restore(file, data)
    assert {run.id: run.manifest().verdict for run in Store(data).runs()} == verdicts
    assert check_code(data, code).standing == GENUINE


def test_a_store_of_an_older_version_learns_of_the_runs_that_were_removed_before(data: Path, tmp_path: Path) -> None:
    for run in Store(data).runs():
        if run.serial() == "OPEN":
            run.update(state="interrupted")
    back_up(data, tmp_path / "b.tar")
    done = apply(data, plan(data, load_rules(data), LATER), backed_up(tmp_path / "b.tar"), "A. Tester")
    removed = {one.run: one.rule for one in done.removed}
    with look_at(data) as view, view.database.reading() as connection:
        assert removals(connection, view.chain, view.trust) == removed
        assert {run: line.fields["rule"] for run, line in view.chain.removed().items()} == removed
        assert removals(connection, view.chain, Trust(frozenset({"a key that nobody trusts"}))) == {}
        assert not {problem.run for problem in view.problems} & removed.keys()
        assert not set(view.missing) & removed.keys()
        rows = all_rows(view.database, view.chain)
    database = opened(data)
    with database.writing() as connection:
        to_version_0005(connection)
    database.close()
    with look_at(data) as view:
        assert view.database.place.url != IN_MEMORY
        assert all_rows(view.database, view.chain) == rows
        assert not set(view.missing) & removed.keys()
        assert removals_now(connection, view.chain, view.trust, [*removed], 1) == removed


def test_many_runs_that_were_removed_at_once_are_all_known_at_the_next_look(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their lines are the end of the chain, and conclude no run."""
    for number in range(6):
        store_run(data, "MORE", [metric(0.4)], day=float(number))
    with look_at(data) as view:
        assert not view.missing
    next(run for run in Store(data).runs() if run.serial() == "OPEN").update(state="interrupted")
    back_up(data, tmp_path / "b.tar")
    monkeypatch.setattr(outbox, "BATCH", 1)
    done = apply(data, plan(data, load_rules(data), LATER), backed_up(tmp_path / "b.tar"), "A. Tester")
    assert len(done.removed) > 2 * outbox.BATCH
    found = search(data, Wanted())
    assert (found.behind, {one.altered for one in found.rows} & {MISSING}) == (0, set())
    with look_at(data) as view:
        assert not view.missing


def test_a_removal_that_was_cut_short_is_no_problem_and_is_finished_by_the_next(data: Path, tmp_path: Path) -> None:
    for run in Store(data).runs():
        if run.serial() == "OPEN":
            run.update(state="interrupted")
    back_up(data, tmp_path / "b.tar")
    kept = tmp_path / "kept"
    first = plan(data, load_rules(data), LATER)[0]
    shutil.copytree(data / first.run, kept)
    apply(data, [first], backed_up(tmp_path / "b.tar"), "A. Tester")
    shutil.copytree(kept, data / first.run)  # killed behind the line and before the files were gone
    before = {one.kind for one in verify_folder(data).problems}
    assert not before & {"missing", "not_in_chain"}
    again = apply(data, plan(data, load_rules(data), LATER), backed_up(tmp_path / "b.tar"), "A. Tester")
    assert first.run in [one.run for one in again.removed]


def test_a_trace_keeps_a_file_however_large(quick_run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def too_large(*_: Any) -> bytes:
        raise OSError

    run = RunRecord(quick_run.copy(tmp_path / "runs"))
    run.update(state="stopped")
    monkeypatch.setattr(station.atomic_file, "document_bytes", too_large)
    assert "run.json" in _trace_of(run)


def test_a_trace_keeps_result_and_loop_and_is_checked(worn_run: Any, tmp_path: Path) -> None:
    data, file = tmp_path / "runs", tmp_path / "backup.tar"
    shutil.copytree(worn_run.data, data)
    worn = Store(data).newest(1)[0]
    serial = worn.serial() or ""
    store_run(data, serial, [metric(0.4)], day=3000.0)
    store_run(data, "NEXT", [metric(0.4)], day=3000.0)
    (data / "retention.yaml").write_text("rules:\n  - {id: all, keep_days: 1, then: trace}\n", encoding="utf-8")
    back_up(data, file)
    later = START + timedelta(days=4000)
    one = next(row for row in plan(data, load_rules(data), later) if row.run == worn.id)
    if one.why_not:  # the bench of a stored run has another name
        one = one._replace(why_not="")
    done = apply(data, [one], backed_up(file), "A. Tester")
    assert [row.run for row in done.removed] == [worn.id]
    trace = data / FOLDER / worn.id
    assert {path.name for path in trace.iterdir()} >= {"run.json", "result.json", "loop.csv"}
    assert json.loads((trace / "result.json").read_bytes())["verdict"] == "FAIL"
    assert "trace" not in {problem.kind for problem in verify_folder(data).problems}
    told = {row.run: row for row in Store(data).attempts_of(serial)}[worn.id]
    assert (told.verdict, told.aside, bool(told.failed)) == ("FAIL", "simulated", True)
    (trace / "loop.csv").write_text("other", encoding="utf-8")
    assert [problem.run for problem in verify_folder(data).problems if problem.kind == "trace"] == [worn.id]


def test_the_commands_tell_the_plan_and_write_into_the_audit_trail(data: Path, tmp_path: Path) -> None:
    rules = tmp_path / "rules.yaml"
    rules.write_text("rules:\n  - {id: old, keep_days: 1, then: nothing}\n", encoding="utf-8")
    for run in Store(data).runs():
        if run.serial() == "OPEN":
            run.update(state="interrupted")
    told = here("retention", "plan", "--rules", str(rules), "--data", str(data), "--json")
    assert told.exit_code == 0, told.err
    assert len(Store(data).runs()) == 7, "nothing was removed"
    back_up(data, tmp_path / "b.tar")
    words = ("--rules", str(rules), "--backup", str(tmp_path / "b.tar"), "--operator", "A. Tester", "--data", str(data))
    done = here("retention", "apply", *words, "--json")
    assert done.exit_code == 1, "some stay: the newest"
    removed = [one["run"] for one in done.json["removed"]]
    assert removed == [one["run"] for one in told.json["runs"] if not one["why_not"]]
    database = StationDatabase(data)
    with database.reading() as connection:
        assert audit.problems_of(connection) == []
        lines = [line for line in audit.lines_of(connection, 50) if line.action == "retention"]
    database.close()
    assert sorted(json.loads(line.detail)["run"] for line in lines) == sorted(removed)
    assert {line.name for line in lines} == {"A. Tester"}


@pytest.mark.parametrize(
    "text",
    [
        "rules: []\n",
        "rules:\n  - {id: a, keep_days: 0, then: nothing}\n",
        "rules:\n  - {id: a, keep_days: 1, then: all}\n",
        "rules:\n  - {id: a, class: prototype, keep_days: 1, then: trace}\n",
        "rules:\n  - {id: a, keep_days: 1, then: trace}\n  - {id: a, keep_days: 2, then: trace}\n",
    ],
)
def test_rules_that_cannot_be_meant_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "retention.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(RecipeError):
        load_rules(tmp_path)


def test_without_rules_nothing_is_planned(tmp_path: Path) -> None:
    with pytest.raises(StationError, match=r"retention\.yaml"):
        load_rules(tmp_path)
