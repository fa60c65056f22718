"""Entry of the process that measures a machine: `python -m station.timing.process SHA256 SPEC.json`.

The whole scan as in a run (CAN, Modbus, controller, record), but nobody starts it: the controller stays idle, the drive
is never enabled, and nothing moves. It ends after a number of periods. As the scan process it reads what was compiled,
`TimingSpec`, and nothing else.
"""

from __future__ import annotations

import json
import resource
import sys
from contextlib import ExitStack
from pathlib import Path

from controller.controller import Controller
from definitions.image import Image, Orders
from drivers.errors import DriverError
from drivers.wire_bench import WireBench
from station.bench.bench_lock import BenchBusyError, alone_on
from station.documents.entries import plain
from station.documents.scan_report import Memory
from station.records.ring.ring import ScanState
from station.records.ring.writer import RingWriter
from station.records.scan_times import ScanTimes
from station.scan import realtime
from station.scan.machine import resident_kb
from station.scan.scan_loop import Stop, run_real
from station.scan.scan_spec import EXIT_REFUSED, SpecError, TimingSpec, read_program, told
from station.scan.schedule import RealTimeSchedule
from station.timing.report import ProcessReport, Scanned

NO_COMMAND = 0


class Idle:
    """A controller that nobody starts, finished after a number of periods."""

    def __init__(self, controller: Controller, periods: int) -> None:
        self._step = controller.step
        self._last = periods - 1
        self.finished = False

    def step(self, image: Image, scan: int) -> Orders:
        """Decide one scan."""
        self.finished = scan >= self._last
        return self._step(image, scan)


def measure(spec: TimingSpec, ring: RingWriter) -> Scanned:
    """Open the bench, scan, and return what was counted; DriverError when the bench cannot be opened."""
    compiled = spec.compiled
    period_ns = compiled.wires.period_ns
    controller = Idle(Controller(read_program(compiled)), spec.periods)
    bench = WireBench(compiled.wires)
    with ExitStack() as cleanup:
        if compiled.alone:
            cleanup.enter_context(alone_on(compiled.bench, compiled.wires.can, compiled.wires.modbus))
        bench.open()
        cleanup.callback(bench.close)
        grants = realtime.request_all()
        spin_ns, spinning = realtime.spin_tail(spec.spin_ns, grants)
        schedule = RealTimeSchedule(period_ns, spin_ns=spin_ns)
        ring.set_state(ScanState.RUNNING)
        times = ScanTimes()
        before_kb = resident_kb()
        stop = Stop()
        last = run_real(bench, controller, ring.append, lambda: NO_COMMAND, schedule=schedule, stop=stop, times=times)
        after_kb = resident_kb()
        counters = bench.counters()
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return Scanned(
        periods=last + 1,
        scans=ring.sequence,
        lost=ring.lost,
        missed=times.missed,
        realtime=realtime.answers((*grants, spinning)),
        lateness_us=times.counts["lateness"].percentiles(),
        work_us=times.counts["work"].percentiles(),
        parts_us=times.parts_us(),
        histograms_us=times.histograms_us(),
        gaps=times.gap_list(),
        gaps_in_all=times.gaps,
        longest_scans=tuple(one.row() for one in times.longest()),
        latest_scans=tuple(one.row() for one in times.latest()),
        counters=counters,
        resident_kb=Memory(before=before_kb, after=after_kb),
        preempted=usage.ru_nivcsw,
    )


def main() -> int:
    """Measure as the spec says and write the report; 2 when the bench was refused."""
    try:
        spec = told(sys.argv, TimingSpec)
    except SpecError as error:  # it names the ring and the report: there is nowhere else to say so
        sys.stderr.write(f"{error}\n")
        return EXIT_REFUSED
    ring = RingWriter(Path(spec.ring))
    code = 0
    try:
        report = ProcessReport(scanned=measure(spec, ring))
    except (DriverError, SpecError, BenchBusyError) as error:
        code, report = EXIT_REFUSED, ProcessReport(error=str(error))
    Path(spec.report).write_text(json.dumps(plain(report), ensure_ascii=False), encoding="utf-8")
    ring.set_state(ScanState.FINISHED)
    ring.close()
    return code


if __name__ == "__main__":
    sys.exit(main())
