"""Walk of a torque from register to report, in a real run: `python -m benchmarks.sample_walk [TREE [OPTION ...]]`.

Makes a run over wires with its report, on the virtual bench, with a profile function in every process of it, and prints
by room the files and the functions that a torque passed: those of the product that ran and returned in the run, and
name a torque in their code (a variable, an attribute, a key or a channel). What carries a torque without naming it,
such as the ring that takes a record as bytes, is not counted.

TREE: another source tree of this project, to compare with; this one by default. OPTION: of its `lostmotion run` that
makes the report, `--report` where no TREE is named.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
RECIPE = "recipes/rv-40e-121-quick.yaml"
ROOMS = ("definitions", "drivers", "controller", "analysis", "recipes", "station")
"""Rooms that are counted: the virtual bench stands for the hardware; older trees have it in `NOT_COUNTED`."""

NOT_COUNTED = "drivers/virtual/"

PROBE = r"""
import atexit, json, os, sys, threading

ROOT, OUT = os.environ["WALK_ROOT"] + "/", os.environ["WALK_OUT"]
passed, names = {}, {}


def named(code):
    words = {*code.co_names, *code.co_varnames, *code.co_freevars}
    words |= {word for word in code.co_consts if isinstance(word, str)}
    return any("torque" in word and len(word) < 40 for word in words)


def look(frame, event, arg):
    if event == "return":
        code = frame.f_code
        if code not in names:
            names[code] = code.co_filename.startswith(ROOT) and code.co_name[0] != "<" and named(code)
        if names[code]:
            passed[code] = True


def keep():
    sys.setprofile(None)
    rows = [(code.co_filename[len(ROOT):], code.co_qualname) for code in passed]
    with open(f"{OUT}/{os.getpid()}.json", "w", encoding="utf-8") as file:
        json.dump(rows, file)


atexit.register(keep)
threading.setprofile(look)
sys.setprofile(look)
"""


def walk(tree: Path, options: Sequence[str]) -> set[tuple[str, str]]:
    """Return file and function of what a torque passed in a run of a source tree; options: of `lostmotion run`.

    Raises:
        SystemExit: the run failed.

    """
    with TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "sitecustomize.py").write_text(PROBE, encoding="utf-8")
        words = ["run", str(tree / RECIPE), "--serial", "WALK", "--data", str(place / "runs"), *options]
        command = [sys.executable, "-c", "import sys; from station.cli import main; sys.exit(main())", *words]
        paths = {"PYTHONPATH": f"{place}{os.pathsep}{tree}", "WALK_ROOT": str(tree), "WALK_OUT": folder}
        done = subprocess.run(command, env=os.environ | paths, cwd=place, capture_output=True, text=True, check=False)  # noqa: S603
        kept = [json.loads(path.read_text(encoding="utf-8")) for path in place.glob("*.json")]
        if done.returncode not in (0, 1, 3) or not kept:
            raise SystemExit(f"the run failed with exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return {(file, name) for rows in kept for file, name in rows if _counts(file)}


def _counts(file: str) -> bool:
    return file.split("/", 1)[0] in ROOMS and not file.startswith(NOT_COUNTED)


def room_of(file: str) -> str:
    """Return the room of a file: its folder, two levels at most."""
    return "/".join(file.split("/")[:-1][:2])


def table(passed: set[tuple[str, str]]) -> list[str]:
    """Return the figure as rows of a table."""
    files = Counter(room_of(file) for file in {file for file, _ in passed})
    returns = Counter(room_of(file) for file, _ in passed)
    order = sorted(files, key=lambda room: (ROOMS.index(room.split("/", maxsplit=1)[0]), room))
    rows = [f"| `{room}` | {files[room]} | {returns[room]} |" for room in order]
    analysis = [row for row in passed if row[0].startswith("analysis/")]
    of_analysis = f"| of these in the analysis | {len({file for file, _ in analysis})} | {len(analysis)} |"
    total = f"| all | {sum(files.values())} | {sum(returns.values())} |"
    return ["| room | files | functions |", "| --- | --- | --- |", *rows, total, of_analysis]


if __name__ == "__main__":
    named = sys.argv[1:]
    print("\n".join(table(walk(Path(named[0]).resolve(), named[1:]) if named else walk(ROOT, ["--report"]))))
