"""Keys of a jog: what whoever holds one says becomes the token that the scan counts the age of.

Nothing is kept here: a token is passed on when it comes, and one that was long on its way is not passed on at all. So
whatever hangs, be it the page, the network or this process, the scan misses the tokens, and stops by itself. Nor does
anything queue up for a scan that stands still: while it has not taken one token, no other is passed on.
"""

from __future__ import annotations

import json
import os
import select
import time
from collections.abc import Callable
from typing import NamedTuple

from definitions.image import Command, State
from definitions.jog import PHASE_ROWS
from station.records.ring.reader import RingReader
from station.records.samples.scan_record import unpack

OLDEST_TOKEN_S = 0.1
"""On its way from the key to here, a token may take this long."""

CHUNK = 4096
END, PRESS, LET_GO = "end", "press", "let-go"
KEYS = {"+": Command.JOG_POSITIVE, "-": Command.JOG_NEGATIVE}
ENABLING_DEVICE = "io.enabling_device press"
"""Name of the contact in the vocabulary of the virtual bench."""


class Heard(NamedTuple):
    """What was said: a key, or what else somebody does, and when [ns on the monotonic clock]; None: just now."""

    word: str
    at_ns: int | None = None


class Lines:
    """Says of a program that passes keys on, a line each: `+ 123456789` is a key with the time at which it was held."""

    def __init__(self, handle: int) -> None:
        os.set_blocking(handle, False)
        self._handle, self._rest = handle, b""

    def heard(self) -> list[Heard]:
        """Return what has come; the end of the input is the end of the jog."""
        said: list[Heard] = []
        while True:
            try:
                chunk = os.read(self._handle, CHUNK)
            except BlockingIOError:
                return said
            if not chunk:
                return [*said, Heard(END)]
            *lines, self._rest = (self._rest + chunk).split(b"\n")
            said += [one for line in lines if (one := self._said(line)) is not None]

    @staticmethod
    def _said(line: bytes) -> Heard | None:
        word, _, at = line.decode("ascii", "replace").partition(" ")
        if word not in KEYS:
            return Heard(word)
        return Heard(word, int(at)) if at.isdecimal() else None


class Typed:
    """Says of a person at the terminal: a key that is held repeats."""

    WORDS = {"+": "+", "=": "+", "-": "-", "q": END, "e": PRESS, "r": LET_GO}  # noqa: RUF012 - never changed

    def __init__(self, handle: int) -> None:
        self._handle = handle

    def heard(self) -> list[Heard]:
        """Return what was typed since the last look."""
        said: list[Heard] = []
        while select.select([self._handle], [], [], 0)[0]:
            typed = os.read(self._handle, CHUNK)
            if not typed:
                return [*said, Heard(END)]
            said += [Heard(self.WORDS[one]) for one in typed.decode("ascii", "replace") if one in self.WORDS]
        return said


class Keys:
    """Attends a jog: passes tokens on to the scan, and tells what the person does next."""

    def __init__(
        self,
        heard: Callable[[], list[Heard]],
        say: Callable[[str], None],
        bench: Callable[[], Callable[[bytes], None] | None],
        oldest_s: float = OLDEST_TOKEN_S,
    ) -> None:
        """heard: what was said since the last look. bench: what takes lines for an embedded virtual bench, or None."""
        self._heard, self._say, self._bench = heard, say, bench
        self._oldest_ns = round(oldest_s * 1e9)
        self._shown = 0
        self._ended = False
        self._pressed = False

    def attend(self, ring: RingReader) -> None:
        """Take what was said since the last look; the newest key counts, once."""
        token, now_ns = None, time.monotonic_ns()
        for word, at_ns in self._heard():
            if word == END and not self._ended:
                self._ended = True
                ring.send(Command.STOP)
            elif word in (PRESS, LET_GO):
                self._press(down=word == PRESS)
            elif word in KEYS and (at_ns is None or 0 <= now_ns - at_ns <= self._oldest_ns):
                token = KEYS[word]
        if token is not None and not self._ended and not ring.commands_waiting:
            ring.send(token)
        _, _, orders = unpack(ring.last())
        if orders.state == State.JOG and orders.phase != self._shown and orders.phase in PHASE_ROWS:
            self._shown = orders.phase
            row = PHASE_ROWS[orders.phase]
            self._say(f"{row.words}. {row.next_action}")

    def _press(self, *, down: bool) -> None:
        """Press or let go of the enabling device of an embedded virtual bench; a real one is pressed by a hand."""
        tell = self._bench()
        if tell is None or down == self._pressed:
            return
        self._pressed = down
        hand = ENABLING_DEVICE if down else f"{ENABLING_DEVICE} end"
        tell(json.dumps({"hand": hand}).encode() + b"\n")
