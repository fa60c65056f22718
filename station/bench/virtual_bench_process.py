"""Entry of the embedded virtual bench: `python -m station.bench.virtual_bench_process SPEC.json`.

The spec is a `BenchSpec`. The ready line with the ports goes to standard output, what the drive and the injected faults
do to standard error, one JSON line each.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import uvloop

from recipes import Bench, RecipeError
from station.bench.assemble_virtual import load_scenario, server_config, vocabulary_on
from station.bench.bench_spec import BenchSpec
from station.bench.files import FileAt, load_named_bench
from station.documents.reading import document_in, read_document
from station.records.clocks import SCAN
from virtual_bench.config import ServerConfig
from virtual_bench.devices.process_lines import log_line
from virtual_bench.errors import VirtualBenchError
from virtual_bench.physics.plant import warm_up
from virtual_bench.server import run

FIFO_PRIORITY = 60
"""The bench plays hardware, which never waits for a processor: below the scan, above everything ordinary."""


def serve(spec: BenchSpec) -> None:
    """Run the virtual bench of a spec until it is told to end or its parents are gone."""
    bench = load_named_bench(spec.bench)
    config = _config(spec, bench)
    faults = None
    if config.scenario is not None:
        named = {name: FileAt(Path(path)) for name, path in spec.profiles.items()}
        faults = load_scenario(config.scenario, vocabulary_on(bench, named))
    play_hardware(config)
    uvloop.run(run(config, faults))


def _config(spec: BenchSpec, bench: Bench) -> ServerConfig:
    if spec.unit is None:
        raise VirtualBenchError(
            "the virtual bench was started without a unit under test. Start it with 'lostmotion virtual-bench'"
        )
    return server_config(
        bench,
        {name: Path(path) for name, path in spec.profiles.items()},
        spec.unit,
        scenario=None if spec.scenario is None else Path(spec.scenario),
        embedded=spec.embedded,
        truth=None if spec.truth is None else Path(spec.truth),
        waits=spec.clock == SCAN,
    )


def play_hardware(config: ServerConfig) -> None:
    """Compile the physics, then ask for a priority below the scan's and above everything ordinary."""
    warm_up(config.bench)  # compiling takes seconds: not with a priority that keeps others waiting
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    except OSError as error:
        log_line("fifo_refused", str(error))


def prepare(like: str) -> Callable[[], int]:
    """Make the plant of a likely spec once, so that all is loaded; return what is to be done with the order.

    like: that spec as JSON. What is wrong with it is told by the run that it is for.
    """
    with suppress(VirtualBenchError, RecipeError):
        spec = document_in(BenchSpec, like.encode(), Path("likely spec"))
        warm_up(_config(spec, load_named_bench(spec.bench)).bench)
    return main


def main() -> int:
    """Read the spec and serve; 2 when the bench cannot be had as asked."""
    try:
        serve(read_document(BenchSpec, Path(sys.argv[1])))
    except (VirtualBenchError, RecipeError) as error:
        log_line("refused", str(error))
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
