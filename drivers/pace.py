"""The pace of a virtual bench: after every scan the bench is told so, lets one period pass, and says that it has.

A bench that waits has no clock of its own: its time is the number of scans. What makes that exact is counting. The
message "scan n has ended" says how many frames and Modbus requests were sent before it; the bench acts when it has all
of them. Its answer says how many frames and bytes it has sent; the scan reads when all of them are there. Different
sockets may deliver in any order, and nobody ever waits for what a fault has swallowed, because that is not counted.

The answer is waited for at most `LONGEST_WAIT_S`. After that the scan goes on without it, values age as on any bench,
and the next answer in time makes both one again. A bench on real hardware has no pace: this file is not used for it.
"""

from __future__ import annotations

import select
import socket
import struct
import time
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, NoReturn

from drivers.errors import PaceError, Problem

LONGEST_WAIT_S = 1.5
"""Longest wait of a scan for the bench; then its values age, and it is not waited for until it answers again.

A busy host holds a process up for half a second now and then: that is no fault of the bench. Shorter than the silence
after which the bench gives the scan up (`virtual_bench.pace_port.QUIET_S`): else each would take the other for dead.
"""

UNIT_BYTES = 48
_CLOSED = "the virtual bench closed the connection. Start the virtual bench again, then the run"
_NOT_THERE = "start the virtual bench first, or remove 'pace': real hardware has none"


class Kind(IntEnum):
    """What a message to the bench says."""

    HELLO = 0
    BEGIN = 1
    SCAN_ENDED = 2


class ToBench(NamedTuple):
    """Message to the bench; frames and requests are counted from BEGIN on. `number`: period in ns, or the scan.

    `requests`: of each Modbus device, in the order of the bench file.
    """

    kind: int
    number: int
    state: int
    frames: int
    requests: tuple[int, ...]


class FromBench(NamedTuple):
    """Answer of the bench to the scan `number`: periods that the scan has missed, what was sent since BEGIN.

    Periods are missed by a fault, or while the bench went on without a scan that had been silent for too long.
    """

    number: int
    missed: int
    frames: int
    answered: tuple[int, ...]
    """Bytes of the answers of each Modbus device, in the order of the bench file."""
    unit: bytes


MOST_DEVICES = 8
"""Modbus devices of a bench; a message has room for the counts of so many."""

TO_BENCH = struct.Struct(f"<BqiI{MOST_DEVICES}I")
FROM_BENCH = struct.Struct(f"<qII{MOST_DEVICES}I{UNIT_BYTES}s")
BEGUN = -1
"""Number of the answers to HELLO and BEGIN."""

_NO_COUNTS = (0,) * MOST_DEVICES


def to_bench(message: ToBench) -> bytes:
    """Return a message as it is sent."""
    return TO_BENCH.pack(*message[:4], *message.requests, *_NO_COUNTS[len(message.requests) :])


def from_bytes_to_bench(data: bytes) -> ToBench:
    """Return the message at the beginning of `data`."""
    kind, number, state, frames, *requests = TO_BENCH.unpack_from(data)
    return ToBench(kind, number, state, frames, tuple(requests))


def from_bench(answer: FromBench) -> bytes:
    """Return an answer as it is sent."""
    counts = (*answer.answered, *_NO_COUNTS[len(answer.answered) :])
    return FROM_BENCH.pack(answer.number, answer.missed, answer.frames, *counts, answer.unit)


def from_bytes_from_bench(data: bytes) -> FromBench:
    """Return the answer at the beginning of `data`."""
    number, missed, frames, *answered, unit = FROM_BENCH.unpack_from(data)
    return FromBench(number, missed, frames, tuple(answered), unit)


@dataclass(frozen=True)
class PaceConfig:
    """Where the virtual bench takes its pace."""

    host: str
    port: int

    @property
    def where(self) -> str:
        """The port as a person would look for it."""
        return f"pace {self.host}:{self.port}"


class Pace:
    """The scan's end of the connection: `open`, `begin`, then `scan_ended` and `wait` in turn, which never raise."""

    def __init__(self, config: PaceConfig) -> None:
        self.config = config
        self.unit = ""
        """Unit on the virtual bench, as the bench says."""
        self.unanswered = 0
        """Waits that ended without an answer."""
        self.answer = FromBench(BEGUN, 0, 0, _NO_COUNTS, b"")
        """The newest answer."""
        self._socket: socket.socket | None = None
        self._received = b""
        self._asked = BEGUN
        self._in_step = True

    @property
    def in_step(self) -> bool:
        """Whether the bench waits for us: it has answered within the bound, and nothing is wrong with the line."""
        return self._in_step and self._socket is not None

    def open(self, timeout_s: float) -> None:
        """Connect and hear which unit is on the bench (blocking); PaceError where no virtual bench answers."""
        try:
            self._socket = socket.create_connection((self.config.host, self.config.port), timeout=timeout_s)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._ask(Kind.HELLO, 0)
        except OSError as error:
            self._refuse(error)
        self.unit = self.answer.unit.rstrip(b"\0").decode(errors="replace")

    def begin(self, period_ns: int) -> None:
        """Let the bench wait from now on (blocking); PaceError where it does not answer."""
        try:
            self._ask(Kind.BEGIN, period_ns)
            if self._socket is not None:
                seconds, rest_s = divmod(LONGEST_WAIT_S, 1.0)
                wait = struct.pack("ll", int(seconds), round(rest_s * 1e6))
                self._socket.settimeout(None)
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, wait)
        except OSError as error:
            self._refuse(error)

    def _ask(self, kind: Kind, number: int) -> None:
        if self._socket is None:
            raise ConnectionResetError(_CLOSED)
        self._socket.sendall(to_bench(ToBench(kind, number, 0, 0, ())))
        while len(self._received) < FROM_BENCH.size:
            self._received += _some(self._socket)
        self._take()

    def _refuse(self, error: OSError) -> NoReturn:
        self.close()
        raise PaceError(
            Problem("no virtual bench waits there", self.config.where, str(error), "an answer", _NOT_THERE)
        ) from error

    def scan_ended(self, scan: int, state: int, frames: int, requests: tuple[int, ...]) -> None:
        """Tell the bench that a scan has sent everything: `frames` and `requests` of each device since BEGIN."""
        if self._socket is None:
            return
        self._asked = scan
        try:
            self._socket.sendall(to_bench(ToBench(Kind.SCAN_ENDED, scan, state, frames, requests)))
        except OSError:
            self.close()

    def wait(self) -> int:
        """Wait until the bench has let the period pass, bounded; return how many periods we have missed."""
        missed = 0
        until = time.monotonic() + LONGEST_WAIT_S
        while self._socket is not None and self.answer.number != self._asked:
            try:
                flags = 0 if self._in_step else socket.MSG_DONTWAIT
                self._received += _some(self._socket, flags)
            except BlockingIOError:
                self.unanswered += 1
                self._in_step = False
                break
            except OSError:
                self.close()
                break
            missed += self._take()
            if time.monotonic() > until:
                self._in_step = False
        self._in_step |= self.answer.number == self._asked
        return missed

    def _take(self) -> int:
        missed = 0
        while len(self._received) >= FROM_BENCH.size:
            self.answer = from_bytes_from_bench(self._received)
            self._received = self._received[FROM_BENCH.size :]
            missed += self.answer.missed
        return missed

    def close(self) -> None:
        """Let the bench go on by the wall clock; safe to call twice."""
        if self._socket is not None:
            with suppress(OSError):
                self._socket.close()
        self._socket = None


def readable(descriptor: int, timeout_s: float | None) -> bool:
    """Wait until something can be read, at most `timeout_s` where there is one; False when nothing came."""
    return bool(select.select([descriptor], [], [], timeout_s)[0])


def _some(client: socket.socket, flags: int = 0) -> bytes:
    """Receive what is there; OSError at the end of the connection."""
    received = client.recv(4096, flags)
    if not received:
        raise ConnectionResetError(_CLOSED)
    return received
