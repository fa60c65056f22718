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

from pydantic import ValidationError

from virtual_bench.faults.names import VOCABULARY, Vocabulary
from virtual_bench.faults.scenario import Fault
from virtual_bench.faults.schedule import Acted, FaultSchedule

INPUT_CHUNK = 4096
ACTED, NOT_SEEN, LET_GO = "fault_acted", "fault_not_seen", "let_go"
LEAST_WORDS = 2

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


class Hands:
    """Our standard input as the hands of somebody at the bench: one fault a line, by target, verb and value.

    `io.estop trip` presses the emergency stop until `io.estop trip end` releases it; `sensor.torque_in offset 0.5`
    presses on a sensor until `sensor.torque_in offset end`, or the same line with `end` behind it, lets it go. A value
    is a number, also as 0x6072. The vocabulary is that of scenarios.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, faults: FaultSchedule, log: LogLine, vocabulary: Vocabulary
    ) -> None:
        self._loop, self._faults, self._log = loop, faults, log
        self._context = {VOCABULARY: vocabulary}
        self._rest = b""

    def read(self) -> None:
        """Take what is there; at the end of the input nobody is at the bench any more, and it goes on."""
        chunk = os.read(sys.stdin.fileno(), INPUT_CHUNK)
        if not chunk:
            self._loop.remove_reader(sys.stdin.fileno())
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        for line in lines:
            if line.strip():
                self.hear(line.decode(errors="replace").split())

    def hear(self, words: list[str]) -> None:
        """Do what a line says; one that says nothing known is logged."""
        try:
            self._do(words)
        except ValidationError as error:
            told = "; ".join(one["msg"].removeprefix("Value error, ") for one in error.errors())
            self._log("not_understood", f"{' '.join(words)[:80]!r}: {told}")
        except ValueError as error:
            self._log("not_understood", f"{' '.join(words)[:80]!r}: {error}")

    def _do(self, words: list[str]) -> None:
        if len(words) < LEAST_WORDS:
            raise ValueError("allowed: TARGET VERB, with a value or 'end' behind it, such as io.estop trip end")
        target, verb, *more = words
        if more[-1:] == ["end"]:
            if not self._faults.withdraw(target, verb):
                raise ValueError(f"{target} {verb} is not active, so there is nothing to end")
            self._log(LET_GO, f"{target} {verb}")
            return
        if len(more) > 1:
            raise ValueError(f"found {len(more)} words behind {target} {verb}; allowed: one value, or 'end'")
        fault: dict[str, object] = {"target": target, "verb": verb, "when": {"time_s": 0.0}}
        fault |= {"value": _number(more[0])} if more else {}
        self._faults.inject([Fault.model_validate(fault, context=self._context)])


def _number(text: str) -> float:
    """Return a value as it is typed; ValueError for what is no number."""
    try:
        return float(int(text, 16)) if text.lower().startswith("0x") else float(text)
    except ValueError:
        raise ValueError(f"found the value {text!r}; allowed is a number, such as 0.5 or 0x6072") from None


class ParentInput:
    """Our standard input: lines about the controller; when the parent dies, however it dies, its end closes."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        stop: asyncio.Event,
        tell: Callable[[str, int, int], None],
        log: LogLine,
        hands: Hands | None = None,
    ) -> None:
        """Hear a parent; hands: those of somebody at the bench, whose doings the parent passes on."""
        self._loop, self._stop = loop, stop
        self._tell, self._log = tell, log
        self._hands = hands
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
        """Take a line about the controller (its state, scan of entry, newest scan), a hand, or what the station did."""
        try:
            told = json.loads(line)
            if "hand" in told and self._hands is not None:
                self._hands.hear(str(told["hand"]).split())
                return
            if "acted" in told:
                self._log(ACTED, str(told["acted"]), value=told["value"], clock_ns=int(told["clock_ns"]))
                return
            self._tell(str(told["state"]), int(told["scan"]), int(told["entered"]))
        except (ValueError, KeyError, TypeError):
            self._log("not_understood", f"on standard input: {line[:80]!r}")
