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
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from definitions.faults import FAULT_BY_ID, FAULT_BY_NUMBER
from station.atomic_file import as_json
from station.bench.files import load_named_bench
from station.bench.request import Job, stored_job, stored_job_on
from station.cli.measure.run import EXIT_BENCH
from station.documents.entries import left_out, plain
from station.documents.events import Alarm, LeftState
from station.documents.manifest import LeftBy, Setup
from station.errors import BenchFaultError, RecordError, StationError
from station.records.clocks import SCAN, VIRTUAL, WALL, clock_of
from station.records.data_folder import Store, check_operator
from station.records.left_state import left_state
from station.records.program_file import PROGRAM, StoredProgram, plain_program
from station.records.run_record import BENCH_COPY, INTERRUPTED, NOT_CONCLUDED, RECIPE_COPY, RunRecord
from station.records.samples.check import sound_table
from station.records.samples.samples import samples_bytes
from station.records.samples.table import Table
from station.records.to_paste import to_its_result
from station.reports.stored_result import result_and_doubts
from station.run.conclusion import conclude
from station.run.new_record import bench_source
from station.run.outcome import RunOutcome
from station.run.pacing import pacing_of
from station.run.supervisor import Supervisor
from station.run.way_back.guide import Guide
from station.run.way_back.recover import recover as conclude_deserted
from station.run.way_back.recoveries import is_released, recoveries
from station.version import software

ACKNOWLEDGED_BY = signal.SIGUSR1
"""Signal that is the answer of whoever has no terminal, such as the station; SIGINT leaves the bench as it is."""

NO_FAULT = FAULT_BY_ID["brake_stays_closed"].number
"""Where a run was torn off without a fault: what goes on is the lock that was left closed."""


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
    run = _last_run(Store(data), bench)
    _conclude_if_deserted(run)
    manifest = run.manifest()
    content, layout = samples_bytes(run), run.layout()
    table = sound_table(content, layout)
    if not len(table):
        raise StationError(
            f"run {run.id} has no readable records, so the state of the bench is not known. The unit may still be "
            "under torque: keep clear of its shafts"
        )
    result, doubts = result_and_doubts(run)
    as_it_was_left = run.state() not in (INTERRUPTED, NOT_CONCLUDED) and not doubts
    told = result.left if as_it_was_left else None
    before = told or left_state(table, StoredProgram.of(run), to_its_end=as_it_was_left)
    stream = sys.stderr if as_json else sys.stdout

    def say(line: str) -> None:
        stream.write(line + "\n")
        stream.flush()

    say(
        f"Run {run.id} of unit {manifest.serial} ended as {manifest.state}. Bench: "
        f"{before.text if before else 'unknown'}"
    )
    if manifest.state in ("complete", "stopped"):
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
    left = left_by(table)
    asked = _Signalled() if by_signal else _Said(_say_yes if yes else _typed)
    record = _create(data, run, job, left, None if operator is None else check_operator(operator))
    guide = Guide(job.program, say, asked.answer, asked.forget)
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


def left_by(table: Table) -> LeftBy:
    """Return what the controller of a recovery has to know of the run before: its fault and its zeroes."""
    orders = table[-1]["orders"]
    return LeftBy(
        fault=int(orders["fault"]) or NO_FAULT,
        torque_in_tare_nm=float(orders["torque_in_tare_nm"]),
        torque_out_tare_nm=float(orders["torque_out_tare_nm"]),
    )


def _last_run(store: Store, bench: str | None) -> RunRecord:
    """Return the newest run over wires, on this bench when one is named, or the recovery that came after it."""
    name = None if bench is None else load_named_bench(bench).bench.name
    runs = [*store.runs(), *recoveries(store.data).runs()]
    virtual = False
    for run in sorted(runs, key=lambda item: item.id, reverse=True):
        try:
            manifest = run.manifest()
        except RecordError as error:
            # It may be the one that left the bench as it is: a person is told before anything is asked.
            sys.stderr.write(f"WARNING  run {run.id} is passed over: {error}\n")
            continue
        if name not in (None, manifest.bench.name):
            continue
        if clock_of(manifest.clock) == VIRTUAL:
            virtual = True
        elif clock_of(manifest.clock) in (WALL, SCAN) and run.records():
            if run.state() == "recording":
                raise StationError(f"run {run.id} is still in progress. Wait for its end, or stop it")
            return run
    on = f"bench {name}" if name else "a bench"
    if virtual:
        raise StationError(
            f"folder {store.data}: all runs on {on} were in virtual time, so there is no bench to recover"
        )
    raise StationError(f"folder {store.data} has no recorded run on {on}. Name the folder of the runs with --data")


def _create(data: Path, run: RunRecord, job: Job, left: LeftBy, operator: str | None) -> RunRecord:
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
