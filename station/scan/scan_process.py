"""Entry of the real-time process: `python -m station.scan.scan_process SPEC.json`.

Opens the bench, asks the machine for real time, then scans until the controller has finished. No thread, no logging,
no waiting call in the scan. SIGTERM asks the controller for a stop (unload first) and never ends the process at once;
SIGINT is the desk's business. What it has to say is written as JSON when the scan is over.

Spec: ring, report, recipe, bench, program (paths), profiles ({name: path}), ports (ready line of an embedded bench or
null), spin_ns, desk (its process id), after_end_scans (to go on after the end), and for a recovery `left`, how the
bench was left.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import traceback
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from controller.compiler import compile_program
from controller.controller import Controller
from controller.held_lock import Left
from controller.program import Program
from drivers.errors import DriverError
from drivers.wire_bench import WireBench
from recipes import Problem, RecipeError, load_bench, load_recipe
from station.bench.assemble import wire_config
from station.bench.bench_lock import BenchBusyError, alone_on
from station.record.program_file import program_differences
from station.record.ring import ScanState
from station.record.ring_writer import RingWriter
from station.record.run_record import process_birth
from station.record.scan_times import ScanTimes
from station.scan import machine, realtime
from station.scan.desk_watch import DeskWatch
from station.scan.scan_loop import Stop, run_real
from station.scan.schedule import RealTimeSchedule

EXIT_REFUSED = 2
PR_SET_PDEATHSIG = 1


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
    bench = WireBench(wire_config(bench_file, profiles, period_ns, spec["ports"]))
    with ExitStack() as ending:
        if spec["ports"] is None:
            ending.enter_context(alone_on(bench_file))
        verified = bench.open()
        ending.callback(bench.close)
        grants = realtime.request_all()
        spin_ns, spinning = realtime.spin_tail(spec["spin_ns"], grants)
        schedule = RealTimeSchedule(period_ns, spin_ns=spin_ns)
        told = realtime.as_json((*grants, spinning))
        told |= {"machine": machine.against(told)}
        armed = {"realtime": told, "verified": verified}
        _tell(spec, {"state": "running", "pid": os.getpid(), "birth": process_birth(os.getpid()), **armed})
        ring.set_state(ScanState.RUNNING)
        times = ScanTimes()
        desk = DeskWatch(ring, stop, period_ns)
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
        "notes": [event._asdict() for event in controller.events if event.kind == "note"] + desk.notes(),
        "stopped_by_signal": stop.wanted,
    }


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


def _tell(spec: dict[str, Any], report: dict[str, Any]) -> None:
    """Replace the report: once before the scan, for the case that nothing can be said after it, and once at its end.

    A disk that refuses it changes nothing else: how the scan ended stands in the ring too.
    """
    path = Path(spec["report"])
    beside = path.with_suffix(".part")
    try:
        beside.write_text(json.dumps(report, ensure_ascii=False))
        beside.replace(path)
    except OSError as error:
        sys.stderr.write(f"{path}: cannot be written: {error.strerror}\n")


def _watch_desk(desk: int, ring: RingWriter, stop: Stop) -> None:
    """End a scan that nobody has started and nobody can start any more; one that was started is for `DeskWatch`."""

    def desk_died(*_: object) -> None:
        if os.getppid() != desk and ring.commands_given == 0:
            stop.desk_gone = True
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
    _tell(spec, report)
    ring.set_state(state)
    ring.close()
    return code


if __name__ == "__main__":
    sys.exit(main())
