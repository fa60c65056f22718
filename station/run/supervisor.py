"""The supervisor of a real-time run: starts the processes, brings the records to disk, passes the operator's wishes on.

Ctrl-C once asks for a stop: the torque is brought to zero before the lock opens. Twice is a quick stop, or the end of a
scan process that says nothing any more. A terminal that is closed counts as Ctrl-C, and a screen that cannot be written
to any more ends nothing. Whatever ends the run, no process and no ring file stays behind, and every record that was
written is in the run's folder.
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import TypeVar

from definitions.image import Command
from station.atomic_file import Appender
from station.bench.bench_spec import Ports
from station.bench.request import Job
from station.bench.virtual_unit import VirtualUnit
from station.documents.manifest import LeftBy
from station.errors import BenchFaultError, RecordError
from station.records.clocks import BY_WALL_CLOCK, SCAN, Pacing
from station.records.ring.reader import RingReader
from station.records.ring.ring import ScanState, StopCause, create
from station.records.ring.to_disk import RecordsWaitError, RecordWriter
from station.records.run_record import SCAN_REPORT, RunRecord
from station.run import children
from station.run.ahead import Ahead
from station.run.asked_to_stop import STOP_WORDS, Stopping, listening
from station.run.faults.companion import Companion, Reach
from station.run.outcome import RunOutcome, take_room
from station.run.process_specs import write_bench_spec, write_scan_spec
from station.run.scan_end import SCAN_LOG, outcome_of, what_waits
from station.run.silent_scan import SilentScan
from station.wall_clock import JumpWatch

BENCH_LOG = "virtual-bench.jsonl"
"""What the virtual bench or the gateway said."""

LOOK_EVERY_S = 0.02
SHOW_EVERY_S = 0.1
ARM_TIMEOUT_S = 90.0
"""Longer than the set-up of a drive may take (`DriveConfig.setup_timeout_s`)."""

Told = TypeVar("Told")
Show = Callable[[bytes], None]
Say = Callable[[str], None]


def _quietly(end: Callable[[], None]) -> None:
    """End something whose trouble with the disk has been told already."""
    with suppress(RecordError):
        end()


def _if_possible(tell: Callable[[Told], None]) -> Callable[[Told], None]:
    """Return `tell` for a screen that may be gone: the run and its record do not depend on it."""

    def told(what: Told) -> None:
        with suppress(OSError):
            tell(what)

    return told


class Supervisor:
    """One real-time run of a job.

    A recovery is one too: `left` says how the bench was left, and `attend` is called at every look, to tell and to ask.
    """

    def __init__(
        self,
        job: Job,
        record: RunRecord,
        show: Show,
        say: Say,
        companion: Companion | None = None,
        *,
        left: LeftBy | None = None,
        attend: Callable[[RingReader], None] | None = None,
        gateway: bool = False,
        pacing: Pacing = BY_WALL_CLOCK,
        meanwhile: Callable[[], None] = children.nothing,
        ahead: Mapping[str, Ahead] | None = None,
    ) -> None:
        """Prepare a run; with a `companion` in a run with faults, through a `gateway` on the way to a real bench.

        meanwhile: done while the other processes start, when nobody waits for the supervisor. ahead: processes that
        were started before and wait, by their modules; who started them ends those that are not needed.
        """
        self._job, self._record = job, record
        self._gateway = gateway
        self._pacing = pacing
        self._companion = companion
        self._show, self._say = _if_possible(show), _if_possible(say)
        self._left, self._attend = left, attend
        self._meanwhile = meanwhile
        self._ahead = {} if ahead is None else ahead
        self._stopping = Stopping()
        self._disk_refused = ""
        self._waits = False
        self._seen: SimpleQueue[bytes] = SimpleQueue()
        self._wall_clock = JumpWatch()
        self.tell_bench: Callable[[bytes], None] | None = None
        """Passes a line on to the embedded virtual bench, once it is there; None before, and for any other bench."""

    def run(self, unit: VirtualUnit | None, scenario: Path | None) -> RunOutcome:
        """Run to the end; `unit` and `scenario` are for the embedded virtual bench.

        Raises:
            BenchFaultError: the bench could not be opened; nothing has moved.
            RecordsWaitError: the disk is full; the run has been stopped and unloaded, and waits for the disk.
            RecordError: the disk takes nothing from the start; nothing has moved.

        """
        with ExitStack() as cleanup:
            take_room(self._record)
            cleanup.enter_context(listening(self._stopping.hear))
            ports, life_line = None, None
            if self._job.bench.bench.embedded or self._gateway:
                life_line = children.LifeLine()
                cleanup.callback(life_line.close)
                ports = self._start_bench(cleanup, life_line, unit, scenario)
                self.tell_bench = life_line.tell
            ring_path = create(self._record.folder, run=self._record.folder)
            ring = RingReader(ring_path)
            cleanup.callback(self._let_go, ring, ring_path)
            self._record.update(ring=str(ring_path))
            file = Appender(self._record.samples)
            cleanup.callback(_quietly, file.close)
            writer = RecordWriter(ring, file, seen=None if self._companion is None else self._seen.put)
            cleanup.callback(_quietly, writer.finish)
            writer.start()
            report = self._record.folder / SCAN_REPORT
            process = self._start_scan(ring_path, report, ports, life_line)
            cleanup.callback(children.stop, process, self._longest_unload_s())
            if ports is None:
                # Beside the supervisor: the scan gives up one that is silent for 2 s, and loading may take longer.
                Thread(target=self._meanwhile, name="meanwhile", daemon=True).start()
            if self._companion is not None:
                tell = None if life_line is None else life_line.tell
                self._companion.begin(Reach(process.pid, ring.send, tell))
            given_up = self._serve(process, ring, writer)
            try:
                writer.finish()
                outcome = outcome_of(
                    process,
                    ring,
                    self._record,
                    writer,
                    self._wall_clock,
                    embedded=life_line is not None,
                    interrupted=self._stopping.asked > 0,
                    given_up=given_up,
                )
                outcome.keep(self._record)
            except RecordError as error:
                self._waits = True
                raise RecordsWaitError(what_waits(self._record.id, error, ring)) from error
            return outcome

    # --- starting

    def _start_bench(
        self,
        cleanup: ExitStack,
        life_line: children.LifeLine,
        unit: VirtualUnit | None,
        scenario: Path | None,
    ) -> Ports:
        self._say("starting the gateway" if self._gateway else "starting the virtual bench")
        spec = write_bench_spec(self._job, self._record, unit, scenario, self._pacing.clock)
        log = self._record.folder / BENCH_LOG
        if self._gateway:
            process, ports = children.start_gateway(spec, log, life_line, self._meanwhile)
        else:
            ahead = self._ahead.get(children.VIRTUAL_BENCH)
            process, ports = children.start_virtual_bench(spec, log, life_line, self._meanwhile, ahead)
        cleanup.callback(children.stop, process)
        return ports

    def _start_scan(
        self, ring: Path, report: Path, ports: Ports | None, life_line: children.LifeLine | None
    ) -> subprocess.Popen[bytes]:
        self._say("opening the bench: identities, drive protections")
        after_end_scans = 0 if self._companion is None else self._companion.after_end_scans
        spec = write_scan_spec(
            self._job,
            self._record,
            ring,
            report,
            ports,
            pacing=self._pacing,
            after_end_scans=after_end_scans,
            left=self._left,
        )
        log, ahead = self._record.folder / SCAN_LOG, self._ahead.get(children.SCAN)
        return children.start_scanning(children.SCAN, spec, log, life_line, ahead)

    def _longest_unload_s(self) -> float:
        program = self._job.program
        return (program.unload_limit_scans + program.release_scans + program.settle_scans) * program.period_s + 1.0

    # --- running

    def _serve(self, process: subprocess.Popen[bytes], ring: RingReader, writer: RecordWriter) -> bool:
        """Pass on what the scan and the operator have to say until the scan process has ended.

        Return whether it was ended here, because it said nothing any more.
        """
        started = shown = time.monotonic()
        armed = False
        scan = SilentScan(ring, self._say, process.kill)
        while process.poll() is None:
            time.sleep(LOOK_EVERY_S)
            ring.beat()
            now = time.monotonic()
            # a scan that leads its bench begins when the start is there; others have to be seen to scan
            if not armed and ring.state is ScanState.RUNNING and (ring.written or self._pacing.clock == SCAN):
                armed = True
                ring.send(Command.START)
            if not armed and now - started > ARM_TIMEOUT_S:
                raise BenchFaultError(
                    f"the scan process did not start within {ARM_TIMEOUT_S:.0f} s. Close other programs and run again"
                )
            scan.look()
            self._pass_on(ring, process, scan, armed=armed)
            if self._attend is not None and ring.written:
                self._attend(ring)
            self._look()
            self._wall_clock.look()
            if writer.first_trouble and not self._disk_refused:
                self._stop_for_the_disk(writer.first_trouble, ring, process, armed=armed)
            if now - shown > SHOW_EVERY_S and writer.newest:
                shown = now
                self._show(writer.newest)
        if ring.written:
            self._show(ring.last())
        return scan.ended

    def _look(self) -> None:
        """Show the companion the records since the last look; in this thread, which alone sends commands."""
        if self._companion is None:
            return
        while not self._seen.empty():
            self._companion.look(self._seen.get())
        self._companion.tick()

    def _stop_for_the_disk(
        self, trouble: str, ring: RingReader, process: subprocess.Popen[bytes], *, armed: bool
    ) -> None:
        """Ask for a stop: what nobody records must not go on under torque. What is still written waits in the ring."""
        self._disk_refused = trouble
        ring.note_stop(StopCause.DISK)
        self._say(f"stopping: the torque is brought to zero first, because the record cannot be kept: {trouble}")
        if armed:
            ring.send(Command.STOP)
        else:
            process.terminate()

    def _pass_on(self, ring: RingReader, process: subprocess.Popen[bytes], scan: SilentScan, *, armed: bool) -> None:
        """Tell what was asked for, and pass it on; before the start there is nothing to unload."""
        command = self._stopping.take_command()
        if not command:
            return
        if not armed:
            process.terminate()
            return
        if scan.end(command):
            return
        self._say(STOP_WORDS[command])
        ring.send(command)

    # --- end

    def _let_go(self, ring: RingReader, path: Path) -> None:
        """Close the ring, and remove it unless something waits in it for a disk that takes it."""
        if not (self._waits or ring.waiting):
            path.unlink(missing_ok=True)
        ring.close()
