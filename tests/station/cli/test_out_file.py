"""No command writes over a record, whatever it is told with --out."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here

from station.archive import fetch, identity, push
from station.archive import settings as archive_settings
from station.cli import command_line, out_file
from station.cli.out_file import OWN, OWN_FOLDERS, refuse_records, writing
from station.errors import StationError
from station.opcua import server
from station.opcua import settings as opcua_settings
from station.records import archive_note, certificate_code, studies, traces
from station.records.chain import chain_file, folder_lock, keys, old_index
from station.records.revisions import history, revision
from station.reevaluation import ledger
from station.run.jog import jogs
from station.run.way_back import recoveries
from station.store import places, retention
from station.web import models, running
from station.web import settings as web_settings
from station.web.aqdef import settings as aqdef_settings
from station.web.bench import jogging, way_back
from station.web.labels import settings as labels_settings
from station.web.mes import settings as mes_settings
from station.web.people import database

WRITERS = {
    "export": ("export", "RUN", "--format", "csv"),
    "runs": ("runs", "--data", "RUN/.."),
    "report": ("report", "RUN"),
    "model": ("model", "RUN", "--kind", "cubic"),
    "play-model": ("play-model", "RUN/result.json", "RUN/result.json"),
    "from-eds": ("profile", "from-eds", "RUN/recipe.yaml"),
    "dfq": ("quality", "dfq", "--virtual", "--data", "RUN/.."),
    "validation": ("quality", "validation", "--virtual", "--data", "RUN/.."),
    "frequency": ("study", "frequency", "RUN", "--band", "5:120"),
}
"""Every command with --out."""

PAGES = {
    "matrix": (("faults", "matrix"), ("--html", "--page")),
    "exits": (("faults", "exits"), ("--page",)),
}
"""Every command that writes a page at its end, and its options."""

FOLDERS = ("report", "from-eds", "validation")
"""Those whose --out is a folder: a file is written into it."""


@pytest.fixture
def run(golden_run, tmp_path: Path) -> Path:
    return golden_run.copy(tmp_path / "runs")


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def with_option(group: Any, *names: str) -> Iterator[str]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from with_option(command, *names)
        elif any(option in one.opts for one in command.params for option in names):
            yield name


def test_every_command_that_writes_a_file_is_here() -> None:
    whole = command_line()
    assert set(with_option(whole, "--out")) == set(WRITERS)
    assert set(with_option(whole, "--page", "--html")) == set(PAGES)


@pytest.mark.parametrize(("words", "options"), PAGES.values(), ids=PAGES)
def test_a_page_that_cannot_be_written_is_refused_before_minutes_of_work(
    run: Path, words: tuple[str, ...], options: tuple[str, ...]
) -> None:
    before = content(run.parent)
    places = {
        run / "result.json": f"lies in the folder of run {run.name}",
        run.parent / "no" / "x": "there is no folder",
    }
    for option in options:
        for place, told in places.items():
            refused = here(*words, option, str(place))
            assert (refused.exit_code, refused.out) == (2, "")
            assert f"{option} {place}: {told}" in refused.err
    assert content(run.parent) == before


@pytest.mark.parametrize("place", ["result.json", "profiles/new.json", "profiles"])
@pytest.mark.parametrize("command", WRITERS)
def test_a_record_is_not_written_over(golden_run, run: Path, tmp_path: Path, command: str, place: str) -> None:
    other = golden_run.copy(tmp_path / "other")
    before = content(tmp_path)
    words = [word.replace("RUN", str(run)) for word in WRITERS[command]]
    # into another run's folder as well as into its own, and through a path that does not look like one
    for out in (other / place, run / place, run / ".." / run.name / place):
        refused = here(*words, "--out", str(out), "--json")
        assert refused.exit_code == 2
        assert (
            f"lies in the folder of run {run.name}, where no file may be added or changed. Choose another"
            in refused.err
        )
    assert content(tmp_path) == before


@pytest.mark.parametrize("command", sorted(set(WRITERS) - set(FOLDERS)))
def test_the_chain_of_the_runs_is_not_written_over(run: Path, command: str) -> None:
    before = content(run.parent)
    words = [word.replace("RUN", str(run)) for word in WRITERS[command]]
    refused = here(*words, "--out", str(run.parent / "chain.jsonl"))
    assert (refused.exit_code, "chain.jsonl" in refused.err) == (2, True)
    assert content(run.parent) == before


@pytest.mark.parametrize("command", sorted(set(WRITERS) - set(FOLDERS)))
def test_what_keeps_a_data_folder_is_not_written_over(run: Path, command: str) -> None:
    data = run.parent
    (data / "recipes" / "one").mkdir(parents=True)
    before = content(data)
    words = [word.replace("RUN", str(run)) for word in WRITERS[command]]
    own = ("station.sqlite3", "store.sqlite3-wal", "recipes.jsonl", ".lock", "jogs", "recipes/one/r1.yaml")
    for name in own:
        refused = here(*words, "--out", str(data / name))
        assert (refused.exit_code, f"{data / name}: this name is one of the program's own" in refused.err) == (2, True)
    if command == "export":  # it writes a second file beside
        assert here(*words, "--out", str(data / "archive-id")).exit_code == 2
    assert content(data) == before


def test_every_name_of_the_program_in_a_data_folder_is_in_the_table() -> None:
    names = [
        chain_file.CHAIN, old_index.INDEX, folder_lock.LOCK, keys.FOLDER_KEYS, history.HISTORY, archive_note.NOTE,
        identity.MARKER, push.LOCK, places.FILE, database.FILE, database.LOCK, server.LOCK, retention.FILE,
        running.OUTPUT, way_back.OUTPUT, jogging.OUTPUT, web_settings.FILE, labels_settings.FILE, aqdef_settings.FILE,
        mes_settings.FILE, models.FILE, opcua_settings.FILE, archive_settings.SETTINGS, certificate_code.CERTIFICATE,
    ]  # fmt: skip
    beside = {f"{name}{end}" for name in (places.FILE, database.FILE) for end in ("-wal", "-shm", "-journal")}
    assert {*names, *beside} == OWN
    folders = {revision.TEXTS, recoveries.FOLDER, jogs.FOLDER, studies.FOLDER, ledger.FOLDER, traces.FOLDER}
    assert {*folders, fetch.FETCHING, "opcua"} == OWN_FOLDERS


def test_the_place_of_a_data_folder_whose_chain_is_away_is_kept(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = run.parent
    for name in ("chain.jsonl", "index.jsonl"):
        (data / name).unlink(missing_ok=True)
    refuse_records(data / "recipes.jsonl")
    monkeypatch.setattr(out_file, "chain_seen_in", lambda folder: "id" if folder == data.resolve() else None)
    with pytest.raises(StationError, match="one of the program's own"):
        refuse_records(data / "recipes.jsonl")
    (run / "samples.json").unlink()
    (run / "run.json").unlink()
    with pytest.raises(StationError, match="lies in the folder of run"):
        refuse_records(run / "result.json")


def test_a_report_may_be_written_into_the_folder_of_its_own_run(run: Path) -> None:
    assert here("report", str(run), "--out", str(run)).exit_code == 0
    assert (run / "report.html").is_file()


def test_a_place_that_takes_no_file_is_told() -> None:
    told = r"^file out\.csv cannot be written: Permission denied\. Choose another place with --out$"
    with pytest.raises(StationError, match=told), writing(Path("out.csv")):
        raise PermissionError(13, "Permission denied")
