"""A label printer that is reached over TCP and speaks ZPL: its state by `~HS`, and a label sent to it.

Facts of `~HS` are from the maker's programming guide: three lines, each between STX and ETX. A printer without paper or
ribbon, or with its head open, may give no answer at all.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from station.errors import StationError

ASK = b"~HS"
STX, ETX = b"\x02", b"\x03"
LINES = 3
LONGEST_ANSWER = 1024
LEAST_WAIT_S = 0.001

FIRST = ("settings", "paper_out", "paused", "length", "waiting", "buffer_full", "diagnostic", "partial", "unused",
         "memory_lost", "too_cold", "too_hot")  # fmt: skip
SECOND = ("functions", "unused", "head_open", "ribbon_out", "by_ribbon", "mode", "width", "at_peeler", "left")
"""Names of the values of the first two lines, in their order."""

TROUBLES = {
    "paper_out": "The printer has no labels. Put a new roll in",
    "head_open": "The head of the printer is open. Close it",
    "ribbon_out": "The printer has no ribbon. Put a new one in",
    "paused": "The printer is paused. Press its pause key",
    "buffer_full": "The printer has more labels waiting than it can hold. Switch it off and on",
    "memory_lost": "The printer has lost its settings. Call the technician",
    "too_cold": "The head of the printer is too cold. Wait",
    "too_hot": "The head of the printer is too hot. Wait",
}
"""What keeps a printer from printing, and what to do; the first that is true is told."""


class PrinterError(StationError):
    """The printer cannot be reached, or cannot print now: why, and what to do."""


class Status(NamedTuple):
    """The state of a printer: what keeps it from printing ('' : nothing), and labels that wait in it."""

    trouble: str
    waiting: int

    @property
    def idle(self) -> bool:
        """Whether it has printed all that it was sent."""
        return not self.trouble and not self.waiting


def parse_status(answer: bytes) -> Status:
    """Return what the three lines of `~HS` say; PrinterError where they are none."""
    lines = [part.partition(ETX)[0] for part in answer.split(STX)[1:]]
    try:
        first, second = (line.decode("ascii").split(",") for line in lines[:2])
        one = dict(zip(FIRST, map(int, first), strict=False)) | dict(zip(SECOND, map(int, second), strict=False))
        waiting = one["waiting"] + one["left"] + one["partial"]
        if not one["by_ribbon"]:
            one["ribbon_out"] = 0  # without a ribbon none can be missing
        found = next((text for name, text in TROUBLES.items() if one[name]), "")
    except (ValueError, KeyError, UnicodeDecodeError):
        raise PrinterError(
            f"The printer gave no ZPL status ('~HS'), but {answer[:40]!r}. Use a printer that understands ZPL"
        ) from None
    return Status(found, waiting)


class Line:
    """An open connection to a printer."""

    def __init__(self, connection: socket.socket, timeout_s: float) -> None:
        self._connection, self._timeout_s = connection, timeout_s

    def status(self) -> Status:
        """Ask for its state; PrinterError where it gives none in time, however many parts of one it gives."""
        end_s = time.monotonic() + self._timeout_s
        try:
            self._connection.settimeout(self._timeout_s)
            self._connection.sendall(ASK)
            answer = b""
            while answer.count(ETX) < LINES:
                self._connection.settimeout(max(end_s - time.monotonic(), LEAST_WAIT_S))
                got = self._connection.recv(LONGEST_ANSWER)
                if not got or len(answer) > LONGEST_ANSWER:
                    raise PrinterError("The printer ended the connection. Switch it off and on")
                answer += got
        except TimeoutError:
            raise PrinterError("The printer does not answer. Check labels, ribbon and print head") from None
        except OSError as error:
            raise PrinterError(f"The connection to the printer is lost: {error.strerror}. Check its cable") from error
        return parse_status(answer)

    def send(self, label: str) -> None:
        """Send a label; PrinterError where it may not have arrived as a whole."""
        try:
            self._connection.settimeout(self._timeout_s)
            self._connection.sendall(label.encode("utf-8"))
        except OSError as error:
            raise PrinterError(f"The connection to the printer is lost: {error.strerror}. Check its cable") from error


@contextmanager
def connected(host: str, port: int, timeout_s: float) -> Iterator[Line]:
    """Connect to a printer; PrinterError where it is not there."""
    try:
        connection = socket.create_connection((host, port), timeout_s)
    except (OSError, UnicodeError) as error:  # the second: of a name that no computer can have
        why = f"The printer at {host}:{port} cannot be reached: {getattr(error, 'strerror', None) or error}"
        raise PrinterError(f"{why}. Switch it on, check its cable") from error
    with connection:
        yield Line(connection, timeout_s)
