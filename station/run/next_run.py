"""The process of the next run: started ahead while nobody measures, and told what to measure when a unit is scanned.

Where none waits, as when a unit follows within seconds, one is started as a shell starts it: that takes longer, and is
the same run.
"""

from __future__ import annotations

import math
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from station.errors import StationError
from station.own_program import own_module
from station.run.ahead import Ahead

SUPERVISOR = "station.cli.measure.standby"
AGAIN_AFTER_S = 60.0
"""After one that ended without an order: what keeps it from loading will not be gone in a moment."""


class NextRun:
    """What waits for the next unit of a bench: nothing, or a process that has loaded all that its run needs."""

    def __init__(self, *, own_session: bool = True) -> None:
        """Begin with nothing; own_session: as `Ahead`."""
        self._own_session = own_session
        self._ahead: Ahead | None = None
        self._not_before_s = -math.inf

    def get_ready(self, recipe: str = "", bench: str = "") -> None:
        """Start the process where none waits, without waiting for it. While a run is on it would only disturb that.

        recipe, bench: of the unit that is likely to come, '' where nobody knows.
        """
        if self._ahead is not None:
            if self._ahead.process.poll() is None:
                return
            self.close()
            self._not_before_s = time.monotonic() + AGAIN_AFTER_S
        if time.monotonic() < self._not_before_s:
            return
        try:
            self._ahead = Ahead(SUPERVISOR, recipe, bench, own_session=self._own_session)
        except OSError:
            self._not_before_s = time.monotonic() + AGAIN_AFTER_S

    def wait_until_ready(self, most_s: float) -> bool:
        """Wait until the process has loaded all; False where none waits, or it takes longer."""
        return self._ahead is not None and self._ahead.wait_until_ready(most_s)

    def start(self, options: Sequence[str], *, stdout: int, stderr: int) -> subprocess.Popen[bytes]:
        """Start `lostmotion run` with these options; StationError where that fails."""
        ahead, self._ahead = self._ahead, None
        try:
            with Path("/dev/null").open("rb") as nobody:
                stdin, words = nobody.fileno(), ["run", *options]
                process = None if ahead is None else ahead.begin(words, stdin=stdin, stdout=stdout, stderr=stderr)
                if process is not None:
                    return process
                command = own_module("station", *words)
                return subprocess.Popen(  # noqa: S603 - our own program
                    command, stdin=stdin, stdout=stdout, stderr=stderr, start_new_session=self._own_session
                )
        except OSError as error:
            raise StationError(f"the run cannot be started: {error.strerror}. Try again") from error

    def close(self) -> None:
        """End what waits; a run that was started goes on."""
        if self._ahead is not None:
            self._ahead.end()
            self._ahead = None
