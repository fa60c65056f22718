"""The proof that the torque comes to zero within a bounded time on every way in which a run can end.

Each row of `exit_rows` is run in virtual time: in the middle of a ramp where it can come up there, and otherwise from
the state that leads to it. The faults are provoked as in the fault matrix. What friction keeps behind a closed lock is
a rest, not a zero.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from definitions.image import Command, Link, Orders, SampleStatus, State
from faultlab.exits.elsewhere import (
    brake_stays_closed,
    calibration_failed,
    devices_not_ready,
    homing_failed,
    measure_fault,
)
from faultlab.exits.jogging import enabling_device_stuck, jog_not_stopped
from faultlab.exits.judge import Measured, judge_exit
from faultlab.exits.rows import EXITS, LOAD_NM, Exit
from faultlab.exits.shown import Shown
from faultlab.matrix.matrix import scenario_of, undisturbed
from faultlab.run import Bench
from station.records.ring.ring import create
from station.records.ring.writer import RingWriter
from station.scan.scan_loop import Stop
from station.scan.supervisor_watch import LONGEST_SILENCE_S, SupervisorWatch
from virtual_bench.faults.scenario import Fault as Injected
from virtual_bench.faults.scenario import When

AFTERWARDS_SCANS = 1500


def _judged(row: Exit, bench: Bench, begin: int, ended: str, by: str) -> Measured:
    began = State(bench.run.orders[begin - 1].state).name.lower()
    return judge_exit(row, bench.run, begin, by, began=began, ended=ended)


def _loaded() -> Bench:
    bench = undisturbed()["ramp_pos"].branch(scenario_of(None, "ramp_pos"))
    bench.until(lambda orders: orders.controlled_torque_nm > LOAD_NM)
    return bench


def _orders_on(bench: Bench, until: Callable[[Orders], bool]) -> None:
    bench.until(until)
    for _ in range(AFTERWARDS_SCANS):
        bench.go()


def _finish(row: Exit) -> Measured:
    bench = _loaded()
    bench.until(lambda orders: orders.state == State.UNLOAD)
    begin = len(bench.run.orders) - 1
    _orders_on(bench, lambda orders: orders.state == State.COMPLETE)
    return _judged(row, bench, begin, bench.state, "recipe")


def _operator_stop(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    bench.order(Command.STOP)
    _orders_on(bench, lambda orders: orders.state == State.STOPPED)
    return _judged(row, bench, begin, bench.state, "command STOP")


def _abort(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    bench.order(Command.STOP)
    for _ in range(100):
        bench.go()
    bench.order(Command.QUICK_STOP)
    _orders_on(bench, lambda _: bench.controller.finished)
    return _judged(row, bench, begin, bench.state, "commands STOP, QUICK_STOP")


def _lost_supervisor(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    with tempfile.TemporaryDirectory() as folder:
        path = create(Path(folder), 16)
        ring, stop = RingWriter(path), Stop()
        path.unlink()
        watch = SupervisorWatch(ring, stop, round(bench.run.period_s * 1e9))
        while not stop.wanted:
            watch.take_command()
            bench.go()
        ring.close()
    bench.order(Command.STOP)
    _orders_on(bench, lambda orders: orders.state == State.STOPPED)
    return _judged(row, bench, begin, bench.state, f"no sign for {LONGEST_SILENCE_S:g} s")


def _lost_scan(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    for _ in range(AFTERWARDS_SCANS):
        bench.silence()
    return _judged(row, bench, begin, "no controller", "0x1400:5 and 0x1016 of the drive")


def _power_failure(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    due = When(scan=bench.run.scans[-1])
    bench.faults.inject((Injected(target="drive.state", verb="drop", when=due),))
    bench.bench.plant.set_brake_current(0.0)
    for _ in range(AFTERWARDS_SCANS):
        bench.silence()
    return _judged(row, bench, begin, "no controller", "STO and no brake current")


def _shown(row: Exit, by: str, shown: dict[str, float], *, deaf: bool = False) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    bench.bench = Shown(bench.bench, shown, deaf=deaf)  # type: ignore[assignment]
    _orders_on(bench, lambda _: bench.controller.finished)
    return _judged(row, bench, begin, bench.state, by)


def _quick_stop(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    bench.order(Command.QUICK_STOP)
    _orders_on(bench, lambda _: bench.controller.finished)
    return _judged(row, bench, begin, bench.state, "command QUICK_STOP")


def _can_lost(row: Exit) -> Measured:
    return _shown(row, "link lost, no order arrives", {"links_lost": int(Link.CAN)}, deaf=True)


def _not_ready(row: Exit) -> Measured:
    return _shown(row, "status of the samples", {"sample_status": int(SampleStatus.NOT_READY)})


def _not_following(row: Exit) -> Measured:
    return _shown(row, "status word bit 12", {"drive_follows_command": 0})


PROVOKE: dict[str, Callable[[Exit], Measured | None]] = {
    "finish": _finish,
    "operator_stop": _operator_stop,
    "abort": _abort,
    "lost_supervisor": _lost_supervisor,
    "lost_scan": _lost_scan,
    "power_failure": _power_failure,
    "operator_quick_stop": _quick_stop,
    "can_lost": _can_lost,
    "sample_not_ready": _not_ready,
    "drive_not_following": _not_following,
    "devices_not_ready": devices_not_ready,
    "homing_failed": homing_failed,
    "calibration_failed": calibration_failed,
    "brake_stays_closed": brake_stays_closed,
    "enabling_device_stuck": enabling_device_stuck,
    "jog_not_stopped": jog_not_stopped,
}


def measure_exit(name: str) -> Measured | None:
    """Run one exit by its id; None for a fault that nothing provoked."""
    row = next(row for row in EXITS if row.id == name)
    return PROVOKE[name](row) if name in PROVOKE else measure_fault(row)
