"""A command takes no module from the folder in which it is typed, and no process that it starts does."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from lostmotion_command import ROOT
from patient import QUICK_RECIPE, write_changed

from station.own_program import own_module

SHADOWS = ("queue", "random", "platform", "numpy", "recipes", "selectors", "tempfile", "zlib", "struct", "bisect")
"""Names of modules that are loaded by Python's library, by libraries and by this program."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder to work in, with files that are called as modules are: each says so when it is loaded."""
    for name in SHADOWS:
        (tmp_path / f"{name}.py").write_text(
            f"raise SystemExit('{name} was loaded from the working folder')\n", "utf-8"
        )
    return tmp_path


def typed(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Have a command typed in a folder, by its script, as it is installed."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    script = folder.parent / "lostmotion-script" / "lostmotion"
    script.parent.mkdir(exist_ok=True)
    script.write_text("from station.cli import main\nmain()\n", encoding="utf-8")
    environment["PYTHONPATH"] = os.pathsep.join(path for path in map(os.path.abspath, sys.path) if Path(path).exists())
    command = [sys.executable, str(script), *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_a_run_over_wires_takes_nothing_from_there(folder: Path) -> None:
    recipe = write_changed(QUICK_RECIPE, folder / "quick.yaml", {"sampling": {"period": "10 ms"}})
    how = ("--serial", "W", "--seed", "1", "--pace", "fast", "--data", "runs", "--no-report")
    ran = typed(folder, "run", str(recipe), *how)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    asked = typed(folder, "reevaluate", "--data", "runs", "--recipe", str(recipe), "--workers", "2")
    assert asked.returncode in (0, 1), asked.stdout + asked.stderr
    shutil.rmtree(folder / "runs")


def test_every_process_of_this_program_is_started_so() -> None:
    command = own_module("station", "list")
    assert command == [sys.executable, "-P", "-m", "station", "list"]
    others = [path.name for path in (ROOT / "station").rglob("*.py") if '"-m"' in path.read_text("utf-8")]
    assert others == ["own_program.py"]
