"""The supervisor that waits for a scan: `lostmotion run`, loaded ahead together with the processes that it starts.

It runs what it has loaded. Where the program on the disk has changed since then, it begins anew with that one.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module

from recipes import RecipeError
from station.bench.assemble_virtual import choose_unit
from station.bench.request import load_job
from station.bench.virtual_unit import FIXED_SEED
from station.cli import command_line, main
from station.documents.manifest import Manifest
from station.documents.reading import adapter
from station.documents.result import Result
from station.documents.timing import Timing
from station.errors import StationError
from station.own_program import own_module
from station.results.evaluation import load_ahead
from station.run.ahead import Ahead
from station.run.children import SCAN, VIRTUAL_BENCH, start_ahead
from station.run.process_specs import likely_bench_spec
from station.version import program_seen, software
from virtual_bench.errors import VirtualBenchError

LOADED = (
    "station.cli.measure.run",
    "station.run.supervisor",
    "station.store.view",
    "sqlalchemy.dialects.sqlite.pysqlite",
)
"""What `lostmotion run` loads when it first needs it."""

READY_WITHIN_S = 30.0


def prepare(recipe: str = "", bench: str = "") -> Callable[[], int]:
    """Load what a run needs, and start its processes ahead; return what is to be done with the order.

    recipe, bench: those of the unit that is likely to come, '' for none. Another unit may come: it takes longer.
    """
    seen = program_seen()
    ahead = {SCAN: start_ahead(SCAN)}
    ahead |= _rehearsed(recipe, bench or None)
    load()
    for one in ahead.values():
        one.wait_until_ready(READY_WITHIN_S)

    def run() -> int:
        try:
            if program_seen() == seen:
                main(ahead)
        finally:
            for one in ahead.values():
                one.end()
        os.execv(sys.executable, own_module("station", *sys.argv[1:]))  # noqa: S606 - our own program

    return run


def load() -> None:
    """Load what a run needs, and make what it makes once; those who fork for a run do so before."""
    for name in LOADED:
        import_module(name)
    load_ahead()
    command_line("run")
    software()
    for kind in (Manifest, Result, Timing):
        adapter(kind)


def _rehearsed(recipe: str, bench: str | None) -> dict[str, Ahead]:
    """Read a recipe and its bench once, and start the virtual bench where it is on one; what is wrong is told later."""
    if recipe:
        with suppress(RecipeError, StationError, VirtualBenchError):
            job = load_job(recipe, bench)
            _ = job.program
            if job.bench.bench.embedded:
                spec = likely_bench_spec(job, choose_unit(None, job.recipe, FIXED_SEED))
                return {VIRTUAL_BENCH: start_ahead(VIRTUAL_BENCH, spec)}
    return {}
