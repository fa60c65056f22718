"""Programs in C on libmodbus, compiled where it is installed: Modbus devices that share no code with ours."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest


def compiled(source: Path, folder: Path) -> Path:
    """Return the program that a C file on libmodbus makes; skips the test, with the reason, without its tools."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler: libmodbus is not tried")
    made = folder / source.stem
    command = [compiler, "-O1", "-Wall", "-Werror", "-I/usr/include/modbus", str(source), "-o", str(made), "-lmodbus"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "modbus.h" in done.stderr and "No such file" in done.stderr:
        pytest.skip("libmodbus-dev is not installed: libmodbus is not tried")
    assert done.returncode == 0, done.stderr
    return made
