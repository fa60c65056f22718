"""Another definition of a metric on trial, evaluated in a process of its own while pages go on: one trial at a time.

Thousands of runs take minutes, so nobody waits: a page looks how far it is. A server that ends takes the process with
it; the ledger keeps what was evaluated, and the same trial goes on from there.
"""

# ruff: noqa: PLC0415 - what evaluates is loaded in the other process, and not in the server

from __future__ import annotations

import os
import signal
import sys
import time
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.util import get_temp_dir
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from analysis.trace.errors import AnalysisError
from recipes import RecipeError
from station.errors import StationError
from station.quality.limits_trial import Trial, Tried
from station.store.quality.lot import Lot

WORKERS = 1
"""Processes that evaluate: a bench may measure on the same computer."""

MOST_FLIPS = 50
LOOK_FOR_SERVER_S = 1.0
TO_CLEAR_UP_S = 10.0
"""Time that a process has to end in order when its server is gone."""

ENDED = "The process that evaluates ended. Press Try again: it goes on where it ended."


@dataclass(frozen=True)
class TrialState:
    """What is on trial over which lot, how many runs are done, and what came of it.

    known: how many were done when it began. error: why nothing came of it.
    """

    lot: Lot
    tried: Tried
    done: int = 0
    of: int = 0
    known: int = 0
    seconds: float = 0.0
    found: Trial | None = None
    error: str = ""

    @property
    def running(self) -> bool:
        """Whether runs are being evaluated."""
        return self.found is None and not self.error


class DefinitionTrials:
    """The trial that is on, or the one that ended last."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process: Any = None
        self._state: TrialState | None = None

    @property
    def state(self) -> TrialState | None:
        """What is on trial, or was last; None before the first."""
        return self._state

    def start(self, data: Path, lot: Lot, tried: Tried) -> None:
        """Begin a trial.

        Raises:
            StationError: another one is on, or the process cannot be started.

        """
        with self._lock:
            now = self._state
            if now is not None and now.running:
                raise StationError(
                    f"'{now.tried.definition}' is on trial: {now.done} of {now.of} runs evaluated. Wait until it ends, "
                    "or stop it"
                )
            # Spawned, not forked: the server has threads, and what they hold a fork would hold for ever.
            context = get_context("spawn")
            ours, theirs = context.Pipe(duplex=False)
            process = context.Process(target=_evaluate, args=(theirs, os.getpid(), data, lot, tried))
            try:
                process.start()
            except OSError as error:
                ours.close()
                raise StationError(f"The trial cannot be started: {error.strerror}. Press Try again.") from error
            finally:
                theirs.close()  # so that the end of the process is the end of the line
            self._state, self._process = TrialState(lot, tried), process
        Thread(target=self._follow, args=(ours, process, time.monotonic()), daemon=True).start()

    def stop(self) -> None:
        """End the trial that is on; what was evaluated is kept in its ledger."""
        with self._lock:
            now, process = self._state, self._process
            if now is None or not now.running:
                return
            self._state = replace(now, error=f"Stopped after {now.done} of {now.of} runs. Try goes on from there.")
        process.terminate()

    def close(self) -> None:
        """End the process with the server."""
        self.stop()
        if self._process is not None:
            self._process.join()

    def _follow(self, connection: Connection, process: Any, begun: float) -> None:
        """Note what the process tells until it ends."""
        try:
            while True:
                self._note(process, seconds=time.monotonic() - begun, **connection.recv())
        except (EOFError, OSError):
            process.join()
            self._note(process, error=ENDED)

    def _note(self, process: Any, **told: Any) -> None:
        """Change the state, unless the trial has ended or is another one by now."""
        with self._lock:
            now = self._state
            if now is None or not now.running or process is not self._process:
                return
            if not now.of and "done" in told:
                told["known"] = told["done"]
            self._state = replace(now, **told)


def _evaluate(connection: Connection, server: int, data: Path, lot: Lot, tried: Tried) -> None:
    """Evaluate a lot and tell what becomes of it; end with the server, also where that was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server
    _end_in_order()

    def watch() -> None:
        while os.getppid() == server:
            time.sleep(LOOK_FOR_SERVER_S)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(TO_CLEAR_UP_S)
        os._exit(0)

    Thread(target=watch, daemon=True).start()
    from station.reevaluation.definition_trial import definition_trial

    try:
        found = definition_trial(data, lot, tried, WORKERS, MOST_FLIPS, lambda done, of: _tell(connection, done, of))
        connection.send({"found": found})
    except (StationError, AnalysisError, RecipeError) as error:
        connection.send({"error": str(error)})


def _end_in_order() -> None:
    """Have a process that is stopped end its own processes and remove their folder in the place of temporary files.

    The folder is made first, and meanwhile the process does not end: between its making and the note that it is to be
    removed it would be left.
    """
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: stopped.append(number))
    get_temp_dir()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    if stopped:
        sys.exit(1)


def _tell(connection: Connection, done: int, of: int) -> None:
    connection.send({"done": done, "of": of})
