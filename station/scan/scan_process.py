"""Entry of the real-time process: `python -m station.scan.scan_process SPEC.json`.

Opens the bench, asks the machine for real time, then scans until the controller has finished. No thread, no logging,
no waiting call in the scan. SIGTERM asks the controller for a stop (unload first) and never ends the process at once;
SIGINT is the desk's business. What it has to say is written as JSON when the scan is over.

Spec: ring, report, recipe, bench, program (paths), profiles ({name: path}), ports (ready line of an embedded bench or
null), clock (wall or scan), fast (scan clock without deadlines), spin_ns, desk (its process id), after_end_scans (to go
on after the end), and for a recovery `left`, how the bench was left.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import time
import traceback
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from controller.controller import Controller
from controller.held_lock import Left
from definitions.program import Program
from drivers.errors import DriverError
from drivers.wire_bench import WireBench
from recipes import Problem, RecipeError, load_bench, load_recipe
from recipes.compiler.compiler import compile_program
from station.bench.assemble import wire_config
from station.bench.bench_lock import BenchBusyError, alone_on
from station.durable import reserve, write_durable
from station.errors import RecordError
from station.records.clocks import SCAN
from station.records.program_file import program_differences
from station.records.ring.ring import ScanState, StopCause
from station.records.ring.writer import RingWriter
from station.records.run_record import process_birth
from station.records.scan_times import ScanTimes
from station.scan import machine, realtime
from station.scan.desk_watch import LONGEST_SILENCE_S, DeskWatch
from station.scan.scan_loop import START_AT, Stop, run_real
from station.scan.schedule import BenchSchedule, RealTimeSchedule, Schedule

EXIT_REFUSED = 2
LOOK_EVERY_S = 0.001
PR_SET_PDEATHSIG = 1
SHORTEST_SCAN_NS = 100_000
"""No scan over wires takes less: without deadlines the silence of the desk is counted in these."""

REPORT_BYTES = 1 << 18
"""Room for the last report: histograms of the timing, the periods that were missed, notes."""


def scan(spec: dict[str, Any], ring: RingWriter, stop: Stop) -> dict[str, Any]:
    """Open the bench and run the scan to its end; return the report.

    Raises:
        BenchBusyError: another process has the bench; nothing was sent to it.
        DriverError: the bench cannot be opened; nothing has moved.
        RecipeError: recipe, bench or a profile has changed since it was checked.

    """
    recipe = load_recipe(spec["recipe"])
    bench_file = load_bench(spec["bench"])
    profiles = {name: Path(path) for name, path in spec["profiles"].items()}
    period_ns = recipe.sampling.period_ns
    program = compile_program(recipe, bench_file)
    refuse_another(program, Path(spec["program"]))
    left = spec.get("left")
    controller = Controller(program, left=None if left is None else Left(**left))
    bench = WireBench(wire_config(bench_file, profiles, period_ns, spec["ports"], waits=spec["clock"] == SCAN))
    with ExitStack() as ending:
        if spec["ports"] is None:
            ending.enter_context(alone_on(bench_file))
        verified = bench.open()
        ending.callback(bench.close)
        grants = realtime.request_all()
        if spec["fast"]:  # it never sleeps: with a priority above all others it would starve the desk
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        spin_ns, spinning = realtime.spin_tail(spec["spin_ns"], grants)
        schedule = schedule_of(spec, bench, period_ns, spin_ns)
        told = realtime.as_json((*grants, spinning))
        told |= {"machine": machine.against(told)}
        armed = {"realtime": told, "verified": verified}
        running = {"state": "running", "pid": os.getpid(), "birth": process_birth(os.getpid())}
        _tell(spec, running | armed, flush=False)
        _take_room(spec)
        ring.set_state(ScanState.RUNNING)
        times = ScanTimes()
        scan_ns = SHORTEST_SCAN_NS if spec["fast"] else period_ns
        desk = DeskWatch(ring, stop, scan_ns, commands_from=START_AT if spec["clock"] == SCAN else 0)
        if spec["clock"] == SCAN:
            _wait_for_start(ring, stop)
            bench.begin()
        before_kb = machine.resident_kb()
        last = run_real(
            bench,
            controller,
            ring.append,
            desk.take_command,
            schedule=schedule,
            stop=stop,
            times=times,
            note_start=ring.note_start,
            after_end_scans=spec["after_end_scans"],
        )
        resident_kb = {"before": before_kb, "after": machine.resident_kb()}
        counters = bench.counters()
    return {
        "state": "finished",
        "scans": last + 1,
        "started_ns": schedule.started_ns,
        "written": ring.sequence,
        "lost": ring.lost,
        **armed,
        "counters": counters,
        "times": times.to_dict() | {"resident_kb": resident_kb},
        "pace": pace_of(bench, schedule),
        "notes": [event._asdict() for event in controller.events if event.kind == "note"] + desk.notes(),
        "stopped_by_signal": stop.wanted,
    }


def schedule_of(spec: dict[str, Any], bench: WireBench, period_ns: int, spin_ns: int) -> Schedule:
    """Return the schedule of the clock that the spec names."""
    if spec["clock"] == SCAN:
        return BenchSchedule(period_ns, bench, spin_ns, fast=spec["fast"])
    return RealTimeSchedule(period_ns, spin_ns=spin_ns)


def pace_of(bench: WireBench, schedule: Schedule) -> dict[str, Any] | None:
    """Return what is to be told of a bench that waited for the scan; None for one with a clock of its own."""
    if bench.pace is None or not isinstance(schedule, BenchSchedule):
        return None
    frames = {"frames_sent_by_bench": bench.pace.answer.frames, "frames_received": bench.drive.link.frames_received}
    return {"unit": bench.pace.unit, "unanswered": bench.pace.unanswered, **frames, **schedule.as_json()}


def _wait_for_start(ring: RingWriter, stop: Stop) -> None:
    """Wait for the desk's first command: where the first scan is the first instant, a run begins from there."""
    until = time.monotonic() + LONGEST_SILENCE_S
    while not (ring.commands_given or stop.wanted) and time.monotonic() < until:
        time.sleep(LOOK_EVERY_S)


def refuse_another(program: Program, recorded: Path) -> None:
    """Refuse a program that is not the one that was checked; RecipeError with the first places that differ."""
    try:
        found = program_differences(json.loads(recorded.read_bytes()), program)
    except (OSError, ValueError) as error:
        found = [f"it cannot be read: {error}"]
    if found:
        what = f"the program of the run is not the one that was checked ({'; '.join(found[:3])})"
        hint = "Leave the run's folder alone while it starts, then run again."
        raise RecipeError([Problem(str(recorded), 0, 0, "", what, "the same program", hint)])


def _tell(spec: dict[str, Any], report: dict[str, Any], *, flush: bool) -> None:
    """Replace the report: once before the scan, for the case that nothing can be said after it, and once at its end.

    A disk that refuses it changes nothing else: how the scan ended stands in the ring too.
    """
    try:
        write_durable(Path(spec["report"]), json.dumps(report, ensure_ascii=False).encode(), flush=flush)
    except RecordError as error:
        with suppress(OSError):  # what was said goes to a file on the same disk
            sys.stderr.write(f"{error}\n")


def _take_room(spec: dict[str, Any]) -> None:
    """Take room for the last report while there is some: a disk that fills up meanwhile costs no proof of timing."""
    with suppress(RecordError):
        reserve(Path(spec["report"]), REPORT_BYTES)


def _watch_desk(desk: int, ring: RingWriter, stop: Stop) -> None:
    """End a scan that nobody has started and nobody can start any more; one that was started is for `DeskWatch`."""

    def desk_died(*_: object) -> None:
        if os.getppid() != desk and ring.commands_given == 0:
            stop.desk_gone = True
            ring.note_stop(StopCause.DESK_GONE)
            stop.ask()

    signal.signal(signal.SIGUSR1, desk_died)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGUSR1), 0, 0, 0)
    desk_died()  # it may have died before it was watched


def main() -> int:
    """Run a spec; 0 when the scan came to its end, 2 when the bench was refused, 1 when the program failed."""
    # The unit library takes numpy when it finds it: 80 MB that would be locked into memory, and a second thread.
    sys.modules["numpy"] = None  # type: ignore[assignment]
    spec = json.loads(Path(sys.argv[1]).read_text())
    stop = Stop()
    signal.signal(signal.SIGTERM, stop.ask)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ring = RingWriter(Path(spec["ring"]))
    _watch_desk(int(spec["desk"]), ring, stop)
    code, state = 0, ScanState.FINISHED
    try:
        report = scan(spec, ring, stop)
    except (DriverError, RecipeError, BenchBusyError) as error:
        code, state = EXIT_REFUSED, ScanState.REFUSED
        report = {"state": "refused", "error": str(error)}
    except Exception as error:  # noqa: BLE001 - the last report of a process whose record must still be told why
        code, state = 1, ScanState.DIED
        report = {
            "state": "failed",
            "error": repr(error),
            "traceback": traceback.format_exc(),
            "written": ring.sequence,
        }
    # In the ring first: it takes what a disk may refuse.
    ring.set_state(state)
    _tell(spec, report, flush=True)
    ring.close()
    return code


if __name__ == "__main__":
    sys.exit(main())
