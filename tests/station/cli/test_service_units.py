"""The units of systemd: of the options that were given, and sound to systemd itself where it is installed."""

from __future__ import annotations

import configparser
import shutil
import subprocess
from pathlib import Path

import pytest
from lostmotion_command import here

from station.cli.web.units import KIOSK, SERVER


def unit(folder: Path, name: str) -> configparser.ConfigParser:
    found = configparser.ConfigParser(strict=False, interpolation=None)
    found.optionxform = str
    found.read(folder / name)
    return found


def test_a_unit_serves_what_was_tried_and_lets_a_run_go_on(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    words = ("serve", "--data", str(data), "--port", "8123", "--name", "bench 3%", "--install-unit", str(tmp_path))
    done = here(*words)
    assert done.exit_code == 0, done.err
    assert SERVER in done.out
    server = unit(tmp_path, SERVER)["Service"]
    assert f"--data {data} --host 127.0.0.1 --port 8123" in server["ExecStart"]
    assert '--name "bench 3%%"' in server["ExecStart"]
    assert server["KillMode"] == "process", "else a restart of the server would end a run under torque"
    assert server["LimitRTPRIO"] == "95"
    assert str(data) in server["ReadWritePaths"]
    assert unit(tmp_path, KIOSK)["Service"]["ExecStart"].endswith(':8123/"')
    assert not (data / "station.sqlite3").exists(), "nothing was served"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_systemd_understands_every_line(tmp_path: Path) -> None:
    assert here("serve", "--data", str(tmp_path / "runs"), "--install-unit", str(tmp_path)).exit_code == 0
    checked = subprocess.run(
        [str(shutil.which("systemd-analyze")), "verify", "--man=no", str(tmp_path / SERVER)],
        capture_output=True,
        text=True,
        check=False,
    )
    said = [line for line in checked.stderr.splitlines() if SERVER in line]
    assert not said, said


def test_a_folder_that_a_unit_cannot_name_is_refused(tmp_path: Path) -> None:
    refused = here("serve", "--data", str(tmp_path / "two words"), "--install-unit", str(tmp_path))
    assert refused.exit_code == 2
    assert "spaces" in refused.err
