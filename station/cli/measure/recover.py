"""`lostmotion recover`: the recovery after a fault, also after everything was restarted with the unit still wound up.

How the last run left the bench is read from its record: its fault goes on, and so do the zeroes of its torque sensors.
The scan of a recovery runs the same controller, which waits in that fault until a person has acknowledged it and asked
for the reset. The recovery is recorded like a run, in `recoveries` below the runs.
"""

from __future__ import annotations

import contextlib
import json
import select
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from definitions.faults import FAULT_BY_NUMBER
from definitions.protections import UNPROVEN
from station.atomic_file import as_json
from station.bench.files import load_named_bench
from station.bench.request import Job, stored_job, stored_job_on
from station.cli.measure.run import EXIT_BENCH
from station.documents.entries import left_out, plain
from station.documents.events import Alarm, LeftState
from station.documents.manifest import MANIFEST, LeftBy, Manifest, Setup
from station.errors import BenchFaultError, RecordError, StationError
from station.records.clocks import SCAN, VIRTUAL, WALL, clock_of
from station.records.data_folder import Store, check_operator
from station.records.left_state import left_state
from station.records.program_file import PROGRAM, StoredProgram, plain_program
from station.records.run_record import BENCH_COPY, INTERRUPTED, NOT_CONCLUDED, RECIPE_COPY, RunRecord
from station.records.samples.check import sound_table
from station.records.samples.samples import samples_bytes
from station.records.to_paste import to_its_result
from station.reports.stored_result import result_and_doubts
from station.run.conclusion import conclude
from station.run.new_record import bench_source
from station.run.outcome import RunOutcome
from station.run.pacing import pacing_of
from station.run.supervisor import Supervisor
from station.run.way_back.guide import Guide
from station.run.way_back.how_left import HowLeft, how_left, is_released, left_as_found
from station.run.way_back.left_by import left_by
from station.run.way_back.recover import recover as conclude_deserted
from station.run.way_back.recoveries import drive_is_unproven, recoveries
from station.version import software

ACKNOWLEDGED_BY = signal.SIGUSR1
"""Signal that is the answer of whoever has no terminal, such as the station; SIGINT leaves the bench as it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """What a recovery came to: how the run left the bench, how it is left now, and whether the unit can be removed."""

    bench: str | None = left_out()
    run: str
    fault: str | None = left_out()
    before: LeftState | None
    after: LeftState | None
    released: bool
    alarms: tuple[Alarm, ...] | None = left_out()
    reasons: tuple[str, ...] | None = left_out()
    record: str


def recover(
    bench: str | None, data: Path, *, yes: bool, as_json: bool, by_signal: bool = False, operator: str | None = None
) -> int:
    """Lead a person through the recovery; 0 when the unit is unloaded and the lock open, else 4.

    yes: nobody is asked. by_signal: whoever is asked answers by `ACKNOWLEDGED_BY`. operator: who recovers the bench.

    Raises:
        StationError, RecipeError: no run has left this bench, or nobody is there to answer.

    """
    used = _used_bench(Store(data), bench)
    run = next(used, None) or _nothing_recorded(Store(data), bench)
    _conclude_if_deserted(run)
    manifest = run.manifest()
    table = sound_table(samples_bytes(run), run.layout()) if run.records() else None
    if table is not None and not len(table):
        raise StationError(
            f"run {run.id} has no readable records, so the state of the bench is not known. The unit may still be "
            "under torque: keep clear of its shafts"
        )
    result, doubts = result_and_doubts(run)
    as_it_was_left = run.state() not in (INTERRUPTED, NOT_CONCLUDED) and not doubts
    told = result.left if as_it_was_left else None
    seen = None if table is None else left_state(table, StoredProgram.of(run), to_its_end=as_it_was_left)
    before = told or seen
    stream = sys.stderr if as_json else sys.stdout

    def say(line: str) -> None:
        stream.write(line + "\n")
        stream.flush()

    say(
        f"Run {run.id} of unit {manifest.serial} ended as {manifest.state}. Bench: "
        f"{before.text if before else 'unknown'}"
    )
    if how_left(run) is HowLeft.IN_ORDER:
        say("the run ended normally: unloaded, lock open, drive off. Nothing to recover")
        if as_json:
            nothing = Recovery(run=run.id, before=before, after=before, released=True, record=str(run.folder))
            sys.stdout.write(json.dumps(plain(nothing), ensure_ascii=False) + "\n")
        return 0
    if manifest.bench.embedded and bench is None:
        raise StationError(
            f"run {run.id} was on a virtual bench, which ended with the run, so there is nothing to recover. Name a "
            "bench that is still running with --bench"
        )
    if not (yes or by_signal) and not sys.stdin.isatty():
        raise StationError(
            "no terminal to answer in: run it in a terminal, or with --yes after you have checked the bench"
        )
    job = stored_job(run) if bench is None else stored_job_on(run, bench)
    left = left_by(run, table, used)
    asked = _Signalled() if by_signal else _Said(_say_yes if yes else _typed)
    unproven = _is_unproven(manifest, job)
    operator = None if operator is None else check_operator(operator)
    record = _create(data, run, job, left, operator, notes=(UNPROVEN,) if unproven else ())
    guide = Guide(job.program, say, asked.answer, asked.forget, unproven=unproven)
    with contextlib.closing(record.lock):
        try:
            outcome = Supervisor(
                job, record, lambda _: None, say, left=left, attend=guide.attend, pacing=pacing_of(job)
            ).run(None, None)
        except BenchFaultError as error:
            record.samples.touch()
            outcome = RunOutcome.refused_by(record, error)
        result = conclude(record, job, outcome).result
    after = result.left
    released = is_released(result.state, after)
    report = Recovery(
        bench=job.bench.bench.name,
        run=run.id,
        fault=FAULT_BY_NUMBER[left.fault].id,
        before=before,
        after=after,
        released=released,
        alarms=result.alarms,
        reasons=result.reasons,
        record=str(record.folder),
    )
    if as_json:
        sys.stdout.write(json.dumps(plain(report), ensure_ascii=False) + "\n")
    for line in _last_words(report):
        say(line)
    return 0 if released else EXIT_BENCH


def _conclude_if_deserted(run: RunRecord) -> None:
    """Conclude the run that the recovery begins at; where that cannot be done now, its samples have to do."""
    if run.scanning():
        raise StationError(
            f"run {run.id} is still in progress (pid {run.scanning()}). Take it over: '{to_its_result(run)}'"
        )
    try:
        conclude_deserted(run)
    except StationError as error:
        sys.stderr.write(f"WARNING  {run.id}: cannot be concluded now: {error}\n")


def _used_bench(store: Store, bench: str | None) -> Iterator[RunRecord]:
    """Yield the runs over wires and the recoveries that used a bench, on this one when one is named, newest first.

    One that ended before it changed anything is passed over: the bench is as the one before left it. Of one that was
    killed at its start nobody can say so, although it may have no record.
    """
    name = None if bench is None else load_named_bench(bench).bench.name
    runs = [*store.runs(), *recoveries(store.data).runs()]
    for run in sorted(runs, key=lambda item: item.id, reverse=True):
        try:
            manifest = run.manifest()
        except RecordError as error:
            # It may be the one that left the bench as it is: a person is told before anything is asked.
            sys.stderr.write(f"WARNING  run {run.id} is passed over: {error}\n")
            continue
        if name not in (None, manifest.bench.name) or clock_of(manifest.clock) not in (WALL, SCAN):
            continue
        if left_as_found(run):
            continue
        if run.state() == "recording":
            raise StationError(f"run {run.id} is still in progress. Wait for its end, or stop it")
        name = manifest.bench.name  # what is read of earlier runs is of the same bench
        yield run


def _nothing_recorded(store: Store, bench: str | None) -> NoReturn:
    """Say why there is no run to recover a bench after."""
    name = None if bench is None else load_named_bench(bench).bench.name
    on = f"bench {name}" if name else "a bench"
    if any(_was_simulated(run, name) for run in store.runs()):
        raise StationError(
            f"folder {store.data}: all runs on {on} were in virtual time, so there is no bench to recover"
        )
    raise StationError(f"folder {store.data} has no recorded run on {on}. Name the folder of the runs with --data")


def _was_simulated(run: RunRecord, bench: str | None) -> bool:
    with contextlib.suppress(RecordError):
        manifest = run.manifest()
        return bench in (None, manifest.bench.name) and clock_of(manifest.clock) == VIRTUAL
    return False


def _is_unproven(manifest: Manifest, job: Job) -> bool:
    """Tell whether nobody has measured that the drive of a bench ends its torque when this program dies.

    Beside the copy of a bench file in a record lies no protocol of commissioning: there the run says how it was then.
    """
    path = job.bench_source.path
    if path.name == BENCH_COPY and RunRecord(path.parent).has(MANIFEST):
        return drive_is_unproven(manifest)
    try:
        return bool(job.no_automatic_run)
    except RecordError:
        return True  # a damaged protocol proves nothing, and must not keep the torque in the unit


def _create(
    data: Path, run: RunRecord, job: Job, left: LeftBy, operator: str | None, *, notes: tuple[str, ...]
) -> RunRecord:
    of = run.manifest()
    setup = Setup(
        recipe=of.recipe,
        unit=of.unit,
        period_ns=of.period_ns,
        clock=pacing_of(job).clock,
        software=software(),
        scenario=None,  # that of the run before is not injected again
        operator=operator,
        bench=bench_source(job),
        recovery_of=run.id,
        left=left,
        notes=notes,
    )
    files = {RECIPE_COPY: job.recipe_source.content, BENCH_COPY: job.bench_source.content}
    files |= {f"profiles/{source.path.name}": source.content for source in job.profile_sources.values()}
    files[PROGRAM] = as_json(plain_program(job.program))
    return recoveries(data).create(of.serial, setup, files, own=True)


class _Said:
    """The answer of a person at this terminal, or of one who has checked the bench before."""

    def __init__(self, answer: Callable[[], str | None]) -> None:
        self.answer = answer

    def forget(self) -> None:
        """What was typed ahead counts: it was typed here."""


class _Signalled:
    """The answer of a person who has no terminal here. What came before the question is no answer to it."""

    def __init__(self) -> None:
        self._heard = False
        signal.signal(ACKNOWLEDGED_BY, self._hear)

    def _hear(self, *_: object) -> None:
        self._heard = True

    def forget(self) -> None:
        """A question is asked now."""
        self._heard = False

    def answer(self) -> str | None:
        """Return yes once it was said, None before."""
        return "y" if self._heard else None


def _say_yes() -> str | None:
    return "y"


def _typed() -> str | None:
    """Return a line that was typed, '' at the end of the input, None while there is none."""
    ready, _, _ = select.select([sys.stdin], [], [], 0)
    return sys.stdin.readline() if ready else None


def _last_words(report: Recovery) -> list[str]:
    after = report.after
    left = f"{after.text}: {after.next_action}" if after else "the bench said nothing"
    if report.released:
        return [f"RELEASED  {left}", f"record {report.record}"]
    reasons = [f"  {reason}" for reason in report.reasons or ()]
    return [f"NOT RELEASED  {left}", *reasons, f"record {report.record}"]
