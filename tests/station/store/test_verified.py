"""What `verify` finds altered counts no more in answers of the store alone, and counts again when it is restored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from sqlalchemy import select
from stored_runs import metric, store_run

from station.records.run_record import MANIFEST, PACKED, RunRecord
from station.records.verify import verify_folder
from station.store.places import FILE
from station.store.tables import RUNS
from station.store.view import opened


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Four virtual units, all in the store."""
    for number in range(4):
        store_run(tmp_path, f"U{number}", [metric(0.4)], day=number, virtual="P1")
    assert tried(tmp_path) == 4
    return tmp_path


def tried(data: Path) -> int:
    told = here("quality", "yield", "--virtual", "--json", "--data", str(data))
    assert told.exit_code == 0, told
    return int(told.json["whole"]["first_pass"]["of"])


def altered_in_store(data: Path) -> dict[str, str]:
    database = opened(data)
    with database.reading() as connection:
        found = dict(connection.execute(select(RUNS.c.run, RUNS.c.altered)).tuples().all())
    database.close()
    return found


@pytest.mark.parametrize("words", [(), ("--quick",)])
def test_an_altered_run_counts_no_more_behind_verify_and_again_when_it_is_restored(
    data: Path, words: tuple[str, ...]
) -> None:
    file = next(data.glob("*-U1")) / "result.json"
    before = file.read_bytes()
    file.write_bytes(before.replace(b"0.4", b"0.3"))
    assert tried(data) == 4, "the store alone was asked"
    told = here("verify", "--data", str(data), *words)
    assert (told.exit_code, "NOT PASSED" in told.out) == (1, True)
    assert tried(data) == 3
    file.write_bytes(before)
    assert here("verify", "--data", str(data)).exit_code == 0
    assert tried(data) == 4


def test_a_run_whose_manifest_is_gone_is_not_forgotten(data: Path) -> None:
    lost = store_run(data, "BAD", [metric(2.0)], failed="lost_motion")
    (lost.folder / MANIFEST).unlink()
    before = here("list", "--data", str(data), "--json").json
    assert lost.id in [one["run"] for one in before]
    assert here("verify", "--data", str(data)).exit_code == 1
    assert here("list", "--data", str(data), "--json").json == before


def test_two_runs_that_have_exchanged_names_count_no_more(data: Path) -> None:
    one, other = next(data.glob("*-U1")), next(data.glob("*-U2"))
    one.rename(data / "third")
    other.rename(one)
    (data / "third").rename(other)
    assert here("verify", "--data", str(data)).exit_code == 1
    assert tried(data) == 2


def test_samples_that_were_changed_and_are_as_many_are_known_to_the_store_too(golden_run: Any, tmp_path: Path) -> None:
    run = RunRecord(golden_run.copy(tmp_path / "runs"))
    data = run.folder.parent
    here("capability", "--data", str(data))
    path = run.folder / PACKED
    bad = bytearray(path.read_bytes())
    bad[len(bad) // 2] ^= 1
    path.write_bytes(bad)
    here("capability", "--data", str(data))
    assert altered_in_store(data) == {run.id: ""}, "a look compares their size"
    assert here("verify", "--data", str(data)).exit_code == 1
    assert PACKED in altered_in_store(data)[run.id]
    here("capability", "--data", str(data))
    assert PACKED in altered_in_store(data)[run.id]
    assert PACKED not in here("verify", "--quick", "--data", str(data)).out
    assert PACKED in altered_in_store(data)[run.id], "who looked at the size alone has nothing to say of it"


def test_no_store_is_made_for_it_and_one_that_cannot_be_used_changes_no_answer(data: Path) -> None:
    next(data.glob("*-U1/result.json")).write_bytes(b"{}")
    for one in data.glob(f"{FILE}*"):
        one.unlink()
    told = here("verify", "--data", str(data), "--json")
    assert told.exit_code == 1
    assert not (data / FILE).exists()
    (data / FILE).write_bytes(b"no database" * 1000)
    again = here("verify", "--data", str(data), "--json")
    assert (again.exit_code, again.json) == (1, told.json)
    assert "What was found is not in the store" in again.err
    assert {one.kind for one in verify_folder(data).problems} == {"altered"}
