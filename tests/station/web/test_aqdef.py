"""AQDEF files by the outbox: written as runs are sealed, read back by another program, each complete or not there."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from aqdef_reader import by_another_program
from lostmotion_command import here
from sqlalchemy import select
from station_support import client_of
from stored_runs import metric, store_run

from recipes import RecipeError
from station.atomic_file import write_new
from station.documents.manifest import StudyPlace
from station.errors import StationError
from station.quality.dfq.check import checked_dfq
from station.wall_clock import WALL_CLOCK
from station.web.aqdef import outbox
from station.web.aqdef.collect import BEHIND_THE_HOUR_S, begin_here
from station.web.aqdef.outbox import Waiting, Writer, look, waiting
from station.web.aqdef.settings import FILE, load_aqdef
from station.web.people import audit
from station.web.people.database import AQDEF_FILES
from station.web.station import Station

HOUR_S = 3600.0


def set_up(station: Station, share: Path, per: str, more: str = "") -> Station:
    """Set the files up, with a folder that takes them."""
    share.mkdir(exist_ok=True)
    (station.data / FILE).write_text(f"folder: {share}\nper: {per}\n{more}")
    begin_here(station.database, station.data)
    return dataclasses.replace(station, aqdef=load_aqdef(station.data))


def pass_of(plant: Station) -> int:
    assert plant.aqdef is not None
    return look(plant.database, plant.data, plant.aqdef, at_once=True)


def stand(plant: Station) -> Waiting:
    with plant.database.reading() as connection:
        return waiting(connection)


def serials(share: Path) -> list[list[str]]:
    """Return the serial numbers of each file, in the order of their numbers."""
    files = sorted(share.glob("*.dfq"), key=lambda file: file.stem[-6:])
    return [[row.serial for row in checked_dfq(file.read_bytes()).rows] for file in files]


@pytest.fixture
def share(tmp_path: Path) -> Path:
    return tmp_path / "share"


@pytest.fixture
def stepped() -> Iterator[None]:
    """Let a test set the clock, and set it back."""
    before = WALL_CLOCK._jumped
    yield
    WALL_CLOCK._jumped = before


def to_the_end_of_the_hour(seconds: float) -> None:
    WALL_CLOCK.step(HOUR_S - WALL_CLOCK.now().timestamp() % HOUR_S - seconds)


def test_each_unit_has_a_file_that_another_program_reads(station: Station, share: Path) -> None:
    store_run(station.data, "BEFORE", [metric(0.1)])
    plant = set_up(station, share, "unit")
    store_run(plant.data, "SN-1", [metric(0.4)], day=10)
    store_run(plant.data, "SN-2", [metric(1.4)], day=10, failed="lost_motion")
    store_run(plant.data, "MASTER", [metric(0.4)], master="PASS")
    store_run(plant.data, "VIRTUAL", [metric(0.4)], virtual="nominal")
    store_run(plant.data, "FAULTS", [metric(0.4)], scenario="s")
    store_run(plant.data, "STOPPED", [], state="stopped")
    study = StudyPlace(name="gauge", plan="0" * 64, step=1, steps=9)
    store_run(plant.data, "STUDY", [metric(0.4)], study=study)
    assert pass_of(plant) == 2
    assert pass_of(plant) == 0
    assert serials(share) == [["SN-1"], ["SN-2"]]
    for file, value, event in zip(sorted(share.iterdir()), (0.4, 1.4), ("", "2,4"), strict=True):
        assert file.name.startswith("b_RV_inverse-r1_")
        part = by_another_program(file.read_bytes()).get_part(0)
        measured = part.get_characteristic_by_index(1).get_measurements()
        assert [(one.value, one.event) for one in measured] == [(value, event)]
        assert str(part.get_characteristic_by_index(1).get_data("K2111")) == "1"
    assert stand(plant) == Waiting(0, 0, "", 0, "")


@pytest.mark.usefixtures("stepped")
def test_an_hour_ends_at_its_end_and_not_before(station: Station, share: Path) -> None:
    plant = set_up(station, share, "hour", "virtual: true\n")
    to_the_end_of_the_hour(120.0)
    store_run(plant.data, "SN-1", [metric(0.4)])
    store_run(plant.data, "VIRTUAL", [metric(0.4)], virtual="nominal")
    store_run(plant.data, "SN-2", [metric(0.5)])
    assert (pass_of(plant), stand(plant).open) == (0, 2)
    to_the_end_of_the_hour(-0.5 * BEHIND_THE_HOUR_S)
    store_run(plant.data, "SN-3", [metric(0.6)])
    assert (pass_of(plant), stand(plant).open) == (0, 3), "a run of the last second may still come"
    WALL_CLOCK.step(2.0 * BEHIND_THE_HOUR_S)
    assert (pass_of(plant), stand(plant).open) == (2, 1)
    assert serials(share) == [["SN-1", "SN-2"], ["VIRTUAL"]]
    WALL_CLOCK.step(HOUR_S)
    assert (pass_of(plant), stand(plant).open) == (1, 0)
    assert serials(share)[-1] == ["SN-3"]
    hours = [file.stem.split("_")[-2] for file in sorted(share.iterdir(), key=lambda file: file.stem[-6:])]
    assert hours[0] == hours[1] < hours[2]


@pytest.mark.usefixtures("stepped")
def test_a_lot_ends_with_another_recipe_by_its_number_and_by_silence(station: Station, share: Path) -> None:
    plant = set_up(station, share, "lot", "lot_units: 2\nlot_silence_h: 1\n")
    for number, words in enumerate(({}, {"revision": 2}, {"revision": 2}, {"revision": 2})):
        store_run(plant.data, f"SN-{number}", [metric(0.4)], **words)
    assert pass_of(plant) == 2
    assert serials(share) == [["SN-0"], ["SN-1", "SN-2"]]
    assert stand(plant).open == 1
    WALL_CLOCK.step(HOUR_S)
    assert pass_of(plant) == 1
    assert serials(share)[-1] == ["SN-3"]


@pytest.mark.usefixtures("stepped")
@pytest.mark.parametrize("looks", [True, False])
def test_a_silence_between_two_runs_ends_a_lot_whether_or_not_anybody_looked_then(
    station: Station, share: Path, *, looks: bool
) -> None:
    plant = set_up(station, share, "lot", "lot_silence_h: 0.1\n")
    gaps_s = (0.0, 300.0, 400.0, 200.0, 1000.0)
    for number, gap_s in enumerate(gaps_s):
        WALL_CLOCK.step(gap_s)
        if looks and gap_s:
            pass_of(plant)
        store_run(plant.data, f"L-{number}", [metric(0.4)])
    WALL_CLOCK.step(HOUR_S)
    pass_of(plant)
    assert serials(share) == [["L-0", "L-1"], ["L-2", "L-3"], ["L-4"]]
    assert stand(plant) == Waiting(0, 0, "", 0, "")


@pytest.mark.usefixtures("stepped")
def test_runs_with_other_limits_or_definitions_are_in_files_of_their_own(station: Station, share: Path) -> None:
    """A file says the limits of a characteristic once: a run with others would be judged by those of its neighbours."""
    plant = set_up(station, share, "hour")
    to_the_end_of_the_hour(120.0)
    store_run(plant.data, "SN-1", [metric(0.4)])
    store_run(plant.data, "SN-2", [metric(0.4, limits={"min": None, "max": 0.5})])
    store_run(plant.data, "SN-3", [metric(0.4, definition="another")])
    store_run(plant.data, "SN-4", [metric(0.4)])
    WALL_CLOCK.step(HOUR_S)
    assert pass_of(plant) == 3
    assert sorted(serials(share)) == [["SN-1", "SN-4"], ["SN-2"], ["SN-3"]]


@pytest.mark.usefixtures("stepped")
def test_a_run_that_does_not_fit_the_format_is_told_and_keeps_none_from_its_file(
    station: Station, share: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plant = set_up(station, share, "hour")
    to_the_end_of_the_hour(120.0)
    for serial in ("SN-1", "S" * 41, "Ω-2", "SN-3"):
        store_run(plant.data, serial, [metric(0.4)])
    store_run(plant.data, "EMPTY", [])
    altered = store_run(plant.data, "ALTERED", [metric(0.4)])
    (altered.folder / "result.json").write_text("{}")
    WALL_CLOCK.step(HOUR_S)
    assert pass_of(plant) == 1
    assert serials(share) == [["SN-1", "SN-3"]]
    assert stand(plant)[:2] == (0, 0)
    assert stand(plant).refused == 4
    told = capsys.readouterr().err
    assert "K0014: 41 characters; at most 40" in told
    assert "the sign 'Ω' cannot be written" in told
    shown = client_of(plant, "quality").http.get("/api/now").json()["aqdef"]
    assert shown["refused"] == 4
    assert shown["last_refused"].startswith("run ")


def test_who_knows_that_a_run_is_in_no_file_says_so_once_and_the_trail_has_it(station: Station, share: Path) -> None:
    plant = set_up(station, share, "unit")
    for serial in ("S" * 41, "T" * 41):
        store_run(plant.data, serial, [metric(0.4)])
    pass_of(plant)
    quality = client_of(plant, "quality")
    run = quality.http.get("/api/now").json()["aqdef"]["last_refused"].removeprefix("run ").partition(":")[0]
    asked = {"run": run, "reason": "the customer has it on paper"}
    assert client_of(plant, "operator").post("acknowledge_aqdef", asked).status_code == 403
    assert quality.post("acknowledge_aqdef", {**asked, "reason": "    "}).status_code == 422, "blanks are no reason"
    told = quality.post("acknowledge_aqdef", asked)
    assert (told.status_code, told.json()["refused"]) == (200, 1)
    assert quality.post("acknowledge_aqdef", asked).status_code == 409
    assert quality.post("acknowledge_aqdef", {**asked, "run": "no such run"}).status_code == 409
    shown = quality.http.get("/api/now").json()["aqdef"]
    assert (shown["refused"], run in shown["last_refused"]) == (1, False)
    assert pass_of(plant) == 0, "it stays in no file"
    with plant.database.writing() as connection:
        lines = [line for line in audit.lines_of(connection, 9) if line.action == "acknowledge_aqdef"]
    done = next(line for line in lines if line.outcome == audit.DONE)
    assert all(word in done.detail for word in ("on paper", run, '"refused": 2', '"refused": 1'))


def test_a_share_that_is_away_is_waited_for_and_told(station: Station, share: Path) -> None:
    plant = set_up(station, share, "unit")
    away = share.rename(share.with_name("away"))
    store_run(plant.data, "SN-1", [metric(0.4)])
    store_run(plant.data, "SN-2", [metric(0.5)])
    assert (pass_of(plant), stand(plant).waiting) == (0, 2)
    assert "share" in client_of(plant, "quality").http.get("/api/now").json()["aqdef"]["last_error"]
    assert not share.exists(), "a folder that is made where a share is away would hide the files below it"
    away.rename(share)
    assert pass_of(plant) == 2
    assert (serials(share), stand(plant)) == ([["SN-1"], ["SN-2"]], Waiting(0, 0, "", 0, ""))
    assert {file.suffix for file in share.iterdir()} == {".dfq"}


@pytest.mark.usefixtures("stepped")
def test_a_clock_that_is_set_back_holds_no_file_up(station: Station, share: Path) -> None:
    plant = set_up(station, share, "unit")
    away = share.rename(share.with_name("away"))
    store_run(plant.data, "SN-1", [metric(0.4)])
    assert pass_of(plant) == 0
    away.rename(share)
    WALL_CLOCK.step(-2.0 * HOUR_S)
    assert plant.aqdef is not None
    assert look(plant.database, plant.data, plant.aqdef) == 1


def test_nothing_is_written_below_a_place_where_no_share_is_mounted(station: Station, share: Path) -> None:
    plant = set_up(station, share, "unit", f"mount_point: {share}\n")
    store_run(plant.data, "SN-1", [metric(0.4)])
    assert (pass_of(plant), list(share.iterdir())) == (0, [])
    assert "no share is mounted" in stand(plant).last_error
    (plant.data / FILE).write_text(f"folder: {share}\nmount_point: /\nper: unit\n")
    with pytest.raises(RecipeError, match="mount_point"):
        load_aqdef(plant.data)


def test_a_file_of_another_content_is_never_overwritten_and_keeps_none_back(station: Station, share: Path) -> None:
    plant = set_up(station, share, "unit")
    away = share.rename(share.with_name("away"))
    for number in range(3):
        store_run(plant.data, f"SN-{number}", [metric(0.4)])
    pass_of(plant)
    away.rename(share)
    with plant.database.reading() as connection:
        names = list(connection.execute(select(AQDEF_FILES.c.name).order_by(AQDEF_FILES.c.number)).scalars())
    (share / names[0]).write_text("of somebody else")
    (share / names[1]).symlink_to(share / "nowhere")
    assert pass_of(plant) == 1
    assert (share / names[0]).read_text() == "of somebody else"
    assert (share / names[1]).is_symlink()
    assert "is not overwritten" in stand(plant).last_error
    (share / names[0]).unlink()
    (share / names[1]).unlink()
    assert pass_of(plant) == 2
    assert serials(share) == [["SN-0"], ["SN-1"], ["SN-2"]]


def kept_of(plant: Station) -> bytes:
    with plant.database.reading() as connection:
        return connection.execute(select(AQDEF_FILES.c.content).order_by(AQDEF_FILES.c.number.desc())).scalars().first()


def in_another_process(plant: Station, **stops: object) -> int:
    """Take a pass in a process that ends at one of its steps; return its exit code."""
    pid = os.fork()
    if pid == 0:
        for name, stop in stops.items():
            setattr(outbox, name, stop)
        pass_of(plant)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def end(*_: object, **__: object) -> None:
    os._exit(9)


def written_and_ended(path: Path, content: bytes) -> bool:
    write_new(path, content)
    os._exit(9)


def half_written(path: Path, content: bytes) -> bool:
    path.with_name(f".{path.name}.part").write_bytes(content[:20])
    os._exit(9)


@pytest.mark.parametrize(
    ("step", "stop"),
    [("_make", end), ("_make_one", end), ("_write", end), ("write_new", end), ("write_new", half_written),
     ("write_new", written_and_ended)],
    ids=["behind the chain", "before it is made", "as it is made", "before the file", "in the file", "before the note"],
)  # fmt: skip
def test_a_kill_loses_no_file_and_writes_none_with_other_content(
    station: Station, share: Path, step: str, stop: object
) -> None:
    plant = set_up(station, share, "unit")
    store_run(plant.data, "SN-1", [metric(0.4)])
    assert in_another_process(plant, **{step: stop}) == 9
    kept, there = kept_of(plant), [file.read_bytes() for file in share.glob("*.dfq")]
    assert pass_of(plant) == 1
    assert serials(share) == [["SN-1"]]
    assert len(list(share.iterdir())) == 1
    content = next(share.iterdir()).read_bytes()
    assert kept in (None, content)
    assert there in ([], [content])
    assert (pass_of(plant), stand(plant)) == (0, Waiting(0, 0, "", 0, ""))


def test_the_thread_of_the_server_writes_and_tells_what_keeps_it(
    station: Station, share: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outbox, "LOOK_EVERY_S", 0.02)
    plant = set_up(station, share, "unit")
    away = share.rename(share.with_name("away"))
    assert plant.aqdef is not None
    writer = Writer(plant.database, plant.data, plant.aqdef)
    writer.start()
    try:
        store_run(plant.data, "SN-1", [metric(0.4)])
        wait_until(lambda: stand(plant).last_error)
        away.rename(share)
        wait_until(lambda: list(share.glob("*.dfq")) and stand(plant).waiting == 0)
    finally:
        writer.close()
    assert serials(share) == [["SN-1"]]
    assert "aqdef  files wait:" in capsys.readouterr().err


def wait_until(holds: Callable[[], object]) -> None:
    end_s = time.monotonic() + 60.0
    while not holds():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_one_pass_by_the_command_without_a_server(station: Station, share: Path, tmp_path: Path) -> None:
    asked = ("quality", "dfq", "--outbox", "--data", str(station.data))
    assert FILE in here(*asked).err
    (station.data / FILE).write_text(f"folder: {share}\nper: unit\n")
    assert here(*asked).exit_code == 0, "from here on"
    store_run(station.data, "SN-1", [metric(0.4)])
    away = here(*asked)
    assert (away.exit_code, "waiting  1" in away.out, str(share) in away.out) == (1, True, True)
    share.mkdir()
    assert here(*asked, "--json").json == {
        "written": 1, "open": 0, "waiting": 0, "last_error": "", "refused": 0, "last_refused": "",
    }  # fmt: skip
    assert serials(share) == [["SN-1"]]
    for wrong in ((*asked, "--out", str(tmp_path / "x.dfq")), asked[:2], (*asked, "--virtual")):
        assert here(*wrong).exit_code == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("per: unit\n", "folder"),
        ("folder: relative\nper: unit\n", "folder"),
        ("folder: /share\nper: day\n", "per"),
        ("folder: /share\nper: lot\nlot_units: 0\n", "lot_units"),
        ("folder: /share\nper: unit\nvirtul: true\n", "virtul"),
        ("folder: /share\nper: unit\nmount_point: /other\n", "is not inside it"),
        ("folder: DATA/files\nper: unit\n", "in the data folder"),
    ],
)
def test_settings_that_are_refused_name_the_place(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / FILE).write_text(text.replace("DATA", str(tmp_path)))
    with pytest.raises((RecipeError, StationError), match=FILE) as refused:
        load_aqdef(tmp_path)
    assert said in str(refused.value)
