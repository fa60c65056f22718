"""Commands that a text tells people to run, as a shell takes them when they are pasted."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from station.records.run_record import RunRecord

DEFAULT_DATA = Path("runs")
"""Folder of the runs where a command names none."""


def to_paste(*words: str, data: Path = DEFAULT_DATA) -> str:
    """Return a command of this program, with `--data` where its folder is not the default one; blanks are quoted."""
    place = () if data == DEFAULT_DATA else ("--data", str(data))
    return shlex.join(["lostmotion", *words, *place])


def to_its_result(run: RunRecord) -> str:
    """Return the command that brings a run without its supervisor to its result.

    While its scan goes on that is `resume`, for `conclude` leaves such a run as it is.
    """
    return to_paste("resume" if run.scanning() else "conclude", run.id, data=run.folder.parent)
