"""Runs of the loop without a screen: processes of this terminal, which print to it and are waited for."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from recipes import RecipeError
from station.bench.request import load_job
from station.errors import StationError
from station.records.data_folder import Store
from station.records.master_parts import to_do_with_part
from station.records.run_record import RECORDING
from station.run.next_run import NextRun
from station.web.running import NEWEST, RUNNING, Now, Running


class AtTerminal(Running):
    """The bench of a data folder, as a terminal has it: one run after the other, each waited for."""

    def __init__(self, data: Path, likely: tuple[str, str] = ("", "")) -> None:
        """Begin with no run; likely: recipe and bench of the unit that is likely to come first, '' for none."""
        super().__init__(data)
        self._data_folder = data
        self._ahead, self._run_of_unit = NextRun(own_session=False), None
        self.likely = likely
        """Recipe and bench of the unit that is likely to come next: those of the newest one."""

    _run_of_unit: subprocess.Popen[bytes] | None

    def get_ready(self) -> None:
        """Start the process of the next run ahead."""
        self._ahead.get_ready(*self.likely)

    def start(self, options: Sequence[str], serial: str, likely: tuple[str, str] = ("", "")) -> None:
        """Start the process of a run; what it says goes to this terminal. StationError where it cannot start."""
        words = [*options, "--serial", serial, "--data", str(self._data_folder)]
        self._run_of_unit = self._ahead.start(words, stdout=sys.stdout.fileno(), stderr=sys.stderr.fileno())
        self.likely = likely

    def to_do_with_part(self, serial: str, verdict: str) -> str:
        """Return what is done with a master part after a verdict, '' with any other unit."""
        recipe, bench = self.likely
        with suppress(RecipeError, StationError):
            part = load_job(recipe, bench or None).bench.master_part(serial)
            return "" if part is None else to_do_with_part(part.expect, verdict)
        return ""

    def to_do_after(self, verdict: str) -> str:
        """Return what the recipe of the newest unit says is done after a verdict, '' where it says nothing."""
        recipe, bench = self.likely
        with suppress(RecipeError, StationError):
            return load_job(recipe, bench or None).recipe.what_to_do.after(verdict)
        return ""

    def wait(self) -> int:
        """Wait for the end of the run that was started; return the exit code of `lostmotion run`."""
        assert self._run_of_unit is not None  # noqa: S101 - `start` was called
        return self._run_of_unit.wait()

    def now(self) -> Now:
        """Return what the bench does: a run that another process has started is found by its folder."""
        for record in Store(self._data_folder).newest(NEWEST):
            with suppress(StationError):  # a damaged folder is none of a run that is on
                manifest = record.manifest()
                if manifest.state == RECORDING and not record.deserted():
                    return Now(RUNNING, manifest.serial, record.id)
        return Now()

    def close(self) -> None:
        """End the process that waits for the next run."""
        self._ahead.close()
