"""`lostmotion jog`: the shaft turns slowly while a key is held and the enabling device is pressed, and no longer."""

from __future__ import annotations

import contextlib
import os
import sys
import termios
import tty
from collections.abc import Iterator
from pathlib import Path

from definitions.units import SPEED
from recipes.text.quantity import show
from station.atomic_file import as_json
from station.bench.request import load_job
from station.bench.virtual_unit import VirtualUnit
from station.cli.measure.run import EXIT_BENCH
from station.documents.manifest import RecipeSource, Setup
from station.errors import BenchFaultError, StationError
from station.records.data_folder import check_operator
from station.records.program_file import PROGRAM, plain_program
from station.records.run_record import BENCH_COPY, RECIPE_COPY, RunRecord
from station.run.conclusion import conclude
from station.run.jog.jogs import JogJob, jog_job, jogs, why_no_jog
from station.run.jog.keys import OLDEST_TOKEN_S, Keys, Lines, Typed
from station.run.new_record import bench_source, unit_of
from station.run.outcome import RunOutcome
from station.run.pacing import pacing_of
from station.run.supervisor import Supervisor
from station.version import software

SERIAL = "jog"
UNIT = "P1:1"
"""The unit of a virtual bench, where none is named."""

OLDEST_ON_VIRTUAL_BENCH_S = 1.0
"""A virtual bench waits for a computer that is late, and nobody's hand is near it."""


def jog(
    recipe: str, bench: str | None, data: Path, *, speed: float, operator: str | None, unit: str | None, by_lines: bool
) -> int:
    """Jog until it is ended; 0 when the drive is off at its end, else 4.

    speed: share of the largest speed of a jog. by_lines: keys come as lines of the standard input, as the station says
    them; without it they are typed at the terminal.

    Raises:
        StationError, RecipeError: this bench has no jog, one may not begin now, or nobody is there to hold a key.

    """
    if not by_lines and not sys.stdin.isatty():
        raise StationError(
            "no terminal to hold a key at: run it in a terminal, or use the page Jog of 'lostmotion serve'"
        )
    job = jog_job(load_job(recipe, bench), speed)
    if why := why_no_jog(data, job):
        raise StationError(why)
    embedded = job.bench.bench.embedded
    virtual = VirtualUnit(UNIT if unit is None else unit, seed=1) if embedded else None
    record = _create(data, job, virtual, None if operator is None else check_operator(operator))
    _say(f"jog at up to {show(job.speed_rad_s, SPEED)}. Hold + or - to turn, q ends it")
    with _keys_as_they_are_typed(by_lines=by_lines):
        said = Lines(sys.stdin.fileno()) if by_lines else Typed(sys.stdin.fileno())
        keys = Keys(said.heard, _say, lambda: supervisor.tell_bench,
                    OLDEST_ON_VIRTUAL_BENCH_S if embedded else OLDEST_TOKEN_S)  # fmt: skip
        supervisor = Supervisor(job, record, lambda _: None, _say, attend=keys.attend, pacing=pacing_of(job))
        with contextlib.closing(record.lock):
            try:
                outcome = supervisor.run(virtual, None)
            except BenchFaultError as error:
                record.samples.touch()
                outcome = RunOutcome.refused_by(record, error)
            result = conclude(record, job, outcome).result
    for line in (*result.reasons, f"{result.state.upper()}  record {record.folder}"):
        _say(line)
    return 0 if result.state == "stopped" else EXIT_BENCH


def _create(data: Path, job: JogJob, unit: VirtualUnit | None, operator: str | None) -> RunRecord:
    header = job.recipe.recipe
    setup = Setup(
        recipe=RecipeSource(
            name=header.name, revision=header.revision, sha256=job.recipe_source.sha256,
            file=str(job.recipe_source.path),
        ),
        unit=unit_of(job, unit),
        period_ns=job.recipe.sampling.period_ns,
        clock=pacing_of(job).clock,
        software=software(),
        operator=operator,
        bench=bench_source(job),
    )  # fmt: skip
    files = {RECIPE_COPY: job.recipe_source.content, BENCH_COPY: job.bench_source.content}
    files |= {f"profiles/{source.path.name}": source.content for source in job.profile_sources.values()}
    files[PROGRAM] = as_json(plain_program(job.program))
    return jogs(data).create(SERIAL, setup, files, own=True)


def _say(line: str) -> None:
    with contextlib.suppress(OSError):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


@contextlib.contextmanager
def _keys_as_they_are_typed(*, by_lines: bool) -> Iterator[None]:
    """Have each key at once and unseen, at a terminal; as it was, in the end."""
    if by_lines:
        yield
        return
    handle = sys.stdin.fileno()
    before = termios.tcgetattr(handle)
    tty.setcbreak(handle)
    try:
        yield
    finally:
        with contextlib.suppress(OSError, termios.error):
            termios.tcsetattr(handle, termios.TCSADRAIN, before)
            os.set_blocking(handle, True)
