"""Does what the tutorial says, as it is written, and compares what comes with what stands there.

`python -m docs.site.tutorial` types every command of docs/tutorial.md in an empty folder; `--pictures` also writes the pictures
of the page from what was measured.

A box of the page is a fence `console`: commands behind `$`, below each what it prints. A line `…` stands for any lines. The
time in the name of a run is of no account.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parents[1]
PAGE = DOCS / "tutorial.md"
PICTURES = {"T-001": DOCS / "images" / "tutorial-good.png", "T-002": DOCS / "images" / "tutorial-worn.png"}
"""Serial number of a unit in the tutorial, and the picture of its loop."""

BOX = re.compile(r"^```console\n(.*?)^```$", re.DOTALL | re.MULTILINE)
RUN_TIME = re.compile(r"\b\d{8}T\d{6}\.\d{3}Z\b")
ANYTHING = "…"
END = "end of what a command of the tutorial printed"
LONGEST = 300.0
"""Seconds that one box may take on a busy computer."""


class TutorialError(Exception):
    """The page says something else than what happens."""


@dataclass(frozen=True)
class Step:
    """One command, and the lines that the page shows below it."""

    command: str
    shown: tuple[str, ...]


def boxes(page: str) -> list[list[Step]]:
    """Return the commands of each box of a page, in order."""
    return [list(_steps(found.group(1))) for found in BOX.finditer(page)]


def _steps(box: str) -> Iterator[Step]:
    for part in re.split(r"^\$ ", box, flags=re.MULTILINE)[1:]:
        command, *shown = part.rstrip("\n").split("\n")
        yield Step(command, tuple(shown))


def run(folder: Path, page: Path = PAGE) -> int:
    """Do what a page says in an empty folder; return the number of commands.

    Raises:
        TutorialError: a command printed something else than what the page shows.

    """
    here = folder / "bench"
    here.mkdir(parents=True)
    environment = _environment(folder)
    count = 0
    for box in boxes(page.read_text(encoding="utf-8")):
        for step, printed in zip(box, _printed(box, here, environment), strict=True):
            difference = compare(step.shown, printed)
            if difference:
                raise TutorialError(f"{page.name}: $ {step.command}\n{difference}\nprinted:\n" + "\n".join(printed))
            count += 1
    return count


def compare(shown: tuple[str, ...], printed: list[str]) -> str:
    """Return in words what of the lines on the page was not printed; nothing when all was."""
    expected, found = [_plain(line) for line in shown], [_plain(line) for line in printed]
    at, free = 0, False
    for line in expected:
        if line == ANYTHING:
            free = True
            continue
        there = next((n for n in range(at, len(found)) if found[n] == line), None) if free else at
        if there is None or there >= len(found) or found[there] != line:
            seen = found[at] if at < len(found) else "the end"
            return f"the page shows: {line}\nthere was:      {'nothing like it' if free else seen}"
        at, free = there + 1, False
    return "" if free or at == len(found) else f"the page shows no more, but there was: {found[at]}"


def _plain(line: str) -> str:
    return RUN_TIME.sub("TIME", line).rstrip()


def _printed(box: list[Step], folder: Path, environment: dict[str, str]) -> list[list[str]]:
    """Return the lines that each command of a box printed; they are typed into one shell."""
    script = "".join(f"{step.command}\nlast=$?; echo '{END}'; (exit $last)\n" for step in box)
    done = subprocess.run(  # noqa: S603 - our own page
        ["/bin/sh", "-c", script],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        timeout=LONGEST,
        check=False,
    )
    return [part.removeprefix("\n").splitlines() for part in done.stdout.split(END)[:-1]]


def _environment(folder: Path) -> dict[str, str]:
    """Return an environment in which `lostmotion` is this program, with a key of its own."""
    command = folder / "bin" / "lostmotion"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m station "$@"\n', encoding="utf-8")
    command.chmod(0o755)
    left_out = ("COLUMNS", "LINES", "LOSTMOTION_STORE")
    kept = {name: value for name, value in os.environ.items() if name not in left_out}
    return kept | {
        "PATH": f"{command.parent}{os.pathsep}{os.environ.get('PATH', os.defpath)}",
        "PYTHONPATH": os.pathsep.join([str(DOCS.parent), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep),
        "LOSTMOTION_STATE": str(folder / "state"),
        "PYTHONUNBUFFERED": "1",
    }


def main() -> int:
    """Run the tutorial in a folder that is removed."""
    with tempfile.TemporaryDirectory() as kept:
        try:
            count = run(Path(kept) / "tutorial")
        except TutorialError as error:
            sys.stderr.write(f"{error}\n")
            return 1
        if "--pictures" in sys.argv[1:]:
            for serial, picture in PICTURES.items():
                subprocess.run(  # noqa: S603 - our own command
                    [Path(kept) / "tutorial" / "bin" / "lostmotion", "report", serial],
                    cwd=Path(kept) / "tutorial" / "bench",
                    check=True,
                )
                (loop,) = Path(kept).glob(f"tutorial/bench/runs/*-{serial}/loop.png")
                shutil.copyfile(loop, picture)
    sys.stderr.write(f"{count} commands did what the page says\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
