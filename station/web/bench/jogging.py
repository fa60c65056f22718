"""The jog of a station: `lostmotion jog` in a process of its own, and the key that a page holds.

The process moves nothing by itself: it passes on the tokens that come from here, and the scan stops without them. A
token is made of an answer of the page, given while its key is held, and carries the moment at which the page was
asked. So a page that hangs, a network that is slow or cut, and a server that ends all look the same to the scan.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import RLock, Thread

from definitions.jog import TOKEN_EVERY_S
from definitions.program import Program
from station.documents.manifest import RunningProcess
from station.errors import StationError
from station.own_program import own_module
from station.records.run_record import RunRecord, running_process
from station.run.jog.jogs import FOLDER, program_of
from station.run.jog.keys import END, LET_GO, PRESS
from station.web.running import RUNNING, STARTING, Now, Running

OUTPUT = "station-jog.log"
"""What the last started process said; of one that was refused it is the reason."""

SIGNS = {1: "+", -1: "-"}
LOST_AFTER_S = 1.0
"""A held key without any token for so long was let go without a word. The shaft has stopped long before."""

ABANDONED_S = 30.0
"""A jog that no page looks at is ended after this time."""

LAST_WORDS = 3


@dataclass(frozen=True)
class Jogged:
    """How the jog stands. now: of its record. mine: this session began it. held: direction of the key, 0 for none.

    program: of the jog that is on, None where it cannot be read. said: the last words of one that did not begin.
    """

    now: Now
    mine: bool = False
    held: int = 0
    embedded: bool = False
    program: Program | None = None
    said: str = ""

    @property
    def on(self) -> bool:
        """Whether a jog is on, or begins."""
        return self.now.stage in (STARTING, RUNNING)


class Jogging:
    """The jog of the bench of one data folder."""

    def __init__(self, data: Path, lost: Callable[[str], None]) -> None:
        """lost: called with the name of whoever held a key that was lost."""
        self._data, self._lost = data, lost
        self._running = Running(data / FOLDER)
        self._process: subprocess.Popen[bytes] | None = None
        self._one_at_a_time = RLock()
        self._owner = self._name = ""
        self._begun: RunningProcess | None = None
        self._held = 0
        self._heard_s = self._seen_s = 0.0
        self._program: tuple[str, Program | None, bool] = ("", None, False)

    def start(self, words: list[str], owner: str, name: str) -> None:
        """Start the process; owner: the token of the session whose page may hold the key. StationError: it cannot."""
        command = own_module("station", "jog", *words, "--by-lines")
        command += ["--operator", name, "--data", str(self._data)]
        with self._one_at_a_time:
            try:
                with (self._data / OUTPUT).open("wb") as output:
                    self._process = process = subprocess.Popen(  # noqa: S603 - our own program
                        command, stdin=subprocess.PIPE, stdout=output, stderr=output, start_new_session=True
                    )
            except OSError as error:
                raise StationError(f"the jog cannot be started: {error.strerror}") from error
            assert process.stdin is not None  # noqa: S101 - it was asked for
            os.set_blocking(process.stdin.fileno(), False)
            self._begun = running_process(process.pid)
            self._owner, self._name, self._held = owner, name, 0
            self._seen_s = time.monotonic()
        Thread(target=self._watch, args=(process,), daemon=True).start()

    def hold(self, owner: str, direction: int) -> bool:
        """Let the tokens of this direction count from now on; False where that session has begun no jog."""
        with self._one_at_a_time:
            if not self._is_mine(owner):
                return False
            self._held, self._heard_s = direction, time.monotonic()
            return True

    def release(self, owner: str) -> bool:
        """Let no token count any more; False where that session holds no key."""
        with self._one_at_a_time:
            held = self._held if self._is_mine(owner) else 0
            self._held = 0 if held else self._held
            return bool(held)

    def token(self, owner: str, direction: int, asked_ns: int) -> None:
        """Pass on that the page said so, asked at this moment on the monotonic clock, while its key is held."""
        with self._one_at_a_time:
            if self._is_mine(owner) and direction == self._held and direction in SIGNS:
                self._heard_s = time.monotonic()
                self._say(f"{SIGNS[direction]} {asked_ns}")

    def press(self, *, down: bool) -> bool:
        """Press the enabling device of an embedded virtual bench, or let go; False where there is none."""
        if not self.standing().embedded:
            return False
        with self._one_at_a_time:
            self._say(PRESS if down else LET_GO)
        return True

    def end(self) -> bool:
        """End the jog that this server has begun; False where there is none."""
        with self._one_at_a_time:
            if not self._alive():
                return False
            self._held = 0
            self._say(END)
            return True

    def standing(self, owner: str = "") -> Jogged:
        """Return how the jog stands; owner: the session of the page that looks."""
        now = self._running.now()
        with self._one_at_a_time:
            mine, alive = self._is_mine(owner), self._alive()
            if mine:
                self._seen_s = time.monotonic()
            if alive and now.stage not in (STARTING, RUNNING) and not self._ended(now):
                now = Now(STARTING)
            said = "" if alive or self._process is None or self._process.returncode == 0 else self._last_words()
            program, embedded = self._about(now)
            return Jogged(now, mine, self._held, embedded, program, said)

    def close(self) -> None:
        """End the process: nobody holds its key any more."""
        with self._one_at_a_time:
            if self._process is not None and self._process.stdin is not None:
                with suppress(OSError):
                    self._process.stdin.close()

    def _ended(self, now: Now) -> bool:
        """Say whether what is told as ended is the record of the process that is still putting it away."""
        with suppress(StationError):
            record = RunRecord(self._data / FOLDER / now.run)
            if now.run and self._process is not None:
                return record.manifest().desk == self._begun
        return False

    def _about(self, now: Now) -> tuple[Program | None, bool]:
        if now.stage != RUNNING:
            return None, False
        if self._program[0] != now.run:
            record = RunRecord(self._data / FOLDER / now.run)
            try:
                self._program = (now.run, program_of(record), record.manifest().bench.embedded)
            except StationError:
                return None, False  # it is being written
        return self._program[1], self._program[2]

    def _is_mine(self, owner: str) -> bool:
        return bool(owner) and owner == self._owner and self._alive()

    def _alive(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def _say(self, line: str) -> None:
        """Write a line; a process that does not read misses it, as one that has ended."""
        if self._process is not None and self._process.stdin is not None:
            with suppress(OSError, ValueError):
                os.write(self._process.stdin.fileno(), line.encode() + b"\n")

    def _last_words(self) -> str:
        with suppress(OSError):
            lines = (self._data / OUTPUT).read_text(encoding="utf-8", errors="replace").strip().splitlines()
            return " ".join(lines[-LAST_WORDS:])
        return ""

    def _watch(self, process: subprocess.Popen[bytes]) -> None:
        """See to it that a key that is not heard of counts as let go, and that a jog ends that nobody looks at."""
        while process.poll() is None:
            time.sleep(2 * TOKEN_EVERY_S)
            lost = ""
            with self._one_at_a_time:
                if self._process is not process:
                    return
                now_s = time.monotonic()
                if self._held and now_s - self._heard_s > LOST_AFTER_S:
                    self._held, lost = 0, self._name
                if now_s - self._seen_s > ABANDONED_S:
                    self._say(END)
            if lost:
                with suppress(StationError):
                    self._lost(lost)
