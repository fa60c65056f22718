"""What the processes that inject faults say and hear: JSON lines, one ready message, and their parents' end."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

from virtual_bench.faults.schedule import Acted

INPUT_CHUNK = 4096
ACTED, NOT_SEEN = "fault_acted", "fault_not_seen"

LogLine = Callable[..., None]


def log_line(kind: str, text: str, **more: Any) -> None:
    """Write one JSON line to standard error; a disk that refuses it must not take the bench away under load."""
    line = {"t_s": round(time.time(), 6), "event": kind, "text": text, **more}
    with contextlib.suppress(OSError):
        sys.stderr.write(json.dumps(line, ensure_ascii=False) + "\n")
        sys.stderr.flush()


def tell_acted(log: LogLine, acted: Acted, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
    """Log that a fault has acted, and when, on the clock that the controller's scans are on."""
    fault = acted.fault
    log(
        ACTED,
        f"{fault.target} {fault.verb}",
        value=fault.value,
        plant_s=acted.at_s,
        clock_ns=clock_ns(),
    )


def print_ready(ready: dict[str, Any]) -> None:
    """Print the ready message as one JSON line on standard output."""
    sys.stdout.write(json.dumps(ready) + "\n")
    sys.stdout.flush()


class ParentInput:
    """Our standard input: lines about the controller; when the parent dies, however it dies, its end closes."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, stop: asyncio.Event, tell: Callable[[str, int, int], None], log: LogLine
    ) -> None:
        self._loop, self._stop = loop, stop
        self._tell, self._log = tell, log
        self._rest = b""

    def read(self) -> None:
        """Take what is there; the end of the input ends the process."""
        chunk = os.read(sys.stdin.fileno(), INPUT_CHUNK)
        if not chunk:
            self._loop.remove_reader(sys.stdin.fileno())
            self._stop.set()
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        for line in lines:
            self._hear(line)

    def _hear(self, line: bytes) -> None:
        """Take a line about the controller (its state, scan of entry, newest scan) or a fault that the station did."""
        try:
            told = json.loads(line)
            if "acted" in told:
                self._log(ACTED, str(told["acted"]), value=told["value"], clock_ns=int(told["clock_ns"]))
                return
            self._tell(str(told["state"]), int(told["scan"]), int(told["entered"]))
        except (ValueError, KeyError, TypeError):
            self._log("not_understood", f"on standard input: {line[:80]!r}")
