"""`lostmotion run`: the main job, from a recipe to a verdict on disk."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recipes import Recipe, out_of_date
from station.bench.request import Job, Source, load_job
from station.bench.virtual_unit import VirtualUnit
from station.documents.entries import plain
from station.documents.manifest import StudyPlace
from station.documents.result import Result
from station.errors import BenchFaultError, RecordError, StationError
from station.log import open_log
from station.records.chain.keys import own_key
from station.records.clock_behind import SAY_SO, ClockBehind, clock_behind
from station.records.clocks import SCAN, VIRTUAL, Pacing
from station.records.data_folder import Store, check_note, check_operator, check_reason, check_serial
from station.records.run_record import INTERRUPTED, RECORDING, RunRecord
from station.records.to_paste import to_paste
from station.reports.result_view import result_console, show_report, show_result
from station.reports.stored_result import stored_result
from station.results.evaluation import load_ahead
from station.run.ahead import Ahead
from station.run.conclusion import NOT_DECIDABLE, Conclusion, conclude
from station.run.disk_space import refuse_full_disk
from station.run.new_record import Wanted, new_record
from station.run.outcome import SUPERVISOR_REPORT, RunOutcome
from station.run.pacing import pacing_of
from station.run.screen.progress import Progress, progress_of
from station.run.way_back.left_behind import collect, conclude_own
from station.wall_clock import now_text

if TYPE_CHECKING:
    from station.reports.illustrate import Shown
    from station.run.faults.companion import Companion
    from virtual_bench.faults.scenario import Scenario

EXIT_CODES = {"PASS": 0, "FAIL": 1, "NOT DECIDABLE": 3}
EXIT_BENCH = 4
UNNAMED = "unnamed"
CATCH_UP_S = 1.0
"""Most time that a run spends at its start, and again behind its result, on a store that is behind."""


@dataclasses.dataclass(frozen=True)
class Options:
    """What the command line asked for."""

    recipe: str
    serial: str | None
    bench: str | None
    data: Path
    unit: str | None
    scenario: Path | None
    virtual_time: bool
    json: bool
    operator: str | None = None
    """Who measures, for gage studies; not everybody is asked."""
    seed: int | None = None
    """Of the noise on the virtual bench; drawn where nobody gives one."""
    report: bool | None = None
    """Whether report and pictures are made when the result is on the screen; None: as the recipe says."""
    wall_clock: bool = False
    """Whether a virtual bench lives by the wall clock, as real hardware does, instead of waiting for the scan."""
    retest_reason: str | None = None
    """Why a unit is measured again; it stands in the record."""
    notes: tuple[str, ...] = ()
    """What else is to stand in record and report, such as a start condition that was bypassed."""
    clock_is_right: str | None = None
    """Why the computer's clock is right, though entries of the chain are later; it stands in record and chain."""
    fast: bool = False
    """Whether scans follow each other without waiting for deadlines, on a bench that waits for them."""
    study: str | None = None
    """Name of the guided study whose next step this run measures."""
    judged: tuple[str, ...] = ()
    """SHA-256 of the recipe and the bench that the start was allowed for; nothing where nobody was asked."""


def exit_code(result: Result) -> int:
    """Return the exit code of a result: 4 for a run that did not come to its end, else by its verdict."""
    if result.state not in ("complete", "analyzed"):
        return EXIT_BENCH
    return EXIT_CODES[result.verdict]


def run(options: Options, ahead: Mapping[str, Ahead] | None = None) -> int:
    """Run a recipe; return the exit code. ahead: processes that were started before and wait, by their modules.

    Raises:
        StationError, RecipeError, VirtualBenchError: bad input, before anything has moved.

    """
    if options.serial is not None:
        check_serial(options.serial)
    operator = None if options.operator is None else check_operator(options.operator)
    reason = None if options.retest_reason is None else check_reason(options.retest_reason)
    right = None if options.clock_is_right is None else check_note(options.clock_is_right, "--clock-is-right")
    options = dataclasses.replace(options, operator=operator, retest_reason=reason, clock_is_right=right)
    job = load_job(options.recipe, options.bench)
    _refuse_another(options.judged, job)
    if not options.virtual_time and job.no_automatic_run:
        raise StationError(job.no_automatic_run)
    unit = _unit(options, job)
    scenario, pacing = _faults_and_clock(options, job)
    serial = _serial(options, job)
    refuse_full_disk(options.data, job)
    _check_key(job)
    _put_in_order(Store(options.data), job)
    study = None if options.study is None else _study_step(options, serial, scenario, job)
    behind = clock_behind(options.data)
    notes = [*(check_note(one) for one in options.notes), *_clock_notes(behind, options.clock_is_right, job)]
    notes += _serial_notes(options.data, serial) + recipe_notes(options.data, job)
    notes += [] if study is None else [f"{study}: not production"]
    reason, clock_right = _reason(options, serial, study), options.clock_is_right if behind is not None else None
    wanted = Wanted(serial, unit, scenario, options.operator, pacing.clock, reason, study, clock_right or "")
    record = new_record(options.data, job, wanted, notes=notes)
    for note in record.manifest().notes:
        sys.stderr.write(f"WARNING  {note}\n")
    with contextlib.closing(record.lock), open_log(record.folder / "log.jsonl") as log:
        log.info(
            "run started",
            run=record.id,
            serial=serial,
            recipe=job.recipe.recipe.name,
            unit=str(unit),
        )
        try:
            with progress_of(job, serial, as_json=options.json) as progress:
                progress.say(f"{progress.title}: {record.id}")
                if options.virtual_time and not job.bench.bench.embedded:
                    progress.say(f"virtual time: bench {job.bench.bench.name} is simulated, its devices are not used")
                conclusion = _conclude(pacing, job, record, unit, progress, ahead)
        except BaseException as error:
            with contextlib.suppress(OSError, RecordError):
                log.exception("run failed", kind=type(error).__name__)
                # A run that waits for its disk stays as it is, and so does one that has ended and was not concluded:
                # `conclude` completes and concludes it.
                waits = isinstance(error, RecordError)
                waits |= record.has(SUPERVISOR_REPORT) and isinstance(error, OSError | KeyboardInterrupt)
                if not waits and record.manifest().state == RECORDING:
                    record.update(state=INTERRUPTED, ended=now_text(), trouble=str(error))
            if isinstance(error, RecordError):
                return no_record(record, error, as_json=options.json)
            raise
        shown = partial(_shown, job, conclusion) if report_wanted(job.recipe, asked=options.report) else None
        return finish(record, conclusion.result, shown, log, as_json=options.json)


def finish(record: RunRecord, result: Result, shown: Callable[[], Shown] | None, log: Any, *, as_json: bool) -> int:
    """Tell the result of a run that was just concluded, and its report where `shown` is given; return the exit code.

    The operator waits for the result, nobody for the report: that is made when the result is on the screen.
    """
    log.info("run ended", state=result.state, verdict=result.verdict, reasons=list(result.reasons))
    try:
        print_result(result, as_json=as_json)
    finally:  # whoever read the progress may be gone: the run is stored and reported like any other
        bring_up_store(record.folder.parent)
        if shown is not None:
            _report(record, shown, log, as_json=as_json)
    if shown is None and not as_json:
        sys.stdout.write(f"report  {to_paste('report', str(record.folder))}\n")
    return exit_code(result)


def _serial_notes(data: Path, serial: str) -> list[str]:
    other = Store(data).other_case_of(serial)
    return (
        [f"unit {other} is known here, and this is unit {serial}: compare the label. They differ by case only"]
        if other
        else []
    )


def _clock_notes(behind: ClockBehind | None, right: str | None, job: Job) -> list[str]:
    """Return what a run notes of a clock that is behind; right: why it is right, where somebody says so.

    Raises:
        StationError: nobody says so, and by the later time something that the run measures by is out of date.

    """
    if behind is None:
        return []
    if right is not None:
        return [behind.right(right)]
    if late := out_of_date(job.recipe, job.bench, behind.at.date()):
        raise StationError(
            f"{behind.found}. By the later time: {'; '.join(late)}. Set the clock, or measure again what is out of "
            f"date. If the clock is right now, run once with {SAY_SO}; the record keeps it"
        )
    return [behind.note]


def _study_step(options: Options, serial: str, scenario: Source | None, job: Job) -> StudyPlace:
    """Return the step of a guided study that this run measures.

    Raises:
        StationError: another unit, operator, recipe or bench is next, or faults are to be injected.

    """
    from station.quality.guided.progress import look, place_of  # noqa: PLC0415 - for studies only

    if scenario is not None:
        raise StationError("--scenario: a run with injected faults cannot count in a study. Leave out --scenario")
    return place_of(look(options.data, options.study or ""), serial, options.operator, job)


def _reason(options: Options, serial: str, study: StudyPlace | None) -> str | None:
    """Return why the unit is measured again: of a unit that was measured before, the study is the reason."""
    if study is None or options.retest_reason is not None or not Store(options.data).attempts_of(serial):
        return options.retest_reason
    return str(study)


def _refuse_another(judged: tuple[str, ...], job: Job) -> None:
    """Refuse a recipe or bench that is not, letter by letter, what the start was allowed for.

    Raises:
        StationError: the file has changed since.

    """
    for source in (job.recipe_source, job.bench_source):
        if judged and source.sha256 not in judged:
            raise StationError(
                f"file {source.path} was changed after the start was allowed (SHA-256 now {source.sha256[:12]}…). "
                "Nothing was started. Scan the unit again"
            )


def report_wanted(recipe: Recipe, *, asked: bool | None) -> bool:
    """Whether report and pictures are made after a run: as the command line asks, else as the recipe says."""
    return recipe.report == "always" if asked is None else asked


def print_result(result: Result, *, as_json: bool) -> None:
    """Print a result for a person or for a program."""
    if as_json:
        sys.stdout.write(json.dumps(plain(result), ensure_ascii=False) + "\n")
    else:
        show_result(result_console(), result)
    sys.stdout.flush()


def _shown(job: Job, conclusion: Conclusion) -> Shown:
    from station.reports.illustrate import Shown  # noqa: PLC0415 - brings matplotlib, late enough here

    return Shown(job, conclusion.result, conclusion.analysis)


def _report(record: RunRecord, shown: Callable[[], Shown], log: Any, *, as_json: bool) -> None:
    """Write pictures and reports; without them the run is none the worse, and that they are missing is said."""
    from station.reports.illustrate import HTML, write_reports  # noqa: PLC0415 - brings matplotlib, late enough here

    try:
        write_reports(record, shown())
    except Exception as error:
        log.exception("no report", kind=type(error).__name__)
        sys.stderr.write(f"warning: plot and report are incomplete, the result is stored: {error}\n")
        return
    log.info("report written", path=str(record.folder / HTML))
    if not as_json:
        show_report(result_console(), record.folder)


def no_record(record: RunRecord, error: RecordError, *, as_json: bool) -> int:
    """Tell that the disk refused the record; return the exit code. There is no verdict without a record."""
    text = f"the record could not be kept, so there is no verdict: {error}"
    if record.has(SUPERVISOR_REPORT):
        again = to_paste("conclude", record.id, data=record.folder.parent)
        text += f". The run itself is stored: when the disk works again, '{again}' concludes it"
    sys.stderr.write(f"{text}\n")
    if as_json:
        try:
            stored = plain(stored_result(record))
        except (OSError, StationError):  # a disk that takes nothing may give nothing back either
            stored = {"run": record.id, "record": str(record.folder)}
        result = stored | {"state": INTERRUPTED, "verdict": NOT_DECIDABLE, "reasons": [text]}
        sys.stdout.write(json.dumps(result, ensure_ascii=False) + "\n")
    return EXIT_BENCH


def recipe_notes(data: Path, job: Job) -> list[str]:
    """Return what is to be noted of a recipe: unusual limits, and that its name has meant something else before."""
    recipe, sha256 = job.recipe.recipe, job.recipe_source.sha256
    before = _recipe_before(data, recipe.name, recipe.revision, sha256)
    if before is None:
        return job.warnings
    run, other = before
    note = (
        f"recipe {recipe.name} revision {recipe.revision} ({sha256[:8]}) is not the one of that name and revision that "
        f"run {run} used ({other[:8]}): their verdicts cannot be compared. "
        "Raise the revision when a recipe is changed"
    )
    return [note, *job.warnings]


def _tell(line: str) -> None:
    sys.stderr.write(f"{line}\n")


def _put_in_order(store: Store, job: Job) -> None:
    """Conclude the runs of this bench whose supervisor died, and remove rings that nobody needs; say each run."""
    conclude_own(store, job.bench.bench.name, _tell)
    collect(store)


def _recipe_before(data: Path, name: str, revision: int, sha256: str) -> tuple[str, str] | None:
    """Ask the store; a run starts without its answer where there is none within a second."""
    from station.store.view import another_recipe, warn  # noqa: PLC0415 - brings SQLAlchemy, which help does without

    if not data.is_dir():
        return None
    try:
        return another_recipe(data, name, revision, sha256, most_s=CATCH_UP_S)
    except Exception as error:  # noqa: BLE001 - as below: no database keeps a unit from being measured
        warn(f"{error}. The run goes on without it")
        return None


def bring_up_store(data: Path) -> None:
    """Put a run that was just concluded into the store; where that fails it is said, and the next one does it."""
    from station.store.view import bring_up, warn  # noqa: PLC0415 - as above

    try:
        left = bring_up(data, CATCH_UP_S)
    except Exception as error:  # noqa: BLE001 - whatever a database comes up with, the run is concluded
        warn(f"{error}. The run is stored in its folder; the store is brought up later")
        return
    if left:
        warn(f"the store is behind by {left} runs. Bring it up with 'lostmotion list' or 'lostmotion store rebuild'")


def _check_key(job: Job) -> None:
    """Refuse a bench file that names another key than this computer's: nobody could verify the run's signature."""
    named = job.bench.bench.public_key
    own = own_key().public
    if named is not None and named != own:
        raise StationError(
            f"{job.bench_source.path}: bench.public_key: found {named}; this computer signs with {own}. Correct the "
            "bench file, or restore the bench's private key. 'lostmotion key' shows its place"
        )


def _serial(options: Options, job: Job) -> str:
    """Return the serial number; a real unit must have one, one on the virtual bench may go without."""
    if options.serial is not None:
        return options.serial
    if job.bench.bench.embedded or options.virtual_time:
        return UNNAMED
    raise StationError(
        "--serial is missing: scan the unit's label, or give --serial SN (only the embedded virtual bench needs none)"
    )


def _unit(options: Options, job: Job) -> VirtualUnit | None:
    """Return the unit on the virtual bench; None on a real one."""
    if not (options.virtual_time or job.bench.bench.embedded):
        if options.unit is not None or options.scenario is not None or options.seed is not None:
            raise StationError(
                f"--unit, --seed and --scenario are for the virtual bench; {job.bench_source.path} is a real one. "
                "Leave these options out, or add --virtual-time",
            )
        return None
    from station.bench.assemble_virtual import choose_unit  # noqa: PLC0415 - brings the virtual bench, which a real one does not need

    return choose_unit(options.unit, job.recipe, options.seed)


def _faults_and_clock(options: Options, job: Job) -> tuple[Source | None, Pacing]:
    """Return the scenario, if any, and the clock of the run; RecipeError for faults that this clock cannot have."""
    if options.scenario is None:
        return None, _pacing(options, job)
    from station.bench.assemble_virtual import check_clock, parse_scenario, vocabulary_on  # noqa: PLC0415 - brings the virtual bench

    source = Source.read(options.scenario)
    scenario = parse_scenario(source.content, str(source.path), vocabulary_on(job.bench, job.profile_sources))
    pacing = _pacing(options, job, scenario)
    check_clock(source.path, scenario, pacing.clock)
    return source, pacing


def _pacing(options: Options, job: Job, scenario: Scenario | None = None) -> Pacing:
    """Return the clock of the run; StationError for options that speak of another one."""
    if options.virtual_time:
        if options.wall_clock or options.fast:
            raise StationError("--virtual-time does not allow --wall-clock or --pace. Leave them out")
        return Pacing(VIRTUAL)
    pacing = pacing_of(job, scenario, wall_clock=options.wall_clock, fast=options.fast)
    if options.fast and pacing.clock != SCAN:
        raise StationError("--pace fast is only for a virtual bench that waits for the scan. Leave it out")
    return pacing


def _conclude(  # noqa: PLR0917 - a run with everything that belongs to it
    pacing: Pacing,
    job: Job,
    record: RunRecord,
    unit: VirtualUnit | None,
    progress: Progress,
    ahead: Mapping[str, Ahead] | None,
) -> Conclusion:
    scenario = record.folder / "scenario.yaml" if record.has("scenario.yaml") else None
    if pacing.clock == VIRTUAL and unit is not None:
        from station.run.virtual_run import run_in_virtual_time  # noqa: PLC0415 - brings the virtual bench

        outcome = run_in_virtual_time(job, record, unit, scenario, progress.show)
    else:
        from station.run.supervisor import Supervisor  # noqa: PLC0415 - not needed in virtual time

        companion = None if scenario is None else _companion(scenario, job)
        try:
            outcome = Supervisor(
                job, record, progress.show, progress.say, companion, pacing=pacing, meanwhile=load_ahead, ahead=ahead
            ).run(unit, scenario)
        except BenchFaultError as error:
            record.samples.touch()
            outcome = RunOutcome.refused_by(record, error)
            outcome.keep(record)
    progress.say("evaluating, reading the record back")
    return conclude(record, job, outcome)


def _companion(scenario: Path, job: Job) -> Companion:
    from station.bench.assemble_virtual import load_scenario, vocabulary_on  # noqa: PLC0415 - brings the virtual bench
    from station.run.faults.companion import Companion  # noqa: PLC0415 - for runs with faults only

    return Companion(load_scenario(scenario, vocabulary_on(job.bench, job.profile_sources)), judged=False)
