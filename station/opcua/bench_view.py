"""What is known of the bench now, read from what runs leave: the run or the jog that is on, or the run before."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

from controller.aftermath import FaultReaction
from definitions.image import State
from definitions.program import Program
from definitions.states import row_of
from station.errors import StationError
from station.opcua.projection import Projected, projected
from station.opcua.values import NOTHING, Value, aged, values_of
from station.records.newest_runs import newest_runs
from station.records.run_record import INTERRUPTED, NOT_CONCLUDED
from station.records.samples.scan_record import unpack
from station.run.jog.jogs import jogs, program_of
from station.run.way_back.begins_at import PASSED_OVER
from station.run.way_back.how_left import HowLeft, how_left
from station.run.way_back.recoveries import recoveries, was_recovered
from station.web.running import ENDED, RUNNING, STARTING, Now, Running

QUIET_S = 1.0
"""A run whose newest record is older than this has no live values."""

STATE_OF_RUN: dict[str, State] = {
    "complete": State.COMPLETE, "stopped": State.STOPPED, "fault": State.FAULT,
    INTERRUPTED: State.FAULT, NOT_CONCLUDED: State.FAULT,
}  # fmt: skip
"""State of the bench after a run, by how the run ended: after an interrupted one it has to be recovered."""


@dataclass(frozen=True)
class BenchNow:
    """What the bench shows: states as the standards name them, words, and values with their status."""

    states: Projected
    texts: dict[str, str] = field(default_factory=dict)
    values: dict[str, Value] = field(default_factory=lambda: dict(NOTHING))


class BenchView:
    """The bench of one data folder."""

    def __init__(self, data: Path) -> None:
        self._data, self._running = data, Running(data)
        self._recovery, self._jog = Running(recoveries(data).data), Running(jogs(data).data)
        self._values = dict(NOTHING)
        self._newest, self._changed_s = b"", 0.0
        self._jog_program: tuple[str, Program] | None = None

    def look(self) -> BenchNow:
        """Return what is known now."""
        now = self._running.now()
        recovery, jog = self._recovery.now(), self._jog.now()
        if recovery.stage == RUNNING:
            now = recovery
        if jog.stage == RUNNING:
            now = replace(jog, serial="", program=self._program_of_jog(jog))  # the unit is not measured
        on = now.stage in (STARTING, RUNNING)
        state, settled = self._live(now) if on else (self._left(now), True)
        if not on:
            self._values = aged(self._values)
        words = "nothing is known of the bench" if state is None else row_of(state).words
        texts = {
            "State": "" if state is None else state.name.lower(), "StateText": words,
            "Run": now.run, "SerialNumber": now.serial, "Recipe": now.recipe,
        }  # fmt: skip
        return BenchNow(projected(state, settled=settled), texts, self._values)

    def _program_of_jog(self, jog: Now) -> Program | None:
        """Return the program of the jog that is on; None while it is being written."""
        if self._jog_program is None or self._jog_program[0] != jog.run:
            record = jogs(self._data).by_id(jog.run)
            with suppress(StationError):
                self._jog_program = None if record is None else (jog.run, program_of(record))
        known = self._jog_program
        return known[1] if known is not None and known[0] == jog.run else None

    def _live(self, now: Now) -> tuple[State, bool]:
        if not now.record or now.program is None:
            return State.IDLE, True
        if now.record != self._newest:
            self._newest, self._changed_s = now.record, time.monotonic()
        _, image, orders = unpack(now.record)
        on = time.monotonic() - self._changed_s < QUIET_S
        self._values = values_of(image, now.program, on=on)
        return State(orders.state), orders.phase == FaultReaction.SETTLED

    def _left(self, now: Now) -> State | None:
        """Return the state in which the newest run left the bench, None where nothing is known.

        One that ended before it changed anything is passed over.
        """
        if now.stage != ENDED or not now.run:
            return None
        with suppress(StationError):
            for known in islice(newest_runs(self._data), PASSED_OVER):
                run, left = known.record, how_left(known.record) if known.here else HowLeft.AS_FOUND
                if left is HowLeft.IN_NEED:
                    return State.STOPPED if was_recovered(self._data, run) else State.FAULT
                if left is HowLeft.IN_ORDER:
                    return STATE_OF_RUN.get(run.state())
        return None
