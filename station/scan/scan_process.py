"""Entry of the real-time process: `python -m station.scan.scan_process SHA256 SPEC.json`.

Opens the bench, asks the machine for real time, then scans until the controller has finished. No thread, no logging,
no waiting call in the scan. SIGTERM asks the controller for a stop (unload first) and never ends the process at once;
SIGINT is the supervisor's business. What it has to say is written as JSON when the scan is over.

It reads a compiled program and a compiled bench, `ScanSpec`, and nothing else: what it loads into its locked memory is
the controller, the drivers and their protocols.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path

from controller.controller import Controller
from drivers.errors import DriverError
from drivers.wire_bench import WireBench
from station.atomic_file import reserve, write_atomic
from station.bench.bench_lock import BenchBusyError, alone_on
from station.documents.entries import plain
from station.documents.events import Note
from station.documents.scan_report import Memory, Pace, ScanReport
from station.errors import RecordError
from station.records.clocks import SCAN
from station.records.process_birth import process_birth
from station.records.ring.ring import ScanState, StopCause
from station.records.ring.writer import RingWriter
from station.records.scan_times import ScanTimes
from station.scan import machine, realtime
from station.scan.scan_loop import START_AT, Stop, run_real
from station.scan.scan_spec import EXIT_REFUSED, ScanSpec, SpecError, read_program, told
from station.scan.schedule import BenchSchedule, RealTimeSchedule, Schedule
from station.scan.supervisor_watch import LONGEST_SILENCE_S, SupervisorWatch

LOOK_EVERY_S = 0.001
PR_SET_PDEATHSIG = 1
SHORTEST_SCAN_NS = 100_000
"""No scan over wires takes less: without deadlines the silence of the supervisor is counted in these."""

REPORT_BYTES = 1 << 18
"""Room for the last report: histograms of the timing, the periods that were missed, notes."""


def scan(spec: ScanSpec, ring: RingWriter, stop: Stop) -> ScanReport:
    """Open the bench and run the scan to its end; return the report.

    Raises:
        BenchBusyError: another process has the bench; nothing was sent to it.
        DriverError: the bench cannot be opened; nothing has moved.
        SpecError: the program has changed since it was checked.

    """
    compiled = spec.compiled
    period_ns = compiled.wires.period_ns
    controller = Controller(read_program(compiled), left=spec.left)
    bench = WireBench(compiled.wires)
    with ExitStack() as cleanup:
        if compiled.alone:
            cleanup.enter_context(alone_on(compiled.bench, compiled.wires.can, compiled.wires.modbus))
        verified = bench.open()
        cleanup.callback(bench.close)
        grants = realtime.request_all()
        if spec.fast:  # it never sleeps: with a priority above all others it would starve the supervisor
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        spin_ns, spinning = realtime.spin_tail(spec.spin_ns, grants)
        schedule = schedule_of(spec, bench, period_ns, spin_ns)
        answers = realtime.answers((*grants, spinning))
        report = ScanReport(
            state="running",
            pid=os.getpid(),
            birth=process_birth(os.getpid()),
            realtime=replace(answers, machine=machine.against(answers)),
            verified=tuple(verified),
        )
        _tell(Path(spec.report), report, flush=False)
        _take_room(Path(spec.report))
        ring.set_state(ScanState.RUNNING)
        times = ScanTimes()
        scan_ns = SHORTEST_SCAN_NS if spec.fast else period_ns
        supervisor = SupervisorWatch(ring, stop, scan_ns, commands_from=START_AT if spec.clock == SCAN else 0)
        if spec.clock == SCAN:
            _wait_for_start(ring, stop)
            bench.begin()
        before_kb = machine.resident_kb()
        last = run_real(
            bench,
            controller,
            ring.append,
            supervisor.take_command,
            schedule=schedule,
            stop=stop,
            times=times,
            note_start=ring.note_start,
            after_end_scans=spec.after_end_scans,
        )
        resident_kb = Memory(before=before_kb, after=machine.resident_kb())
        counters = bench.counters()
    said = (
        Note(scan=event.scan, kind=event.kind, state=event.state, text=event.text)
        for event in controller.events
        if event.kind == "note"
    )
    return replace(
        report,
        state="finished",
        pid=None,
        birth="",
        scans=last + 1,
        started_ns=schedule.started_ns,
        written=ring.sequence,
        lost=ring.lost,
        counters=counters,
        times=times.counted(resident_kb),
        pace=pace_of(bench, schedule),
        notes=(*said, *supervisor.notes()),
        stopped_by_signal=stop.wanted,
    )


def schedule_of(spec: ScanSpec, bench: WireBench, period_ns: int, spin_ns: int) -> Schedule:
    """Return the schedule of the clock that the spec names."""
    if spec.clock == SCAN:
        return BenchSchedule(period_ns, bench, spin_ns, fast=spec.fast)
    return RealTimeSchedule(period_ns, spin_ns=spin_ns)


def pace_of(bench: WireBench, schedule: Schedule) -> Pace | None:
    """Return what is to be told of a bench that waited for the scan; None for one with a clock of its own."""
    if bench.pace is None or not isinstance(schedule, BenchSchedule):
        return None
    return replace(
        schedule.pace(),
        unit=bench.pace.unit,
        unanswered=bench.pace.unanswered,
        frames_sent_by_bench=bench.pace.answer.frames,
        frames_received=bench.drive.link.frames_received,
    )


def _wait_for_start(ring: RingWriter, stop: Stop) -> None:
    """Wait for the supervisor's first command: where the first scan is the first instant, a run begins from there."""
    until = time.monotonic() + LONGEST_SILENCE_S
    while not (ring.commands_given or stop.wanted) and time.monotonic() < until:
        time.sleep(LOOK_EVERY_S)


def _tell(path: Path, report: ScanReport, *, flush: bool) -> None:
    """Replace the report: once before the scan, for the case that nothing can be said after it, and once at its end.

    A disk that refuses it changes nothing else: how the scan ended stands in the ring too.
    """
    try:
        write_atomic(path, json.dumps(plain(report), ensure_ascii=False).encode(), flush=flush)
    except RecordError as error:
        with suppress(OSError):  # what was said goes to a file on the same disk
            sys.stderr.write(f"{error}\n")


def _take_room(path: Path) -> None:
    """Take room for the last report while there is some: a disk that fills up meanwhile costs no proof of timing."""
    with suppress(RecordError):
        reserve(path, REPORT_BYTES)


def _watch_supervisor(supervisor: int, ring: RingWriter, stop: Stop) -> None:
    """End a scan that nobody can start any more; one that was started is for `SupervisorWatch`."""

    def desk_died(*_: object) -> None:
        if os.getppid() != supervisor and ring.commands_given == 0:
            stop.supervisor_gone = True
            ring.note_stop(StopCause.DESK_GONE)
            stop.ask()

    signal.signal(signal.SIGUSR1, desk_died)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGUSR1), 0, 0, 0)
    desk_died()  # it may have died before it was watched


def prepare() -> Callable[[], int]:
    """Return what is to be done with an order: all that a scan needs is loaded with this module."""
    return main


def main() -> int:
    """Run a spec; 0 when the scan came to its end, 2 when the bench was refused, 1 when the program failed."""
    try:
        spec = told(sys.argv, ScanSpec)
    except SpecError as error:  # it names the ring and the report: there is nowhere else to say so
        sys.stderr.write(f"{error}\n")
        return EXIT_REFUSED
    stop = Stop()
    signal.signal(signal.SIGTERM, stop.ask)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ring = RingWriter(Path(spec.ring))
    _watch_supervisor(spec.supervisor, ring, stop)
    code, state = 0, ScanState.FINISHED
    try:
        report = scan(spec, ring, stop)
    except (DriverError, SpecError, BenchBusyError) as error:
        code, state = EXIT_REFUSED, ScanState.REFUSED
        report = ScanReport(state="refused", error=str(error))
    except Exception as error:  # noqa: BLE001 - the last report of a process whose record must still be told why
        code, state = 1, ScanState.DIED
        report = ScanReport(state="failed", error=repr(error), traceback=traceback.format_exc(), written=ring.sequence)
    # In the ring first: it takes what a disk may refuse.
    ring.set_state(state)
    _tell(Path(spec.report), report, flush=True)
    ring.close()
    return code


if __name__ == "__main__":
    sys.exit(main())
