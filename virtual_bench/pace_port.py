"""Where a virtual bench takes its pace: a port on which a scan says when it has ended, and gets its answer.

The bench acts on a message when everything that was sent before it is there. Without a message for `QUIET_S`, and at
once when the connection ends, the bench goes on by the wall clock: a scan that died is noticed by the drive's own
watch, as on any bench. A scan that is there again after that has missed the periods that passed meanwhile.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from typing import Protocol, cast

from drivers.pace import BEGUN, TO_BENCH, UNIT_BYTES, FromBench, Kind, ToBench, from_bench, from_bytes_to_bench

QUIET_S = 2.0
"""Silence of a scan that leads, by the wall clock, after which the bench does not wait for it any longer."""

MOST_OF_A_LOOK_S = 0.1
"""Silence that one look may add: what this process slept longer, held up itself, it could have heard nothing in."""

LONGEST_WAIT_S = 0.05
"""Longest wait for frames and requests that were sent before a message; what is not there by then is given up.

Twice in a row: after a hold-up of this process its timers run before it has looked what has come meanwhile.
"""

Log = Callable[[str, str], None]


class Led(Protocol):
    """What leads and is led: the virtual bench."""

    @property
    def unit(self) -> str:
        """Name of the unit on the bench."""

    def begin(self, period_ns: int) -> None:
        """Begin to wait for a scan."""

    def wait_again(self) -> None:
        """Wait for a scan that had been given up, and is there again; it has missed what passed meanwhile."""

    def missing(self, message: ToBench) -> bool:
        """Tell whether something that was sent before a message is not there yet."""

    def give_up(self, message: ToBench) -> None:
        """Do without what is missing."""

    def let_scan_pass(self, message: ToBench) -> FromBench:
        """Do what has come, let the period pass, and return the answer."""

    def go_on(self) -> None:
        """Go on by the wall clock."""


class PacePort:
    """The port, for one scan at a time."""

    def __init__(self, bench: Led, log: Log) -> None:
        self._bench, self._log = bench, log
        self._server: asyncio.Server | None = None
        self._scan: _Connection | None = None
        self._waiting: deque[ToBench] = deque()
        self._silent_s = self._looked_s = 0.0
        self._timer: asyncio.TimerHandle | None = None

    async def start(self, host: str, port: int) -> int:
        """Listen and return the port; port 0 takes a free one. Raises `OSError` when it cannot be had."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Connection(self), host, port)
        return int(self._server.sockets[0].getsockname()[1])

    async def stop(self) -> None:
        """Close the port and the connection."""
        if self._server is not None:
            self._server.close()
        if self._scan is not None:
            self._scan.close()

    def look(self) -> None:
        """Give up a scan that says nothing any more; called at every tick."""
        now_s = time.monotonic()
        self._silent_s += min(now_s - self._looked_s, MOST_OF_A_LOOK_S)
        self._looked_s = now_s
        if self._scan is not None and self._scan.leads and self._silent_s > QUIET_S:
            self._scan.leads = False
            self._let_go(f"the scan has not ended for {QUIET_S:g} s")

    def arrived(self) -> None:
        """Look whether everything that was sent before the oldest message is there now; then act on it."""
        while self._waiting and not self._bench.missing(self._waiting[0]):
            self._act()

    def heard(self, connection: _Connection, message: ToBench) -> None:
        """Take a message."""
        self._silent_s, self._looked_s = 0.0, time.monotonic()
        if message.kind == Kind.HELLO:
            unit = self._bench.unit.encode().ljust(UNIT_BYTES, b"\0")[:UNIT_BYTES]
            connection.answer(FromBench(BEGUN, 0, 0, (), unit))
        elif message.kind == Kind.BEGIN:
            if self._scan is not None and self._scan is not connection and self._scan.leads:
                self._log("pace_refused", "another scan leads already")
                connection.close()
                return
            self._scan = connection
            connection.leads = True
            self._bench.begin(message.number)
            self._log("pace_begun", f"the bench waits for a scan of {message.number / 1e6:g} ms")
            connection.answer(FromBench(BEGUN, 0, 0, (), b""))
        elif connection is self._scan:
            if not connection.leads:
                connection.leads = True
                self._bench.wait_again()
            self._waiting.append(message)
            self.arrived()
            if self._waiting and self._timer is None:
                self._timer = asyncio.get_running_loop().call_later(LONGEST_WAIT_S, self._wait_once_more)

    def ended(self, connection: _Connection) -> None:
        """Forget a connection."""
        if connection is self._scan:
            led, self._scan = connection.leads, None
            if led:
                self._let_go("the scan has closed its connection")

    def _wait_once_more(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(LONGEST_WAIT_S, self._give_up)

    def _give_up(self) -> None:
        self._timer = None
        if self._waiting:
            self._log("pace_missing", f"something that scan {self._waiting[0].number} sent did not arrive")
            self._bench.give_up(self._waiting[0])
            self.arrived()

    def _act(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        answer = self._bench.let_scan_pass(self._waiting.popleft())
        if self._scan is not None:
            self._scan.answer(answer)

    def _let_go(self, why: str) -> None:
        while self._waiting:
            self._act()
        self._log("pace_ended", f"{why}: the bench goes on by the wall clock")
        self._bench.go_on()


class _Connection(asyncio.Protocol):
    """One scan's connection."""

    def __init__(self, port: PacePort) -> None:
        self._port = port
        self._buffer = b""
        self.leads = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the connection; asyncio has switched Nagle's algorithm off already."""
        self._transport = cast("asyncio.Transport", transport)  # a TCP server makes no other

    def connection_lost(self, exc: Exception | None) -> None:
        """Let the bench go on."""
        del exc
        self._port.ended(self)

    def data_received(self, data: bytes) -> None:
        """Take messages; what is incomplete waits for the rest."""
        self._buffer += data
        while len(self._buffer) >= TO_BENCH.size:
            message = from_bytes_to_bench(self._buffer)
            self._buffer = self._buffer[TO_BENCH.size :]
            self._port.heard(self, message)

    def answer(self, answer: FromBench) -> None:
        """Send an answer."""
        if not self._transport.is_closing():
            self._transport.write(from_bench(answer))

    def close(self) -> None:
        """End the connection at once."""
        self._transport.abort()
