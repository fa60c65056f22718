"""Entry of the process that measures a machine: `python -m station.timing.process SPEC.json`.

The whole scan as in a run (CAN, Modbus, controller, record), but nobody starts it: the controller stays idle, the drive
is never enabled, and nothing moves. It ends after a number of periods.

Spec: as of `scan_process`, and `periods` (how many) and `period_ns`.
"""

from __future__ import annotations

import json
import resource
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from controller.controller import Controller
from definitions.image import Image, Orders
from drivers.errors import DriverError
from drivers.wire_bench import WireBench
from recipes import Recipe, RecipeError, load_bench, load_recipe
from recipes.compiler.compiler import compile_program
from station.bench.assemble import wire_config
from station.bench.bench_lock import BenchBusyError, alone_on
from station.records.ring.ring import ScanState
from station.records.ring.writer import RingWriter
from station.records.scan_times import ScanTimes
from station.scan import realtime
from station.scan.machine import resident_kb
from station.scan.scan_loop import Stop, run_real
from station.scan.schedule import RealTimeSchedule

EXIT_REFUSED = 2
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


def with_period(recipe: Recipe, period_ns: int) -> Recipe:
    """Return a recipe that is scanned at another period."""
    sampling = recipe.sampling.model_copy(update={"period_ns": period_ns})
    return recipe.model_copy(update={"sampling": sampling})


def measure(spec: dict[str, Any], ring: RingWriter) -> dict[str, Any]:
    """Open the bench, scan, and return the report; DriverError when the bench cannot be opened."""
    period_ns = spec["period_ns"]
    recipe, bench_file = with_period(load_recipe(spec["recipe"]), period_ns), load_bench(spec["bench"])
    profiles = {name: Path(path) for name, path in spec["profiles"].items()}
    controller = Idle(Controller(compile_program(recipe, bench_file)), spec["periods"])
    bench = WireBench(wire_config(bench_file, profiles, period_ns, spec["ports"]))
    with ExitStack() as ending:
        if spec["ports"] is None:
            ending.enter_context(alone_on(bench_file))
        bench.open()
        ending.callback(bench.close)
        grants = realtime.request_all()
        spin_ns, spinning = realtime.spin_tail(spec["spin_ns"], grants)
        schedule = RealTimeSchedule(period_ns, spin_ns=spin_ns)
        ring.set_state(ScanState.RUNNING)
        times = ScanTimes()
        before_kb = resident_kb()
        stop = Stop()
        last = run_real(bench, controller, ring.append, lambda: NO_COMMAND, schedule=schedule, stop=stop, times=times)
        after_kb = resident_kb()
        counters = bench.counters()
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return {
        "state": "finished",
        "periods": last + 1,
        "scans": ring.sequence,
        "lost": ring.lost,
        "missed": times.missed,
        "realtime": realtime.as_json((*grants, spinning)),
        "lateness_us": times.counts["lateness"].to_dict(),
        "work_us": times.counts["work"].to_dict(),
        **times.to_dict(),
        "counters": counters,
        "resident_kb": {"before": before_kb, "after": after_kb},
        "preempted": usage.ru_nivcsw,
    }


def main() -> int:
    """Measure as the spec says and write the report; 2 when the bench was refused."""
    sys.modules["numpy"] = None  # type: ignore[assignment] # as in the scan process, whose likeness this is
    spec = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    ring = RingWriter(Path(spec["ring"]))
    code = 0
    try:
        report = measure(spec, ring)
    except (DriverError, RecipeError, BenchBusyError) as error:
        code, report = EXIT_REFUSED, {"state": "refused", "error": str(error)}
    Path(spec["report"]).write_text(json.dumps(report, ensure_ascii=False), encoding="utf-8")
    ring.set_state(ScanState.FINISHED)
    ring.close()
    return code


if __name__ == "__main__":
    sys.exit(main())
