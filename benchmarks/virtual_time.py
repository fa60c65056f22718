"""How much faster than real time a run in virtual time is, on one core, and how fast a record replays.

By processor time: what other programs take from a shared machine is not counted.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from controller.controller import Controller
from station.atomic_file import Appender
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import load_job
from station.bench.virtual_unit import FIXED_SEED
from station.results.replay import replay
from station.run.virtual_run import VirtualRecorder
from station.scan.realtime import quiet_collector
from station.scan.scan_loop import run_virtual, start_once
from virtual_bench.in_process import VirtualTimeBench

RECIPE = "rv-40e-121-quick"


def measure() -> tuple[float, float, int]:
    """Return the virtual-time factor, replayed scans per second, and the number of scans."""
    job = load_job(RECIPE, None)
    period_ns = job.recipe.sampling.period_ns
    bench = VirtualTimeBench(
        virtual_config(job.bench, job.profile_paths, choose_unit("P1", job.recipe, FIXED_SEED)), period_ns
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "samples.bin"
        file = Appender(path)
        recorder = VirtualRecorder(file)
        with quiet_collector():
            start = time.process_time()
            scans = run_virtual(bench, Controller(job.program), recorder.append, start_once)
            seconds = time.process_time() - start
        recorder.flush()
        file.close()
        content = path.read_bytes()
        start = time.process_time()
        found = replay(content, Controller(job.program))
        replayed_s = time.process_time() - start
    if not found.same or found.identical != scans:
        raise SystemExit(f"the run does not replay: {found}")
    return scans * period_ns * 1e-9 / seconds, scans / replayed_s, scans
