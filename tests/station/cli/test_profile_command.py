"""`lostmotion profile from-eds` on a folder: drafts are written, printed and told as JSON; nothing is overwritten."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from eds_drives import DRIVES, eds_text
from typer.testing import CliRunner

from station.cli import app
from station.errors import StationError


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
    assert "3 of 4 files drafted" in done.stdout
