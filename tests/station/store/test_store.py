"""The store: the same answers as the run folders give, on SQLite and PostgreSQL, whatever happens in between."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from sqlalchemy import Connection, inspect, text
from station_samples import SETUP
from stored_runs import ASK, BENCH_TEXT, metric, recipe_text, rows_in, store_lot, store_run

import station.store.migrations.versions
from analysis.trace.errors import AnalysisError
from station.atomic_file import seen_text
from station.cli.line.stored_metric import Ask
from station.cli.line.stored_values import stored_values
from station.cli.runs.list_runs import NEWEST, list_rows
from station.quality.dfq.write import dfq_of_lot
from station.quality.figures import capability_of, causes_of, trend_of, yield_of
from station.records.begun_by import BEGUN
from station.records.chain.chain_file import CHAIN, CREATED_MANIFEST, Chain
from station.records.data_folder import Store
from station.records.revisions.revision import hash_of
from station.records.run_record import RunRecord
from station.records.seal import sealed_names
from station.run.run_list import row
from station.store import outbox, tables
from station.store import view as view_of
from station.store.engine import HEAD, VERSIONS, Database, StoreError, upgrade
from station.store.outbox import catch_up, rebuild, remove_runs
from station.store.places import STORE_URL, StorePlace, store_place
from station.store.plant.months import is_partition
from station.store.quality import lot as lot_of
from station.store.quality.counts import GROUPINGS, Verdicts
from station.store.quality.guard_bands import GuardBands
from station.store.quality.lot import Lot, production
from station.store.quality.trial import Rule, flipped, flips
from station.store.quality.values import characteristic
from station.store.rows.projection import remove_chain, seen_files
from station.store.table_counts import all_rows, counts
from station.store.view import bring_up, look_at, opened

LINE = {
    "slope": 100.5,
    "offset_nm": -13.0,
    "u_slope": 0.1,
    "u_offset_nm": 0.2,
    "correlation": -0.8,
    "residual_sd_nm": 0.3,
}
RATIO = {"model": "RV", "made": "then", "quadrants": {"load_positive": LINE | {"residual_sd_nm": 0.3, "points": 7}}}


@pytest.fixture
def lot(tmp_path: Path, store_url: str | None) -> Path:
    del store_url
    data = store_lot(tmp_path / "runs")
    store_run(data, "C", [metric(0.4)], calibration=RATIO)
    recipe = replace(SETUP.recipe, name="inverse", sha256=hash_of(recipe_text("inverse", 9)))
    files = {"recipe.yaml": recipe_text("inverse", 9), "bench.yaml": BENCH_TEXT}
    Store(data).create("open", replace(SETUP, recipe=recipe, bench=replace(SETUP.bench, sha256="1")), files)
    return data


def numbers(rows: dict[str, list[tuple[Any, ...]]]) -> dict[str, int]:
    return {name: len(found) for name, found in rows.items()}


def test_every_table_has_what_the_folders_say(lot: Path) -> None:
    with look_at(lot) as view:
        found = counts(view.database, view.chain)
        assert view.problems == []
        assert view.runs == [run.id for run in Store(lot).runs()]
    assert found == {
        "alarms": 0, "archived": 0, "attempts": 12, "benches": 1, "calibrations": 1, "cause_hours": 1,
        "checks": 0, "meanings": 1, "metric_hours": 12,
        "metrics": 20, "projections": 1, "recipes": 3, "removals": 0, "run_hours": 9, "runs": 11, "units": 10,
    }  # fmt: skip


def test_a_rebuild_gives_equal_rows(lot: Path) -> None:
    before = rows_in(lot)
    database = opened(lot)
    rebuild(database, Chain(lot))
    database.close()
    assert rows_in(lot) == before
    ran = here("store", "rebuild", "--data", str(lot), "--json")
    assert ran.json["rows"] == {name: len(rows) for name, rows in before.items()}
    assert rows_in(lot) == before


def test_runs_that_came_one_by_one_give_the_rows_that_a_rebuild_gives(tmp_path: Path, store_url: str | None) -> None:
    del store_url
    data = tmp_path / "runs"
    for number in range(5):
        store_run(data, f"S{number % 2}", [metric(0.1 * number)])
        bring_up(data, 10.0)
    before = rows_in(data)
    database = opened(data)
    rebuild(database, Chain(data))
    assert all_rows(database, Chain(data)) == before
    database.close()


def test_values_are_stored_to_the_last_bit(tmp_path: Path, store_url: str | None) -> None:
    del store_url
    values = [0.1 + 0.2, 1e-300, -2.5e17, 123456789.123456789]
    for number, value in enumerate(values):
        store_run(tmp_path, f"S{number}", [metric(value)])
    found = [one.value for one in stored_values(tmp_path, Ask("lost_motion")).values]
    assert [value.hex() for value in found] == [value.hex() for value in values]


def test_the_list_from_the_store_is_the_one_from_the_folders(lot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    live = [row(run) for run in Store(lot).runs()]
    monkeypatch.setattr("station.cli.runs.list_runs.NEWEST", 1)
    with look_at(lot) as view:
        assert list_rows(view, view.runs) == live


def test_a_list_is_as_long_as_is_asked_for(lot: Path) -> None:
    ran = here("list", "--data", str(lot), "--limit", "3", "--json")
    assert [one["run"] for one in ran.json] == [run.id for run in Store(lot).runs()][-3:]
    assert "9 older runs are not shown" in ran.err
    assert len(here("list", "--data", str(lot), "--all", "--json").json) == 12
    assert NEWEST >= 10


def test_a_run_that_was_begun_and_left_is_no_missing_one(lot: Path) -> None:
    folder = Store(lot).create("LEFT", SETUP, {}).folder
    (folder / "run.json").rename(folder / CREATED_MANIFEST)
    listed, shown = here("list", "--data", str(lot)), here("show", folder.name, "--data", str(lot))
    states = {one["run"]: one["state"] for one in here("list", "--data", str(lot), "--json").json}
    assert states[folder.name] == BEGUN
    assert f"lostmotion conclude {folder.name}" in shown.err
    assert f"lostmotion conclude {folder.name}" in listed.out
    sealed = Store(lot).newest(1)[0].folder
    (sealed / "run.json").rename(sealed / CREATED_MANIFEST)
    states = {one["run"]: one["state"] for one in here("list", "--data", str(lot), "--json").json}
    assert states[sealed.name] == "missing", "somebody hides what was deleted"


DEEDS: dict[str, tuple[Callable[[Path], object], str]] = {
    "delete": (shutil.rmtree, "missing"),
    "copy": (lambda run: shutil.copytree(run, run.with_name("20300101T000000.000Z-U0")), "copied"),
    "rename": (lambda run: run.rename(run.with_name("20300101T000000.000Z-U0")), "renamed"),
    "edit run.json": (lambda run: RunRecord(run).update(verdict="FAIL"), "altered"),
    "edit the result": (lambda run: (run / "result.json").write_text("{}"), "altered"),
    "damage run.json": (lambda run: (run / "run.json").write_text("{"), "altered"),
    "take run.json away": (lambda run: (run / "run.json").unlink(), "missing"),
}


@pytest.mark.parametrize("deed", DEEDS)
def test_the_list_and_the_statistics_name_what_was_done(lot: Path, deed: str) -> None:
    act, kind = DEEDS[deed]
    assert len(stored_values(lot, ASK).values) == 7
    act(Store(lot).runs()[0].folder)
    with look_at(lot) as view:
        assert kind in {problem.kind for problem in view.problems}
        rows = {one.run: one.verdict for one in list_rows(view, view.runs)}
    assert rows[min(rows)] in ((None, "PASS") if deed == "copy" else (None,))
    said = here("list", "--data", str(lot)).out
    assert "PROBLEM" in said
    assert "lostmotion verify" in said
    found = stored_values(lot, ASK)
    assert len(found.values) == (7 if deed == "copy" else 6)
    assert {"altered", "damaged", "whose folder is missing"} & set(found.left_out)


def test_a_missing_run_is_told_by_what_a_person_looks_for_it_by(lot: Path) -> None:
    gone = Store(lot).runs()[0]
    serial, verdict = gone.manifest().serial, gone.manifest().verdict
    shutil.rmtree(gone.folder)
    with look_at(lot) as view:
        (text,) = (problem.text for problem in view.problems if problem.kind == "missing")
    assert text == f"{gone.id}: attempt 1 of {serial}, {verdict}; its folder is missing"


def test_what_is_seen_of_a_run_is_of_every_sealed_file_that_is_there(lot: Path) -> None:
    profiles = Store(lot).runs()[0].folder / "profiles"
    profiles.mkdir(exist_ok=True)
    (profiles / "drive.yaml").write_text("drive: 1\n")
    for run in Store(lot).runs():
        there = sealed_names(run)
        lines = "\n".join(f"{name}={seen_text((run.folder / name).stat())}" for name in there)
        assert seen_files(run) == hashlib.sha256(lines.encode()).hexdigest()[:32]
    assert "profiles/drive.yaml" in sealed_names(Store(lot).runs()[0])


def test_runs_that_changed_places_are_named(lot: Path) -> None:
    one, other = (run.folder for run in Store(lot).runs()[:2])
    look_at(lot).__enter__().database.close()
    one.rename(lot / "aside")
    other.rename(one)
    (lot / "aside").rename(other)
    with look_at(lot) as view:
        assert "swapped" in {problem.kind for problem in view.problems}


def test_an_edited_chain_is_named_although_the_store_knew_it(lot: Path) -> None:
    rows_in(lot)
    lines = (lot / CHAIN).read_bytes().splitlines(keepends=True)
    (lot / CHAIN).write_bytes(b"".join(lines[:3] + lines[5:]))
    for _ in range(2):
        with look_at(lot) as view:
            assert "removed_entries" in {problem.kind for problem in view.problems}
    (lot / CHAIN).write_bytes(b"".join(lines))
    with look_at(lot) as view:
        assert view.problems == []


def test_a_restored_run_counts_again(lot: Path, tmp_path: Path) -> None:
    run = Store(lot).runs()[0].folder
    before = rows_in(lot)
    shutil.move(run, tmp_path / "aside")
    assert len(stored_values(lot, ASK).values) == 6
    shutil.move(tmp_path / "aside", run)
    text_before = (run / "run.json").read_bytes()
    (run / "run.json").write_bytes(text_before.replace(b"PASS", b"FAIL"))
    assert len(stored_values(lot, ASK).values) == 6
    (run / "run.json").write_bytes(text_before)
    assert len(stored_values(lot, ASK).values) == 7
    assert numbers(rows_in(lot)) == numbers(before)


@pytest.mark.parametrize("name", ["run.json", "result.json", "recipe.yaml"])
def test_a_file_that_could_not_be_read_at_one_look_is_compared_again_at_the_next(
    lot: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(view_of, "EVERY_FILE_OF", 1)  # of the run below run.json alone is looked at
    run = Store(lot).runs()[0].folder
    before = rows_in(lot)
    os.utime(run / "run.json")
    real = os.open

    def refusing(path: Any, *args: Any, **named: Any) -> int:
        if str(path) == str(run / name):
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), path)
        return real(path, *args, **named)

    with monkeypatch.context() as patched:
        patched.setattr(os, "open", refusing)
        with look_at(lot) as view:
            assert ("altered", run.name) in {(problem.kind, problem.run) for problem in view.problems}
    with look_at(lot) as view:
        assert view.problems == []
    assert {name: len(rows) for name, rows in rows_in(lot).items()} == {
        name: len(rows) for name, rows in before.items()
    }


@pytest.mark.parametrize("away", ["folder", "runs and chain", "chain"])
def test_a_look_while_the_chain_is_away_for_a_moment_takes_nothing_out_of_the_store(
    lot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, away: str
) -> None:
    if STORE_URL not in os.environ and away == "folder":
        monkeypatch.setenv(STORE_URL, f"sqlite:///{tmp_path / 'apart.sqlite3'}")
    before, aside = rows_in(lot), tmp_path / "aside"
    if away == "folder":
        lot.rename(aside)
        lot.mkdir()
    else:
        aside.mkdir()
        for one in lot.iterdir():
            if one.name == CHAIN or (away == "runs and chain" and one.is_dir()):
                one.rename(aside / one.name)
    if away == "chain":
        os.utime(Store(lot).runs()[0].folder / "run.json")
    with look_at(lot) as view:
        assert "no_chain" in {problem.kind for problem in view.problems}
        assert len(view.missing) == (0 if away == "chain" else 12)
    if away == "folder":
        lot.rmdir()
        aside.rename(lot)
    else:
        for one in aside.iterdir():
            one.rename(lot / one.name)
    with look_at(lot) as view:
        assert view.problems == []
    assert {name: len(rows) for name, rows in rows_in(lot).items()} == {
        name: len(rows) for name, rows in before.items()
    }


def test_runs_that_are_taken_out_are_put_in_again_from_the_start_of_the_chain(lot: Path) -> None:
    before = rows_in(lot)
    with look_at(lot) as view:
        remove_runs(view.database, view.chain, view.runs)
    assert rows_in(lot) == before


def test_who_looks_while_another_process_makes_the_store_again_sees_all_runs(
    lot: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, again = stored_values(lot, ASK), opened(lot)

    def emptied_behind(module: Any, name: str) -> None:
        """Have another process begin to make the store again as soon as a look has done this."""
        done = getattr(module, name)

        def empty(*args: Any, **kwargs: Any) -> Any:
            found = done(*args, **kwargs)
            with again.writing() as connection:
                remove_chain(connection, Chain(lot).id)
            monkeypatch.setattr(module, name, done)
            return found

        monkeypatch.setattr(module, name, empty)

    for module, name in ((view_of, "_folders"), (view_of, "_compared"), (view_of, "trust_of")):
        emptied_behind(module, name)
        found = stored_values(lot, ASK)
        assert (found.values, found.left_out) == (whole.values, whole.left_out)
        emptied_behind(module, name)
        with look_at(lot) as view:
            assert view.problems == []
    with production(lot) as look:
        verdicts = yield_of(look, Lot())
    for name in ("catch_up", "trust_of"):
        emptied_behind(lot_of, name)
        with production(lot) as look:
            assert yield_of(look, Lot()) == verdicts
    again.close()


def test_a_run_that_is_concluded_during_a_look_is_no_problem_of_the_folder(
    lot: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = view_of.catch_up
    there = here("list", "--data", str(lot)).out

    def then_measured(*args: Any, **kwargs: Any) -> int:
        monkeypatch.setattr(view_of, "catch_up", read)
        left = read(*args, **kwargs)
        store_run(lot, "NEW", [metric(0.4)], day=40)
        return left

    monkeypatch.setattr(view_of, "catch_up", then_measured)
    told = here("list", "--data", str(lot)).out
    assert "PROBLEM" not in there
    assert "PROBLEM" not in told
    assert "altered" not in told
    assert "NEW" in told


def test_a_store_that_is_emptied_all_the_time_is_told(lot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox, "_is_up", lambda *_: False)
    with pytest.raises(StoreError, match="another process is making the store of runs again"), production(lot):
        pass


@pytest.mark.parametrize("torn", [60, 1])
def test_a_torn_last_line_does_not_keep_a_store_behind(lot: Path, monkeypatch: pytest.MonkeyPatch, torn: int) -> None:
    """What a power failure leaves that came while a run was concluded, found by a store that is behind."""
    monkeypatch.setattr("station.store.outbox.BATCH", 2)
    store_run(lot, "TORN", [metric(0.4)])
    content = (lot / CHAIN).read_bytes()
    assert content.rpartition(b"\n{")[2].startswith(b'"kind":"sealed"')
    (lot / CHAIN).write_bytes(content[:-torn])
    told: list[tuple[int, int]] = []

    def note(done: int, there: int) -> None:
        told.append((done, there))
        assert len(told) < 20

    database = opened(lot)
    assert catch_up(database, Chain(lot), told=note) == 0
    before = all_rows(database, Chain(lot))
    rebuild(database, Chain(lot), note)
    assert all_rows(database, Chain(lot)) == before
    database.close()
    with look_at(lot) as view:
        assert [problem.run for problem in view.problems if problem.kind == "altered"] == [Store(lot).runs()[-1].id]
    assert told[-1][0] < told[-1][1]


def test_a_batch_that_comes_no_further_is_the_last(lot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is counted wrong: nobody waits for ever for a run that does not come."""
    tries: list[int] = []

    def one_more(_: object, offset: int) -> int:
        tries.append(offset)
        assert len(tries) < 20
        return 1

    monkeypatch.setattr("station.store.outbox._ReadSoFar.sealed_behind", one_more)
    database = opened(lot)
    assert catch_up(database, Chain(lot)) == 1
    assert counts(database, Chain(lot))["runs"] == 11
    database.close()
    assert tries[-1] == tries[-2] == len((lot / CHAIN).read_bytes())


@pytest.mark.parametrize("step", range(1, 26, 2))
def test_whoever_is_killed_between_seal_and_store_loses_nothing(lot: Path, step: int) -> None:
    """Killed at each statement of the projection in turn; the next look has every run, once."""
    pid = os.fork()
    if pid == 0:
        left = step
        import sqlalchemy.engine.default as default  # noqa: PLC0415, PLR0402 - in the child alone

        honest = default.DefaultDialect.do_execute

        def call(*args: Any, **kwargs: Any) -> Any:
            nonlocal left
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            return honest(*args, **kwargs)

        default.DefaultDialect.do_execute = call  # type: ignore[method-assign]
        try:
            bring_up(lot, 10.0)
        finally:
            os._exit(0)
    os.waitpid(pid, 0)
    assert len(stored_values(lot, ASK).values) == 7
    once = rows_in(lot)
    database = opened(lot)
    rebuild(database, Chain(lot))
    database.close()
    assert rows_in(lot) == once


def test_the_migrations_make_the_tables_of_a_new_store(store_url: str | None, tmp_path: Path) -> None:
    from alembic.autogenerate import compare_metadata  # noqa: PLC0415 - for this test alone
    from alembic.migration import MigrationContext  # noqa: PLC0415

    def differences(connection: Connection) -> list[Any]:
        # Months are no tables of their own; `_as_made` compares them.
        options = {"include_name": lambda name, kind, _: kind != "table" or not is_partition(name)}
        return compare_metadata(MigrationContext.configure(connection, opts=options), tables.METADATA)

    place = StorePlace(f"sqlite:///{tmp_path / 'x'}") if store_url is None else store_place(tmp_path)
    database = Database(place)
    with database.writing() as connection:
        assert differences(connection) == []
        new = _as_made(connection)
        tables.METADATA.drop_all(connection)
        connection.execute(text(f"DROP TABLE {VERSIONS}"))
        upgrade(connection, place, None)
        assert differences(connection) == []
        assert _as_made(connection) == new
        assert MigrationContext.configure(connection).get_current_heads() == (HEAD,)
    database.close()
    folder = Path(station.store.migrations.versions.__file__).parent
    assert max(path.stem[1:5] for path in folder.glob("v*.py")) == HEAD


def _as_made(connection: Connection) -> dict[str, Any]:
    """Return all tables as the database sees them, with their keys, indexes and options."""
    look = inspect(connection)
    kinds = ["columns", "pk_constraint", "indexes"]
    if connection.dialect.name == "sqlite":
        kinds.append("table_options")  # without row ids; PostgreSQL has none to tell
    whole = [getattr(look, f"get_multi_{kind}")() for kind in kinds]
    return {name: [_shown(kind[key]) for kind in whole] for key in whole[0] if _is_made(name := str(key[1]))}


def _is_made(name: str) -> bool:
    """Whether every new store has a table; months come with the runs, of other tests too."""
    return name != VERSIONS and not (is_partition(name) and name[-1].isdecimal())


def _shown(found: Any) -> Any:
    if not isinstance(found, list):
        return str(found)
    options = [{name: str(text) for name, text in one.get("dialect_options", {}).items()} for one in found]
    return sorted(str({**one, "dialect_options": own}) for one, own in zip(found, options, strict=True))


def test_help_and_scan_load_no_database() -> None:
    import subprocess  # noqa: PLC0415
    import sys  # noqa: PLC0415

    code = "import sys; import station.cli, station.scan.scan_process; print([m for m in sys.modules if m in BAD])"
    bad = "('sqlalchemy', 'alembic', 'psycopg', 'cryptography')"
    done = subprocess.run([sys.executable, "-c", code.replace("BAD", bad)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_quality_figures_are_formed_on_both_databases(lot: Path) -> None:
    asked = Lot(recipe="inverse")
    with production(lot) as look:
        for by in GROUPINGS:
            assert yield_of(look, asked, by).whole.verdicts.first == Verdicts(passed=7, undecided=1, ended_otherwise=1)
        causes = {one.name: one.number for one in causes_of(look, asked).undecided}
        assert causes == {"ended as stopped": 1, "measurement invalid": 1}
        row = capability_of(look, asked).rows[0]
        assert row.found is not None
        assert row.found.values == 6
        with pytest.raises(AnalysisError, match="found 1"):
            trend_of(look, asked, "lost_motion", "bench")
        what = characteristic(look, asked, "lost_motion")
        simple = GuardBands.of_all(None)
        assert flips(look, asked, what, Rule(None, 0.4, None), judged=simple) == {
            ("PASS", "FAIL"): 2, ("PASS", "NOT DECIDABLE"): 1, ("PASS", "PASS"): 4,
        }  # fmt: skip
        assert [one.serial for one in flipped(look, asked, what, Rule(None, 0.4, None), 9, judged=simple)] == [
            "U7",
            "U3",
            "U1",
        ]
        assert len(dfq_of_lot(look, asked, "a test").files[0].content) > 500
