"""The run that a station shows: started in a process of its own, and found again by whoever looks.

The process is `lostmotion run`, in a session of its own: it neither knows nor needs the server that started it. What
is shown comes from the run's folder alone, so a server that was just started shows as much as the one that was killed.
"""

from __future__ import annotations

import math
import os
import signal
import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event, RLock, Thread

from definitions.program import Program
from recipes import Recipe, RecipeError
from station.atomic_file import open_file
from station.bench.request import load_job, stored_job
from station.documents.manifest import Manifest, RunningProcess, attempt_text
from station.documents.result import Result
from station.errors import StationError
from station.records.data_folder import Store
from station.records.master_parts import to_do_with_part
from station.records.run_record import RECORDING, RESULT, RunRecord, running_process
from station.records.samples.scan_record import RECORD_BYTES
from station.records.seal import alterations, is_sealed
from station.reports.headline import badges, manifest_badges
from station.run.next_run import NextRun
from station.run.screen.live import LiveReader, LiveView

OUTPUT = "station-run.log"
"""What the last started process said; of one that was refused it is the reason."""

NEWEST = 8
NEW_FOR_S = 5.0
"""For how long a folder that was just made may still have no manifest."""

LOOP_EVERY_RECORDS = 40
"""Records between two points of the loop on a screen: at 1 kHz 25 points a second."""

LOOK_EVERY_S = 0.04
"""However many look, the records are read once in this time: pages look together, others when they like."""

READY_EVERY_S = 0.5
"""How often it is looked whether the process of the next run can be started."""

READY, STARTING, RUNNING, ENDED = "ready", "starting", "running", "ended"


@dataclass(frozen=True)
class Now:
    """What the bench does: nothing yet, a run that starts, runs or has ended, with its result.

    attempt: which one it is and what became of those before, '' of the first. refused: why a start became no run.
    loop: torque [N·m] and wind-up [arcmin]. altered: why the record of the run that has ended is not to be believed.
    to_do: what is done with the unit after this verdict: what the recipe says, or a master part needs; '' of neither.
    stopping: whether it was asked for a stop. badges: why it says nothing of a real unit, as that it is simulated.
    record: the newest record of the scan, empty where none was read here; program: by which it was made.
    """

    stage: str = READY
    serial: str = ""
    run: str = ""
    attempt: str = ""
    recipe: str = ""
    view: LiveView | None = None
    loop: tuple[tuple[float, float], ...] = ()
    result: Result | None = None
    altered: tuple[str, ...] = ()
    refused: str = ""
    to_do: str = ""
    stopping: bool = False
    badges: tuple[str, ...] = ()
    record: bytes = b""
    program: Program | None = None

    @property
    def verdict(self) -> str | None:
        """The verdict of the run that has ended; none of a record that is not to be believed."""
        return None if self.result is None or self.altered else self.result.verdict

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reasons of the verdict; none where there is none to be believed."""
        return () if self.result is None or self.altered else self.result.reasons


@dataclass
class _Watched:
    """A run whose records are read as they come."""

    record: RunRecord
    reader: LiveReader | None
    recipe: Recipe | None
    read_bytes: int = 0
    view: LiveView | None = None
    newest: bytes = b""
    loop: list[tuple[float, float]] = field(default_factory=list)


class Running:
    """The bench of one data folder."""

    def __init__(self, data: Path) -> None:
        self._data = data
        self._process: subprocess.Popen[bytes] | None = None
        self._begun: RunningProcess | None = None
        """By what it is known: a run of before may have had the same process id."""
        self._serial = ""
        self._watched: _Watched | None = None
        self._ended: Now | None = None
        self._stopping = ""
        """The run that was asked for a stop."""
        self._refused = ""
        self._newest: subprocess.Popen[bytes] | None = None
        self._next, self._likely, self._over = NextRun(), ("", ""), Event()
        self._one_at_a_time = RLock()
        self._told, self._looked = Now(), -math.inf
        self._folder_at_ns, self._look_until = 0, math.inf

    def start(self, options: list[str], serial: str, likely: tuple[str, str] = ("", "")) -> None:
        """Start the process of a run; it may still refuse, which `now` tells. StationError where it cannot start.

        likely: recipe and bench of this unit, which are likely to be those of the next one.
        """
        with self._one_at_a_time:
            self._likely = likely
            self._start(options, serial)

    def _start(self, options: list[str], serial: str) -> None:
        words = [*options, "--serial", serial, "--data", str(self._data), "--no-report"]  # a page asks for one
        try:
            self._data.mkdir(parents=True, exist_ok=True)
            with (self._data / OUTPUT).open("wb") as output:
                said = output.fileno()
                self._process = self._newest = self._next.start(words, stdout=said, stderr=said)
        except OSError as error:
            raise StationError(f"the run cannot be started: {error.strerror}") from error
        self._begun = running_process(self._process.pid)
        self._serial, self._refused, self._watched, self._ended = serial, "", None, None
        self._looked = -math.inf

    def stay_ready(self, likely: tuple[str, str]) -> None:
        """Have the process of the next run started ahead whenever no run is on, from now until `close`.

        likely: recipe and bench of the unit that comes first; later it is that of the newest unit.
        """
        self._likely = likely
        Thread(target=self._stay_ready, daemon=True).start()

    def _stay_ready(self) -> None:
        recipe, bench = self._likely
        with suppress(RecipeError, StationError):
            load_job(recipe, bench or None)  # what the server looks at when the first unit is scanned
        while not self._over.wait(READY_EVERY_S):
            with suppress(StationError), self._one_at_a_time:
                # The process of a run that has ended still puts it into the store.
                ended = self._newest is None or self._newest.poll() is not None
                if ended and not self._over.is_set() and not self.busy():
                    self._next.get_ready(*self._likely)

    def close(self) -> None:
        """End the process that waits for the next run; a run that is on goes on."""
        self._over.set()
        with self._one_at_a_time:
            self._next.close()

    def busy(self) -> bool:
        """Say whether a run is on, or starts."""
        return self.now().stage in (STARTING, RUNNING)

    def stop(self) -> bool:
        """Ask the run that is on for a stop, as Ctrl-C does; False where there is none.

        It is asked once: asked again a run stops at once, with the torque where it is.
        """
        now = self.now()
        if now.stage != RUNNING or self._watched is None:
            return False
        if now.run == self._stopping:
            return True
        supervisor = self._watched.record.manifest().desk
        self._stopping = now.run
        with suppress(ProcessLookupError):
            os.kill(supervisor.pid, signal.SIGINT)
        return True

    def now(self) -> Now:
        """Return what the bench does; who asks within a moment of another is told the same."""
        with self._one_at_a_time:
            if time.monotonic() - self._looked > LOOK_EVERY_S:
                self._told, self._looked = self._look(), time.monotonic()
            return self._told

    def _look(self) -> Now:
        over = self._process is not None and self._process.poll() is not None  # before the look: it may just have ended
        if self._watched is None and self._may_be_new():
            self._find()
        if self._watched is not None:
            try:
                return self._of_run(self._watched)
            except StationError as error:
                return self._is_over(Now(ENDED, self._serial, self._watched.record.id, altered=(str(error),)))
        if self._process is not None:
            if not over:
                return Now(STARTING, serial=self._serial)
            self._refused, self._process = self._why_refused(), None
        if self._ended is not None and not self._refused:
            return self._ended
        return Now(READY, serial=self._serial if self._refused else "", refused=self._refused)

    def _may_be_new(self) -> bool:
        """Say whether a folder was made since the last look, or so lately that its manifest may still come."""
        try:
            changed_ns = self._data.stat().st_mtime_ns
        except OSError:
            return False
        if changed_ns != self._folder_at_ns:
            self._folder_at_ns, self._look_until = changed_ns, time.monotonic() + NEW_FOR_S
        return self._process is not None or time.monotonic() < self._look_until

    def _find(self) -> None:
        """Look for the run of the process that was started, anybody's that is on, or, at first, the one that ended."""
        newest = Store(self._data).newest(NEWEST)
        for record in reversed(newest):
            try:
                manifest = record.manifest()
                ours = self._process is not None and manifest.desk == self._begun
                is_on = manifest.state == RECORDING and not record.deserted()
                last = self._process is None and self._ended is None and not self._refused and record is newest[-1]
                if ours or is_on or last:
                    self._watched = _watched(record)
                    self._serial = manifest.serial
                    return
            except StationError:
                continue  # a damaged folder is none that we started

    def _of_run(self, watched: _Watched) -> Now:
        record = watched.record
        manifest = record.manifest()
        said = Now(
            RUNNING,
            manifest.serial,
            record.id,
            _attempt(manifest),
            f"{manifest.recipe.name} r{manifest.recipe.revision}",
            badges=manifest_badges(manifest),
        )
        _read_on(watched)
        stopping, program = record.id == self._stopping, watched.reader.program if watched.reader else None
        said = replace(said, record=watched.newest, program=program, stopping=stopping)
        if not is_sealed(manifest) and not record.deserted():
            return replace(said, view=watched.view, loop=tuple(watched.loop))
        found = record.read(Result, RESULT) if record.has(RESULT) else None
        altered = tuple(alterations(record)) if is_sealed(manifest) else ("the run was not concluded",)
        to_do = "" if found is None else _to_do(watched, found, manifest.unit.master)
        over = replace(said, stage=ENDED, loop=tuple(watched.loop), result=found, altered=altered, to_do=to_do)
        if found is not None and not altered:
            over = replace(over, badges=badges(found))
        return self._is_over(over)

    def _is_over(self, ended: Now) -> Now:
        self._ended, self._watched = ended, None
        self._process = None  # it goes on for a moment, for the store and a report; nobody waits for it
        return ended

    def _why_refused(self) -> str:
        try:
            lines = (self._data / OUTPUT).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        except OSError as error:
            return f"the run did not start, and {OUTPUT}, which has the reason, cannot be read: {error.strerror}"
        return " ".join(lines[-3:]) or "the run did not start and gave no reason"


def _attempt(manifest: Manifest) -> str:
    """Return which attempt it is, '' of the first."""
    text = attempt_text(manifest.attempt, manifest.before, manifest.retest_reason)
    return text if manifest.attempt > 1 else ""


def _watched(record: RunRecord) -> _Watched:
    try:
        job = stored_job(record)
        reader = LiveReader(job.program, angle_out=job.bench.sensors.angle_out is not None)
        return _Watched(record, reader, job.recipe)
    except (RecipeError, StationError):
        return _Watched(record, None, None)


def _to_do(watched: _Watched, found: Result, master: str | None) -> str:
    """Return what is done with the unit after its verdict, '' where nobody but the page says it."""
    if master is not None and (of_part := to_do_with_part(master, found.verdict)):
        return of_part
    return "" if watched.recipe is None else watched.recipe.what_to_do.after(found.verdict)


def _read_on(watched: _Watched) -> None:
    """Read the records that have come since the last look; the newest is the view, some of the others are the loop."""
    if watched.reader is None:
        return
    with suppress(OSError), open_file(watched.record.samples) as file:
        file.seek(watched.read_bytes)
        content = file.read()
        count = len(content) // RECORD_BYTES
        first = watched.read_bytes // RECORD_BYTES
        step_from = -first % LOOP_EVERY_RECORDS
        chosen = sorted({*range(step_from, count, LOOP_EVERY_RECORDS), count - 1} - {-1})
        for number in chosen:
            watched.newest = content[number * RECORD_BYTES : (number + 1) * RECORD_BYTES]
            watched.view = view = watched.reader.read(watched.newest)
            if view.cycle and view.torque_nm is not None and view.windup_arcmin is not None:
                watched.loop.append((round(view.torque_nm, 2), round(view.windup_arcmin, 4)))
        watched.read_bytes += count * RECORD_BYTES
