"""The screen of a supervisor that takes a run over: it is loaded while the supervisor is at work already.

The scan waits 2 s for a sign of the new supervisor. Recipe, bench and what draws a screen take a good part of them to
load on a busy machine, so they are loaded in a thread, while the supervisor gives its signs and takes the records.
"""

from __future__ import annotations

import sys
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from types import TracebackType
from typing import TYPE_CHECKING, Self

from station.records.ring.reader import RingReader
from station.records.run_record import RunRecord

if TYPE_CHECKING:
    from station.run.screen.progress import Progress

SHOW_EVERY_LOOKS = 5
"""A supervisor looks at its ring 50 times per second."""


class LateScreen:
    """Shows the progress of a run; a context manager, so that the terminal is left as it was found.

    A run does not depend on its screen: one that is gone, or a recipe that cannot be read any more, ends nothing.
    """

    def __init__(self, run: RunRecord, *, as_json: bool) -> None:
        """Prepare the screen; with `as_json` on standard error."""
        self._run, self._as_json = run, as_json
        self._open = ExitStack()
        self._loading: Future[Progress] | None = None
        self._progress: Progress | None = None
        self._failed = False
        self._looks = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        with suppress(OSError):
            self._open.close()

    def say(self, text: str) -> None:
        """Print one line, also before there is a screen."""
        with suppress(OSError):
            if self._progress is not None:
                self._progress.say(text)
            else:
                print(text, file=sys.stderr if self._as_json else sys.stdout, flush=True)

    def look(self, ring: RingReader) -> None:
        """Show the newest record; called at every look of the supervisor."""
        self._looks += 1
        if self._looks % SHOW_EVERY_LOOKS:
            return
        if self._loading is None:
            pool = self._open.enter_context(ThreadPoolExecutor(1))
            self._loading = pool.submit(_load, self._run, as_json=self._as_json)
        with suppress(OSError):
            if self._progress is None and not self._failed and self._loading.done():
                self._begin(self._loading)
            if self._progress is not None and ring.written:
                self._progress.show(ring.last())

    def _begin(self, loaded: Future[Progress]) -> None:
        error = loaded.exception()
        if error is not None:
            self._failed = True
            self.say(f"the run continues, but its progress cannot be shown: {error}")
            return
        self._progress = self._open.enter_context(loaded.result())
        self._progress.say(f"{self._progress.title}: {self._run.id}")


def _load(run: RunRecord, *, as_json: bool) -> Progress:
    from station.bench.request import stored_job  # noqa: PLC0415 - what takes the time
    from station.run.screen.progress import progress_of  # noqa: PLC0415 - as above

    job = stored_job(run)
    return progress_of(job, run.manifest().serial, as_json=as_json)
