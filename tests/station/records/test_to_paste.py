"""Commands that texts tell people to run: pasted into a shell they do what the text says, and are not refused."""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path

import pytest
from lostmotion_command import here
from station_samples import SETUP
from stored_runs import metric, store_run

from station.cli.measure.conclude import FAILED, STILL_RUNNING, ConcludedRow, _line
from station.cli.measure.run import no_record
from station.errors import RecordError
from station.records.data_folder import Store
from station.records.process_birth import process_birth
from station.records.run_record import SCAN_REPORT, RunRecord
from station.records.to_paste import to_its_result, to_paste
from station.reports.stored_result import refuse_doubtful, stored_result
from station.run.outcome import SUPERVISOR_REPORT

PASTED = re.compile(r"'(lostmotion [a-z].*?)'(?=\.? |\.?$|; )", re.MULTILINE)


def pasted(text: str) -> list[list[str]]:
    """Return the commands of a text, as a shell takes them."""
    return [shlex.split(one) for one in PASTED.findall(text)]


@pytest.fixture
def left(tmp_path: Path) -> RunRecord:
    """A run whose supervisor died, in a folder whose name a shell would take apart."""
    run = Store(tmp_path / "my runs").create("SN-1", SETUP, {})
    run.update(desk={"pid": 999_999, "birth": "gone"})
    return run


def scans_on(run: RunRecord) -> None:
    run.write_json(SCAN_REPORT, {"state": "running", "pid": os.getpid(), "birth": process_birth(os.getpid())})


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (Path("runs"), "lostmotion show R"),
        (Path("other"), "lostmotion show R --data other"),
        (Path("my runs"), "lostmotion show R --data 'my runs'"),
        (Path("$HOME"), "lostmotion show R --data '$HOME'"),
    ],
)
def test_the_folder_is_named_where_it_is_not_the_default_and_quoted(data: Path, said: str) -> None:
    assert to_paste("show", "R", data=data) == said


@pytest.mark.parametrize("scans", [False, True], ids=["ended", "scans on"])
def test_every_text_about_a_run_that_was_left_names_the_command_that_takes_it(
    left: RunRecord, tmp_path: Path, *, scans: bool
) -> None:
    if scans:
        scans_on(left)
    data = str(left.folder.parent)
    right = ["lostmotion", "resume" if scans else "conclude", left.id, "--data", data]
    assert shlex.split(to_its_result(left)) == right
    assert pasted(here("report", left.id, "--data", data).err) == [right]
    assert pasted(" ".join(stored_result(left).reasons)) == [right]
    with pytest.raises(RecordError) as refused:
        refuse_doubtful(left)
    assert pasted(str(refused.value)) == [right]
    assert pasted(here("backup", str(tmp_path / "b.tar"), "--data", data).out) == [right]


def test_of_many_runs_that_were_left_backup_and_list_name_all_in_their_folder(tmp_path: Path) -> None:
    store = Store(tmp_path / "my runs")
    for number in range(21):
        store.create(f"SN-{number}", SETUP, {}).update(desk={"pid": 999_999, "birth": "gone"})
    every = ["lostmotion", "conclude", "--all", "--data", str(store.data)]
    assert pasted(here("backup", str(tmp_path / "b.tar"), "--data", str(store.data)).out)[-1] == every
    listed = pasted(here("list", "--data", str(store.data), "--limit", "3").out)
    assert every in listed
    assert ["lostmotion", "list", "--all", "--data", str(store.data)] in listed


@pytest.mark.parametrize(("outcome", "word"), [(STILL_RUNNING, "resume"), (FAILED, "conclude")])
def test_what_conclude_could_not_do_is_told_with_the_folder(outcome: str, word: str) -> None:
    line = _line(ConcludedRow(run="R", outcome=outcome, error="x"), Path("my runs"))
    assert pasted(line) == [["lostmotion", word, "R", "--data", "my runs"]]


def test_a_run_that_the_disk_refused_is_told_with_its_folder(
    left: RunRecord, capsys: pytest.CaptureFixture[str]
) -> None:
    left.write_json(SUPERVISOR_REPORT, {})
    no_record(left, RecordError("disk full"), as_json=False)
    assert pasted(capsys.readouterr().err) == [["lostmotion", "conclude", left.id, "--data", str(left.folder.parent)]]


def test_the_report_of_a_run_in_a_folder_with_blanks_is_made_by_what_the_run_printed(tmp_path: Path) -> None:
    recipe = "recipes/rv-40e-121-quick.yaml"
    done = here("run", recipe, "--serial", "SN-1", "--virtual-time", "--data", str(tmp_path / "my runs"))
    words = shlex.split(done.out.splitlines()[-1])
    assert words[:3] == ["report", "lostmotion", "report"]
    assert here(*words[2:]).exit_code == 0, words


def test_a_problem_of_the_chain_is_looked_up_in_its_folder(tmp_path: Path) -> None:
    data = tmp_path / "my runs"
    for run in [store_run(data, "SN-1", [metric(0.5)]) for _ in range(2)][:1]:
        (run.folder / "result.json").unlink()
    assert ["lostmotion", "verify", "--data", str(data)] in pasted(here("list", "--data", str(data)).out)
