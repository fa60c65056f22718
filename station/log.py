"""The log of a run: JSON lines beside its record, written by the supervisor and never by the scan."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO, cast

import structlog

from station.wall_clock import WALL_CLOCK


class _Lines:
    """A log file that a full disk cuts short: what cannot be logged must not end a run, nor hide its result."""

    def __init__(self, file: TextIO) -> None:
        self._file = file

    def write(self, text: str) -> None:
        """Write a part of a line, or nothing."""
        with suppress(OSError):
            self._file.write(text)

    def flush(self) -> None:
        """Flush, if that goes."""
        with suppress(OSError):
            self._file.flush()

    def close(self) -> None:
        """Close the file, if need be without what was not written."""
        with suppress(OSError):
            self._file.close()


Event = MutableMapping[str, Any]
"""What is logged, by names that each caller chooses: the logging library hands it from one processor to the next."""


def _stamp(_logger: Any, _method: str, event: Event) -> Event:
    event["timestamp"] = WALL_CLOCK.now().isoformat().replace("+00:00", "Z")
    return event


@contextmanager
def open_log(path: Path) -> Iterator[Any]:
    """Open a log file and yield its logger; one JSON object per line, time in UTC."""
    lines = _Lines(path.open("a", encoding="utf-8", buffering=1))
    try:
        yield structlog.wrap_logger(
            structlog.WriteLogger(cast("TextIO", lines)),
            processors=[
                structlog.processors.add_log_level,
                _stamp,
                structlog.processors.ExceptionRenderer(),
                structlog.processors.JSONRenderer(ensure_ascii=False),
            ],
        )
    finally:
        lines.close()
