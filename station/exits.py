"""The proof that the torque comes to zero within a bounded time on every way in which a run can end.

Each row of `exit_rows` is run in virtual time from the middle of a ramp, at more than 100 N·m; its time counts from the
cause. The faults are provoked as in the fault matrix. What friction keeps behind a closed lock is a rest, not a zero.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controller.image import Command, Image, Link, Orders, SampleStatus, State
from drivers.virtual.inprocess import VirtualTimeBench
from drivers.virtual.scenario import Fault as Injected
from drivers.virtual.scenario import When
from station.desk_watch import LONGEST_SILENCE_S, DeskWatch
from station.exit_rows import EXITS, LOAD_NM, RATED_NM, Exit
from station.fault_judge import first_alarm
from station.fault_matrix import LOW_SHARE_OF_RATED, scenario_of, undisturbed
from station.fault_rows import REST_SHARE_OF_RATED, ROWS, Row
from station.fault_run import Bench, FaultRun
from station.ring import RingWriter, create
from station.scan_loop import Stop

AFTERWARDS_SCANS = 1500


@dataclass(frozen=True)
class Measured:
    """What came of an exit. `low_s`: until the torque stays below 2 % of rated, None when friction keeps a rest.

    `down_s`: until it stays below what friction may keep. `opened_nm`: torque at which the lock was ordered open, None
    while it stays closed. `by`: what provoked it.
    """

    id: str
    state: str
    low_s: float | None
    down_s: float | None
    rest_nm: float
    opened_nm: float | None
    by: str
    wrong: tuple[str, ...]


def _below(torque_nm: list[float], share: float, period_s: float) -> float | None:
    """Time from the first value until the torque stays below a share of rated torque; None when it never does."""
    limit_nm = share * RATED_NM
    last = next((at for at in range(len(torque_nm) - 1, -1, -1) if abs(torque_nm[at]) >= limit_nm), -1)
    return None if last == len(torque_nm) - 1 else (last + 1) * period_s


def _judge(row: Exit, run: FaultRun, begin: int, state: str, by: str) -> Measured:
    torque_nm = run.torque_nm[begin:]
    low_s, down_s = (_below(torque_nm, share, run.period_s) for share in (LOW_SHARE_OF_RATED, REST_SHARE_OF_RATED))
    opened = next(
        (at for at in range(max(begin, 1), len(run.orders)) if run.orders[at - 1].brake_on > run.orders[at].brake_on),
        None,
    )
    opened_nm = None if opened is None else abs(run.torque_nm[opened])
    wrong = []
    if down_s is None or down_s > row.bound_s:
        wrong.append(f"torque down after {down_s} s, allowed {row.bound_s:g} s")
    if row.lock == "opened" and (opened_nm is None or opened_nm > LOW_SHARE_OF_RATED * RATED_NM or low_s is None):
        wrong.append(f"the lock was opened at {opened_nm} N·m")
    if row.lock == "stays closed" and opened is not None:
        wrong.append(f"the lock was opened at {opened_nm} N·m")
    return Measured(row.id, state, low_s, down_s, abs(torque_nm[-1]), opened_nm, by, tuple(wrong))


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
    return _judge(row, bench.run, begin, bench.state, "recipe")


def _operator_stop(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    bench.order(Command.STOP)
    _orders_on(bench, lambda orders: orders.state == State.STOPPED)
    return _judge(row, bench.run, begin, bench.state, "command STOP")


def _abort(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    bench.order(Command.STOP)
    for _ in range(100):
        bench.go()
    bench.order(Command.QUICK_STOP)
    _orders_on(bench, lambda _: bench.controller.finished)
    return _judge(row, bench.run, begin, bench.state, "commands STOP, QUICK_STOP")


def _lost_desk(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    with tempfile.TemporaryDirectory() as folder:
        path = create(Path(folder), 16)
        ring, stop = RingWriter(path), Stop()
        path.unlink()
        watch = DeskWatch(ring, stop, round(bench.run.period_s * 1e9))
        while not stop.wanted:
            watch.take_command()
            bench.go()
        ring.close()
    bench.order(Command.STOP)
    _orders_on(bench, lambda orders: orders.state == State.STOPPED)
    return _judge(row, bench.run, begin, bench.state, f"no sign for {LONGEST_SILENCE_S:g} s")


def _lost_scan(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    for _ in range(AFTERWARDS_SCANS):
        bench.silence()
    return _judge(row, bench.run, begin, "no controller", "0x1400:5 and 0x1016 of the drive")


def _power_failure(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    due = When(scan=bench.run.scans[-1])
    bench.faults.inject((Injected(target="drive.state", verb="drop", when=due),))
    bench.bench.plant.set_brake_current(0.0)
    for _ in range(AFTERWARDS_SCANS):
        bench.silence()
    return _judge(row, bench.run, begin, "no controller", "STO and no brake current")


class _Between:
    """Stands between controller and bench: shows what it is told to, and may keep the orders to itself."""

    def __init__(self, bench: VirtualTimeBench, shown: dict[str, int], *, deaf: bool) -> None:
        self._bench, self._shown, self._deaf = bench, shown, deaf

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bench, name)

    def read(self, scan: int, missed_periods: int, command: int) -> Image:
        """Return the bench's image with what is shown instead."""
        return self._bench.read(scan, missed_periods, command)._replace(**self._shown)

    def write(self, orders: Orders, scan: int) -> None:
        """Pass the orders on, unless the bench is deaf."""
        if not self._deaf:
            self._bench.write(orders, scan)


def _shown(row: Exit, by: str, shown: dict[str, int], *, deaf: bool = False) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    bench.bench = _Between(bench.bench, shown, deaf=deaf)  # type: ignore[assignment]
    _orders_on(bench, lambda _: bench.controller.finished)
    return _judge(row, bench.run, begin, bench.state, by)


def _quick_stop(row: Exit) -> Measured:
    bench = _loaded()
    begin = len(bench.run.orders)
    bench.order(Command.QUICK_STOP)
    _orders_on(bench, lambda _: bench.controller.finished)
    return _judge(row, bench.run, begin, bench.state, "command QUICK_STOP")


def _can_lost(row: Exit) -> Measured:
    return _shown(row, "link lost, no order arrives", {"links_lost": int(Link.CAN)}, deaf=True)


def _not_ready(row: Exit) -> Measured:
    return _shown(row, "status of the samples", {"sample_status": int(SampleStatus.NOT_READY)})


def _not_following(row: Exit) -> Measured:
    return _shown(row, "status word bit 12", {"drive_follows_command": 0})


PROVOKE: dict[str, Callable[[Exit], Measured]] = {
    "finish": _finish,
    "operator_stop": _operator_stop,
    "abort": _abort,
    "lost_desk": _lost_desk,
    "lost_scan": _lost_scan,
    "power_failure": _power_failure,
    "operator_quick_stop": _quick_stop,
    "can_lost": _can_lost,
    "sample_not_ready": _not_ready,
    "drive_not_following": _not_following,
}


def provokers(fault: str) -> list[Row]:
    """Rows of the fault matrix that may raise a fault in a ramp.

    Not those after which no drive can take the torque away: a unit that jams keeps it, and the matrix says how much.
    """
    rows = [row for row in ROWS if fault in row.causes and "ramp_pos" in row.states]
    return [row for row in rows if row.rest <= REST_SHARE_OF_RATED]


def measure_fault(row: Exit) -> Measured | None:
    """Provoke a fault in a ramp by every row of the matrix that may raise it; the slowest, None when none raises it.

    Time counts from the first alarm of the run, and another may come first: an emergency stop takes the drive's power.
    """
    worst: Measured | None = None
    for provoker in provokers(row.id):
        run = undisturbed()["ramp_pos"].branch(scenario_of(provoker, "ramp_pos")).finish()
        begin = first_alarm(run)
        if begin is None or row.id not in {event.text for event in run.alarms()}:
            continue
        found = _judge(row, run, begin, run.states[-1], provoker.name)
        if worst is None or (found.down_s or row.bound_s) > (worst.down_s or 0.0):
            worst = found
    return worst


def measure_exit(name: str) -> Measured | None:
    """Run one exit by its id; None for a fault that has no row of the matrix which raises it in a ramp."""
    row = next(row for row in EXITS if row.id == name)
    return PROVOKE[name](row) if name in PROVOKE else measure_fault(row)
