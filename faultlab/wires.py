"""A run with faults over real wires: the virtual bench in a process of its own, the same judge on its record.

Times come from three clocks that are one: the scan's deadlines, the bench's note of when a fault acted, and the trace
of the torque in the reducer are all on the clock of the scans: the monotonic clock of this machine, or, where the bench
waits for the scan, the count of scans itself.
"""

from __future__ import annotations

import csv
import json
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from controller.context import Event
from controller.sample import tared_nm
from faultlab.run import FaultRun, Kept
from faultlab.supervisor import Left, needs_supervisor_of_its_own, run_apart, run_here
from station.bench.assemble_virtual import load_scenario, vocabulary_on
from station.bench.request import Job
from station.bench.virtual_unit import VirtualUnit
from station.documents.result import Result
from station.records.clocks import Pacing
from station.records.run_record import RESULT, RunRecord
from station.records.samples.check import check_bytes
from station.records.samples.samples import samples_bytes
from station.records.samples.scan_record import RECORD_BYTES, unpack
from station.run.faults.machine_faults import deed_of
from station.run.process_specs import TRUTH
from station.run.supervisor import BENCH_LOG
from virtual_bench.devices.process_lines import ACTED, NOT_SEEN
from virtual_bench.faults.scenario import Fault
from virtual_bench.faults.schedule import never_due, never_met

WIRE_SCANS = 4
"""Scans by which a bound over wires is longer than in virtual time: the scan in which the fault acted is rounded down,
the bench looks at its faults every 2 ms, and what it says takes up to a scan to arrive."""

HELD_UP_NS = 5_000_000
"""A bench that did not tick for so long was held up by the machine: what it then did late was not the fault's doing."""

END_STATES = ("complete", "stopped", "fault")
Say = Callable[[str], None]


@dataclass
class WireRun:
    """A finished run over wires: what the judge wants, its folder, and what the machine did to it."""

    run: FaultRun
    record: RunRecord
    held_up: str = ""


def run_over_wires(
    job: Job,
    unit: VirtualUnit | None,
    scenario_path: Path,
    data: Path,
    say: Say,
    *,
    pacing: Pacing,
) -> WireRun:
    """Run a scenario over wires; its record is kept below `data`.

    Without a unit the bench is one on a cable, and a gateway on the way to it brings the faults about. Faults of the
    machine reach a supervisor in a process of its own.

    Raises:
        StationError: the record cannot be written.

    """
    scenario = load_scenario(scenario_path, vocabulary_on(job.bench, job.profile_sources))
    if needs_supervisor_of_its_own(scenario):
        left = run_apart(job, unit, scenario_path, data)
    else:
        left = run_here(job, unit, scenario_path, data, say, pacing=pacing)
    found = read_run(left)
    named = {name for name, _ in found.run.acted}
    unproven = [why for fault in scenario.faults if (why := _unproven(fault, left, named))]
    found.run.unseen += unproven
    if not found.run.acted and not found.run.unseen and not left.refused:
        found.run.unseen = [f"{never_met(fault)}: the bench's log does not name it" for fault in scenario.faults]
    return found


def _unproven(fault: Fault, left: Left, named: set[str]) -> str:
    """Say of a fault of the machine that it was not done, or that the run shows nothing of it."""
    deed = deed_of(fault)
    if deed is None:
        return ""
    if f"{fault.target} {fault.verb}" not in named:
        return never_due(fault)
    return "" if deed.proof(left.traces, fault.value or 0.0) else never_met(fault)


def read_run(left: Left) -> WireRun:
    """Return what the judge wants from the record of a run that has ended, and from what its bench said."""
    record = left.record
    period_ns = record.manifest().period_ns
    run = FaultRun(period_ns * 1e-9, refused=left.refused)
    content = samples_bytes(record)
    for start in range(0, len(content) - RECORD_BYTES + 1, RECORD_BYTES):
        scan, image, orders = unpack(memoryview(content)[start : start + RECORD_BYTES])
        run.scans.append(scan)
        run.images.append(image)
        run.orders.append(orders)
    result = record.read(Result, RESULT)
    run.events = [Event(alarm.scan, "alarm", alarm.state, alarm.id) for alarm in result.alarms]
    run.finished = not left.died and not left.refused and bool(run.states) and run.states[-1] in END_STATES
    run.kept = Kept(result.state, result.verdict, check_bytes(content, left.written).problems)
    bench_log = _said(record.folder / BENCH_LOG)
    actions = [(line["text"], int(line["clock_ns"])) for line in bench_log if line["event"] == ACTED]
    _place_actions(run, actions, left.started_ns, period_ns)
    run.unseen = [line["text"] for line in bench_log if line["event"] == NOT_SEEN]
    return WireRun(run, record, _add_truth(run, record.folder / TRUTH, left, period_ns))


def _said(path: Path) -> list[dict[str, Any]]:
    lines = path.read_text("utf-8").splitlines() if path.exists() else []
    return [json.loads(line) for line in lines if line.startswith("{")]  # a bench that failed leaves its traceback too


def _place_actions(run: FaultRun, actions: list[tuple[str, int]], started_ns: int, period_ns: int) -> None:
    """Put every fault that acted at the last scan that was due before it."""
    if not run.scans:  # refused: there is no scan to put them at
        return
    for name, time_ns in sorted(actions, key=itemgetter(1)):
        scan = (time_ns - started_ns) // period_ns - 1
        run.acted.append((name, max(bisect_left(run.scans, scan + 1) - 1, 0)))


def _add_truth(run: FaultRun, path: Path, left: Left, period_ns: int) -> str:
    """Add the torque in the reducer at every scan; return how the machine held the bench up, if it did.

    A scan that was lost gives no orders any more, but the bench goes on for a moment: what it did then is added, in
    periods without a scan.
    """
    if not path.exists():  # a bench on a cable: there is nothing but its own sensor
        run.torque_nm = [tared_nm(image, orders)[1] for image, orders in zip(run.images, run.orders, strict=True)]
        return ""
    if not run.scans:
        return ""
    with path.open(encoding="ascii", newline="") as stream:
        rows = [(int(row["clock_ns"]), float(row["reducer_torque_nm"])) for row in csv.DictReader(stream)]
    times_ns = np.array([row[0] for row in rows], np.float64) - left.started_ns
    while left.died and (run.scans[-1] + 2) * period_ns < times_ns[-1]:
        run.scans.append(run.scans[-1] + 1)
        run.images.append(run.images[-1])
        run.orders.append(run.orders[-1])
    deadlines_ns = (np.array(run.scans, np.float64) + 1) * period_ns
    run.torque_nm = [float(x) for x in np.interp(deadlines_ns, times_ns, [row[1] for row in rows])]
    last = deadlines_ns[run.place(run.alarms()[0].scan)] if run.alarms() else deadlines_ns[-1]
    gaps_ns = np.diff(times_ns[(times_ns >= 0) & (times_ns <= last)])
    worst_ns = float(gaps_ns.max(initial=0.0))
    return "" if worst_ns < HELD_UP_NS else f"the machine held the virtual bench up for {worst_ns * 1e-6:.0f} ms"
