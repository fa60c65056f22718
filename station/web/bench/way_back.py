"""The recovery after a fault: `lostmotion recover` in a process of its own, and its steps as a person follows them.

The process neither knows nor needs the server. It waits, with the drive off and the lock as it was, until a person says
that all is checked; that is a signal, so a server that was just started can give it as well as the one that began.
"""

from __future__ import annotations

import os
import signal
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import RLock
from typing import NamedTuple

from definitions.image import State
from station.documents.events import LeftState
from station.documents.manifest import RECORDING, Manifest
from station.documents.result import Result
from station.errors import StationError
from station.own_program import own_module
from station.records.data_folder import Store
from station.records.run_record import BENCH_COPY, RESULT, RunRecord, only_simulated
from station.run.way_back.begins_at import recovery_begins_at
from station.run.way_back.guide import UNPROVEN_DRIVE
from station.run.way_back.how_left import HowLeft, how_left
from station.run.way_back.recoveries import FOLDER, drive_is_unproven, newest_recovery
from station.web.bench.sight import Sight
from station.web.running import RUNNING, Now, Running

OUTPUT = "station-recover.log"
"""What the last started process said; of one that was refused it is the reason."""

ACKNOWLEDGED_BY = signal.SIGUSR1
LAST_WORDS = 4

ALL_ANSWER = "Emergency stop released, guard closed, all devices answer."

DONE, IN_HAND, TO_COME, IN_THE_WAY = "done", "now", "to come", "in the way"


class StepRow(NamedTuple):
    """A step: what is done in it, how far it is, and what is seen of it now."""

    text: str
    standing: str
    seen: str = ""


@dataclass(frozen=True)
class Fault:
    """What the recovery begins at: a run that left its bench in a fault, how it ended, and how it left the bench.

    unproven: nobody has measured that the drive ends its torque when the program dies.
    """

    run: str
    bench: str
    state: str
    left: LeftState | None
    cause: str
    unproven: bool = False


@dataclass(frozen=True)
class Standing:
    """How the recovery stands. fault: None where there is nothing to recover; why_none says so then.

    recovery: its record while one is on, '' otherwise. released: the last one has ended as it should. said: the last
    words of a process that has ended otherwise.
    """

    fault: Fault | None = None
    why_none: str = ""
    recovery: str = ""
    released: bool = False
    said: str = ""


class WayBack:
    """The recovery of the bench of one data folder."""

    def __init__(self, data: Path) -> None:
        self._data = data
        self._process: subprocess.Popen[bytes] | None = None
        self._one_at_a_time = RLock()
        self._running = Running(data / FOLDER)

    def start(self, operator: str, run: str) -> None:
        """Start the process, of the bench that a run left; it enables nothing before it is told to.

        Raises:
            StationError: it cannot be started.

        """
        command = own_module("station", "recover", "--by-signal", "--operator", operator)
        command += ["--data", str(self._data)]
        if any(one.id != run for one in Store(self._data).newest(1)):  # another bench has run since
            command += ["--bench", str(self._data / run / BENCH_COPY)]
        with self._one_at_a_time:
            try:
                with (self._data / OUTPUT).open("wb") as output:
                    self._process = subprocess.Popen(  # noqa: S603 - our own program
                        command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True
                    )
            except OSError as error:
                raise StationError(f"the recovery cannot be started: {error.strerror}") from error

    def starting(self) -> bool:
        """Say whether a process was started here and has not ended yet."""
        with self._one_at_a_time:
            return self._process is not None and self._process.poll() is None

    def now(self) -> Now:
        """Return what the recovery that is on does, or how the newest one ended."""
        return self._running.now()

    def tell(self, recovery: str, *, go_on: bool) -> bool:
        """Tell a recovery to go on, or to leave the bench as it is; False where that one is not on."""
        if self.now().stage != RUNNING or self.now().run != recovery:
            return False
        process = RunRecord(self._data / FOLDER / recovery).manifest().desk
        with suppress(ProcessLookupError):
            os.kill(process.pid, ACKNOWLEDGED_BY if go_on else signal.SIGINT)
        return True

    def standing(self) -> Standing:
        """Return how the recovery stands now."""
        now = self.now()
        run = recovery_begins_at(self._data)
        if run is None:
            return Standing(why_none="No run was made yet.")
        try:
            return self._standing(run, run.manifest(), now)
        except StationError as error:
            return Standing(why_none=f"The newest run cannot be read: {error}")

    def _standing(self, run: RunRecord, manifest: Manifest, now: Now) -> Standing:
        if now.stage == RUNNING:
            return Standing(_fault(run, manifest), recovery=now.run)
        why_none = _why_none(run, manifest)
        if why_none:
            return Standing(why_none=why_none)
        found = newest_recovery(self._data, run)
        fault = _fault(run, manifest)
        if found is not None and found.has(RESULT):
            result = found.read(Result, RESULT)
            if how_left(found) is HowLeft.IN_ORDER:
                return Standing(fault, released=True)
            return Standing(fault, said=" ".join(result.reasons) or self._last_words())
        return Standing(fault, said="" if self.starting() else self._last_words())

    def _last_words(self) -> str:
        with self._one_at_a_time:
            if self._process is None:
                return ""
        with suppress(OSError):
            lines = (self._data / OUTPUT).read_text(encoding="utf-8", errors="replace").strip().splitlines()
            return " ".join(lines[-LAST_WORDS:])
        return ""


def _why_none(run: RunRecord, manifest: Manifest) -> str:
    """Return why there is nothing to recover after a run, '' where there is."""
    if run.state() == RECORDING:
        return "A run is in progress."
    found = how_left(run)
    if found is HowLeft.AS_FOUND:
        return "The newest run ended before anything on the bench was changed."
    if found is HowLeft.IN_ORDER:
        return "The newest run ended normally: unloaded, lock open, drive off."
    if manifest.bench.embedded or only_simulated(manifest):
        return "The virtual bench ended with its run: there is nothing to recover."
    return ""


def _fault(run: RunRecord, manifest: Manifest) -> Fault:
    result = run.read(Result, RESULT) if run.has(RESULT) else None
    first = None if result is None else result.first_cause
    cause = "" if first is None else f"{first.text}. {first.next_action}."
    if first is not None and first.detail:
        cause += f" Servo drive: {first.detail}."
    left = None if result is None else result.left
    return Fault(run.id, manifest.bench.name, run.state(), left, cause, drive_is_unproven(manifest))


def steps(standing: Standing, sight: Sight | None) -> tuple[StepRow, ...]:
    """Return the steps of the recovery; sight: what the recovery that is on shows, None while none is."""
    state = None if sight is None or not standing.recovery else sight.state
    begun, over = state is not None, standing.released
    loaded = state == State.UNLOAD
    unloaded = over or state in (State.RELEASE, State.STOPPED)
    acknowledged = loaded or unloaded or bool(sight and sight.resetting)
    opened = over or state == State.STOPPED
    in_the_way = _in_the_way(sight) if begun and sight is not None and state == State.FAULT else ()
    checked = DONE if acknowledged else TO_COME if not begun else IN_THE_WAY if in_the_way else IN_HAND
    warned = UNPROVEN_DRIVE if standing.fault is not None and standing.fault.unproven and not acknowledged else ""
    seen = " ".join(in_the_way) or ("" if checked != IN_HAND else ALL_ANSWER)
    return (
        StepRow("Begin. The devices are read; the drive stays off and the lock stays as it is.",
                DONE if begun or over else IN_HAND),
        StepRow("Make the bench safe, and remove the cause.", checked, seen),
        StepRow("Confirm that all is checked. Keep clear: the shaft turns.",
                DONE if acknowledged else IN_HAND if begun and sight is not None and sight.settled else TO_COME,
                warned),
        StepRow("The torque is brought to zero behind the closed lock.",
                DONE if unloaded else IN_HAND if loaded else TO_COME),
        StepRow(f"The lock opens{_below(sight)}.",
                DONE if opened else IN_HAND if state == State.RELEASE else TO_COME),
        StepRow("Take the unit out.", IN_HAND if opened else TO_COME),
    )  # fmt: skip


def _below(sight: Sight | None) -> str:
    return "" if sight is None else f", once the torque is below {sight.release_nm:.1f} N·m"


def _in_the_way(sight: Sight) -> tuple[str, ...]:
    """Return what a person has to do before anything can be acknowledged."""
    found = [] if sight.estop_released else ["The emergency stop is pressed."]
    found += [] if sight.guard_closed else ["The guard is open."]
    found += [f"{device.title}: no fresh values." for device in sight.devices if device.stale or device.lost]
    return tuple(found)
