"""`lostmotion profile`: drafts of a folder, none of them overwriting a file; a drive compared with its profile."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import pytest
from eds_drives import DRIVES, eds_text
from table_drive import TableDrive
from typer.testing import CliRunner

from recipes import find_bench
from station.bench.eds_profile import draft
from station.cli import app
from station.errors import StationError

CHANNEL = "profile-compare"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "eds"
    place.mkdir()
    for name, drive in DRIVES.items():
        (place / f"{name}.eds").write_text(eds_text(drive), encoding="utf-8")
    return place


def test_a_folder_of_eds_files_goes_through_in_one_command(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "profiles"
    command = ["profile", "from-eds", str(folder), "--out", str(out), "--json"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0
    told = json.loads(done.stdout)
    assert sorted(one["name"] for one in told["drafts"]) == sorted(DRIVES)
    assert sorted(path.stem for path in out.glob("*.yaml")) == sorted(DRIVES)
    again = CliRunner().invoke(app, command)
    assert isinstance(again.exception, StationError)


def test_a_file_that_cannot_be_read_makes_the_command_say_so_and_keeps_no_other_out(folder: Path) -> None:
    (folder / "broken.eds").write_text("[1000]\nParameterName=x\n", encoding="utf-8")
    done = CliRunner().invoke(app, ["profile", "from-eds", str(folder)])
    assert done.exit_code == 1
    assert "4 drive files: 3 usable, 0 of drives that cannot be used, 1 not readable" in done.stdout


@pytest.fixture
def bench_file(tmp_path: Path) -> Path:
    """Return a bench file with its drive on a bus of this process, and the profile drafted from the drive's EDS."""
    (tmp_path / "drive.eds").write_text(eds_text(DRIVES["nanotec-like"]), encoding="utf-8")
    (tmp_path / "drive.yaml").write_text(draft(tmp_path / "drive.eds").text, encoding="utf-8")
    text = (
        find_bench("virtual")
        .read_text(encoding="utf-8")
        .replace("embedded: true", "embedded: false")
        .replace("profile: virtual-drive", "profile: drive")
    )
    text = text.replace("interface: socketcand", "interface: virtual").replace("channel: vcan0", f"channel: {CHANNEL}")
    path = tmp_path / "bench.yaml"
    path.write_text(text.replace("rated_torque: 2 N·m", "rated_torque: 5 N·m"), encoding="utf-8")
    return path


def test_a_drive_is_compared_with_its_profile_and_left_as_it_is(bench_file: Path) -> None:
    with closing(TableDrive(CHANNEL, DRIVES["nanotec-like"])) as slave:
        done = CliRunner().invoke(app, ["profile", "compare", "--bench", str(bench_file), "--json"])
        assert not slave.written
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    outcomes = {one["place"]: one["outcome"] for one in told["objects"]}
    assert outcomes["1018:02"] == "holds"
    assert set(outcomes.values()) == {"holds", "will be written"}
    assert told["missing"] == []


def test_another_drive_than_the_profiles_is_told(bench_file: Path) -> None:
    with closing(TableDrive(CHANNEL, DRIVES["epos4-like"])):
        done = CliRunner().invoke(app, ["profile", "compare", "--bench", str(bench_file)])
    assert done.exit_code == 1
    assert "0x000000FB" in done.stdout


def test_the_embedded_bench_has_no_drive_to_compare() -> None:
    done = CliRunner().invoke(app, ["profile", "compare", "--bench", "virtual"])
    assert isinstance(done.exception, StationError)
