"""How a bench was left: by its own last run, whatever other benches and simulated runs did since."""

from __future__ import annotations

import dataclasses
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from ended_runs import bench_of, cancelled, ended, recovered, refused

from station.documents.manifest import Setup
from station.records.chain.entries import entry_of, signed_entry
from station.records.chain.keys import BenchKey
from station.records.clocks import VIRTUAL
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.run.way_back.begins_at import recovery_begins_at
from station.run.way_back.last_run import last_run_of, why_not_free
from station.web.bench.way_back import WayBack


def job_of(name: str, sha256: str = "b" * 64) -> SimpleNamespace:
    bench = SimpleNamespace(bench=SimpleNamespace(name=name, embedded=False))
    return SimpleNamespace(bench=bench, bench_source=SimpleNamespace(sha256=sha256))


@pytest.mark.parametrize("others", [0, 3, 120])
def test_a_bench_left_wound_up_is_not_free_by_the_runs_of_another_bench(tmp_path: Path, others: int) -> None:
    ended(tmp_path, "SN-1", setup=bench_of("bench-3"))
    fault = ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    for number in range(others):
        ended(tmp_path, f"W-{number}", setup=bench_of("bench-3", "c" * 64, embedded=True))
    last = last_run_of(tmp_path, job_of("bench-3"))
    assert last.id == fault
    assert "Do it." in why_not_free(tmp_path, last, "Do it.")
    last = last_run_of(tmp_path, job_of("bench-3", "d" * 64))
    assert last.id == fault, "the file of the bench was changed since"
    assert last_run_of(tmp_path, job_of("bench-4", "e" * 64)) is None
    ended(tmp_path, "SN-2", setup=bench_of("bench-3"))
    assert why_not_free(tmp_path, last_run_of(tmp_path, job_of("bench-3")), "Do it.") == ""


def test_the_page_recovers_each_bench_that_a_fault_left_the_newest_first(tmp_path: Path) -> None:
    way_back = WayBack(tmp_path)
    assert way_back.standing().why_none == "No run was made yet."
    first = ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    second = ended(tmp_path, "SN-1", None, "interrupted", bench_of("bench-4"))
    ended(tmp_path, "W-1", None, "fault", bench_of("bench-5", embedded=True))
    assert way_back.standing().fault.run == second
    recovered(tmp_path, second, bench_of("bench-4"))
    assert (way_back.standing().fault.run, way_back.standing().released) == (second, True), (
        "its unit is to be taken out"
    )
    ended(tmp_path, "SN-2", setup=bench_of("bench-4"))
    assert (way_back.standing().fault.run, way_back.standing().released) == (first, False)
    recovered(tmp_path, first, bench_of("bench-3"))
    ended(tmp_path, "SN-3", setup=bench_of("bench-4"))
    assert way_back.standing().fault is None


@pytest.mark.parametrize("others", [0, 120])
@pytest.mark.parametrize("after", [(cancelled,), (refused,), (refused, cancelled, refused)])
def test_a_start_that_changed_nothing_leaves_a_bench_as_the_run_before(
    tmp_path: Path, after: tuple[Callable[..., str], ...], others: int
) -> None:
    """A start that was cancelled freed a bench with a wound-up unit; one that was refused blocked a bench in order."""
    way_back = WayBack(tmp_path)

    def then() -> tuple[str | None, str]:
        for start in after:
            start(tmp_path, "SN-9", bench_of("bench-3"))
        for number in range(others):
            ended(tmp_path, f"W-{number}", setup=bench_of("bench-4", "c" * 64))
        last = last_run_of(tmp_path, job_of("bench-3"))
        return (None, "") if last is None else (last.id, why_not_free(tmp_path, last, "Do it."))

    assert then() == (None, "")
    well = ended(tmp_path, "SN-1", setup=bench_of("bench-3"))
    assert then() == (well, "")
    assert way_back.standing().fault is None
    fault = ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    run, why = then()
    assert (run, "Do it." in why) == (fault, True)
    if not others:
        assert way_back.standing().fault.run == fault
    recovered(tmp_path, fault, bench_of("bench-3"))
    assert then() == (fault, "")


@pytest.mark.parametrize(("to", "lock", "free"), [
    (("home", "stopped"), "closed", False), (("home", "stopped"), "open", True), (("stopped",), "open", True),
])  # fmt: skip
def test_a_run_that_was_stopped_frees_its_bench_with_the_lock_open_only(
    tmp_path: Path, to: tuple[str, ...], lock: str, *, free: bool
) -> None:
    stopped = cancelled(tmp_path, "SN-1", bench_of("bench-3"), to=to, lock=lock)
    last = last_run_of(tmp_path, job_of("bench-3"))
    assert (last is None) == (to == ("stopped",))
    assert last is None or (why_not_free(tmp_path, last, "Do it.") == "") == free
    events = tmp_path / stopped / "events.jsonl"
    events.write_bytes(events.read_bytes().replace(b'"home"', b'"stopped"') + b"\n")
    last = last_run_of(tmp_path, job_of("bench-3"))
    assert "Do it." in why_not_free(tmp_path, last, "Do it."), "an altered record proves nothing"


def test_a_recovery_whose_record_was_altered_frees_no_bench(tmp_path: Path) -> None:
    fault = ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    recovered(tmp_path, fault, bench_of("bench-3"), lock="closed")
    last = last_run_of(tmp_path, job_of("bench-3"))
    assert "Do it." in why_not_free(tmp_path, last, "Do it.")
    (result,) = tmp_path.glob("recoveries/*/result.json")
    result.write_bytes(result.read_bytes().replace(b'"closed"', b'"open"'))
    assert "Do it." in why_not_free(tmp_path, last, "Do it.")
    assert not WayBack(tmp_path).standing().released
    recovered(tmp_path, fault, bench_of("bench-3"))
    assert why_not_free(tmp_path, last, "Do it.") == ""


def test_starts_that_changed_nothing_hide_no_bench_from_the_page(tmp_path: Path) -> None:
    fault = ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    for number in range(25):
        refused(tmp_path, f"SN-{number}", bench_of("bench-3"))
    assert WayBack(tmp_path).standing().fault.run == fault


def simulated(name: str, sha256: str = "b" * 64) -> Setup:
    """A run in virtual time, to which a real bench was named."""
    return dataclasses.replace(bench_of(name, sha256), clock=VIRTUAL)


@pytest.mark.parametrize("others", [0, 120])
def test_a_run_in_virtual_time_says_nothing_of_the_bench_that_it_names(tmp_path: Path, others: int) -> None:
    fault = ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    told = tmp_path / ended(tmp_path, "SN-1", setup=simulated("bench-3"))
    for number in range(others):
        ended(tmp_path, f"W-{number}", setup=bench_of("bench-4", "c" * 64))
    assert last_run_of(tmp_path, job_of("bench-3")).id == fault, "the real bench is still wound up"
    ended(tmp_path, "SN-2", setup=bench_of("bench-3"))
    ended(tmp_path, "SN-3", None, "fault", simulated("bench-3"))
    assert why_not_free(tmp_path, last_run_of(tmp_path, job_of("bench-3")), "Do it.") == ""
    if not others:
        assert WayBack(tmp_path).standing().fault is None
    (told / "run.json").write_bytes((told / "run.json").read_bytes() + b" ")
    assert last_run_of(tmp_path, job_of("bench-3")).id > told.name


@pytest.mark.parametrize("others", [0, 120])
def test_what_says_falsely_that_it_was_in_virtual_time_does_not_free_a_bench(tmp_path: Path, others: int) -> None:
    ended(tmp_path, "SN-1", setup=bench_of("bench-3"))
    fault = tmp_path / ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    for number in range(others):
        ended(tmp_path, f"W-{number}", setup=bench_of("bench-4", "c" * 64))
    manifest = fault / "run.json"
    manifest.write_bytes(re.sub(rb'"clock": *"[a-z]+"', b'"clock": "virtual"', manifest.read_bytes()))
    assert RunRecord(fault).manifest().clock == VIRTUAL
    assert last_run_of(tmp_path, job_of("bench-3")).id == fault.name
    if not others:
        assert recovery_begins_at(tmp_path).id == fault.name


def test_an_altered_or_lost_record_does_not_free_a_bench(tmp_path: Path) -> None:
    fault = tmp_path / ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    manifest = fault / "run.json"
    manifest.write_bytes(manifest.read_bytes().replace(b'"fault"', b'"complete"'))
    assert "ended with 'fault'" in why_not_free(tmp_path, last_run_of(tmp_path, job_of("bench-3")), "Do it.")
    manifest.unlink()
    assert "cannot be read" in why_not_free(tmp_path, last_run_of(tmp_path, job_of("bench-3")), "Do it.")
    ended(tmp_path, "SN-2", setup=bench_of("bench-3"))
    assert why_not_free(tmp_path, last_run_of(tmp_path, job_of("bench-3")), "Do it.") == ""
    shutil.rmtree(tmp_path / last_run_of(tmp_path, job_of("bench-3")).id)
    assert why_not_free(tmp_path, last_run_of(tmp_path, job_of("bench-3")), "Do it.") == "", "by the word of the chain"
    shutil.rmtree(tmp_path / Store(tmp_path).create("SN-3", bench_of("bench-3"), {}).id)
    assert "cannot be read" in why_not_free(tmp_path, last_run_of(tmp_path, job_of("bench-3")), "Do it.")


@pytest.mark.parametrize("others", [0, 120])
def test_a_folder_that_the_chain_does_not_know_frees_no_bench(tmp_path: Path, others: int) -> None:
    well = ended(tmp_path, "SN-1", setup=bench_of("bench-3"))
    for number in range(others):
        ended(tmp_path, f"W-{number}", setup=bench_of("bench-4", "c" * 64))
    fault = ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    copied = tmp_path / f"9{fault[1:]}"
    shutil.copytree(tmp_path / well, copied)
    assert last_run_of(tmp_path, job_of("bench-3")).id == fault, "a copy of a run that ended well"
    text = (copied / "run.json").read_text(encoding="utf-8").replace(well, copied.name)
    (copied / "run.json").write_text(re.sub(r'"chain": *\{[^}]*\}', '"chain": null', text), encoding="utf-8")
    assert RunRecord(copied).manifest().id == copied.name
    assert last_run_of(tmp_path, job_of("bench-3")).id == fault, "one that says to be another run"
    shutil.rmtree(copied)
    shutil.copytree(tmp_path / fault, copied)
    again = ended(tmp_path, "SN-2", setup=bench_of("bench-3"))
    assert last_run_of(tmp_path, job_of("bench-3")).id == copied.name > again, "what speaks against a bench counts"


def test_a_run_that_only_its_own_file_calls_ended_has_not(tmp_path: Path) -> None:
    record = Store(tmp_path).create("SN-1", bench_of("bench-3"), {})
    manifest = record.folder / "run.json"
    manifest.write_bytes(manifest.read_bytes().replace(b'"recording"', b'"complete"'))
    assert record.manifest().state == "complete"
    assert "ended with 'not concluded'" in why_not_free(tmp_path, last_run_of(tmp_path, job_of("bench-3")), "Do it.")


def test_a_line_of_a_foreign_key_frees_no_bench(tmp_path: Path) -> None:
    fault = ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    for number in range(120):
        ended(tmp_path, f"W-{number}", setup=bench_of("bench-4", "c" * 64))
    other = ended(tmp_path, "W-1", setup=bench_of("bench-4", "c" * 64))
    path = tmp_path / "chain.jsonl"
    last = entry_of(path.read_bytes().splitlines()[-1])
    words = {"run": other, "serial": "W-1", "attempt": 9, "recipe": "a", "bench": "b" * 64}
    forged = signed_entry(
        "created", last.counter + 1, last.sha256, "2026", BenchKey(Ed25519PrivateKey.generate()), **words
    )
    with path.open("ab") as file:
        file.write(forged.line + b"\n")
    assert last_run_of(tmp_path, job_of("bench-3")).id == fault
