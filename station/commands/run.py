"""`lostmotion run`: the main job, from a recipe to a verdict on disk."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station.bench.request import Job, Source, load_job
from station.commands.show import stored_result
from station.errors import BenchFaultError, RecordError, StationError
from station.log import open_log
from station.record.run_record import RunRecord
from station.record.store import Store, check_operator, check_serial
from station.reports.result_view import result_console, show_report, show_result
from station.run.conclusion import Conclusion, conclude
from station.run.disk_space import refuse_full_disk
from station.run.ending import DESK_REPORT, Ending
from station.run.new_record import Wanted, new_record
from station.run.progress import Progress, progress_of
from station.wall_clock import now_text

if TYPE_CHECKING:
    from station.reports.illustrate import Shown
    from station.run.fault_companion import Companion

EXIT_CODES = {"PASS": 0, "FAIL": 1, "NOT DECIDABLE": 3}
EXIT_BENCH = 4
UNNAMED = "unnamed"


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
    report: bool = True
    """Whether report and pictures are made when the result is on the screen; they can be made at any time."""


def exit_code(result: dict[str, Any]) -> int:
    """Return the exit code of a result: 4 for a run that did not come to its end, else by its verdict."""
    if result["state"] not in ("complete", "analyzed"):
        return EXIT_BENCH
    return EXIT_CODES[result["verdict"]]


def run(options: Options) -> int:
    """Run a recipe; return the exit code.

    Raises:
        StationError, RecipeError, VirtualBenchError: bad input, before anything has moved.

    """
    if options.serial is not None:
        check_serial(options.serial)
    operator = None if options.operator is None else check_operator(options.operator)
    options = dataclasses.replace(options, operator=operator)
    job = load_job(options.recipe, options.bench)
    unit = _unit(options, job)
    scenario = _scenario(options)
    serial = _serial(options, job)
    refuse_full_disk(options.data, job)
    notes = recipe_notes(Store(options.data), job)
    record = new_record(
        options.data, job, Wanted(serial, unit, scenario, options.operator, options.virtual_time), notes=notes
    )
    for note in notes:
        sys.stderr.write(f"WARNING  {note}\n")
    with contextlib.closing(record.lock), open_log(record.folder / "log.jsonl") as log:
        log.info("run started", run=record.id, serial=serial, recipe=job.recipe.recipe.name, unit=unit)
        try:
            with progress_of(job, serial, as_json=options.json) as progress:
                progress.say(f"{progress.title}: {record.id}")
                if options.virtual_time and not job.bench.bench.embedded:
                    progress.say(
                        f"virtual time: bench {job.bench.bench.name} is simulated, its devices are not touched"
                    )
                conclusion = _conclude(options, job, record, unit, progress)
        except BaseException as error:
            with contextlib.suppress(OSError, RecordError):
                log.exception("run failed", kind=type(error).__name__)
                # A run that waits for its disk stays as it is, and so does one that has ended and was not concluded:
                # whoever looks at it then, completes and concludes it.
                waits = isinstance(error, RecordError)
                waits |= record.has(DESK_REPORT) and isinstance(error, OSError | KeyboardInterrupt)
                if not waits and record.manifest()["state"] == "recording":
                    record.update(state="interrupted", ended=now_text(), ring=None, trouble=str(error))
            if isinstance(error, RecordError):
                return no_record(record, error, as_json=options.json)
            raise
        shown = partial(_shown, job, conclusion) if options.report else None
        return finish(record, conclusion.result, shown, log, as_json=options.json)


def finish(
    record: RunRecord, result: dict[str, Any], shown: Callable[[], Shown] | None, log: Any, *, as_json: bool
) -> int:
    """Tell the result of a run that was just concluded, write its report where `shown` is given; return the exit code.

    The operator waits for the result, nobody for the report: that is made when the result is on the screen.
    """
    log.info("run ended", state=result["state"], verdict=result["verdict"], reasons=result["reasons"])
    print_result(result, as_json=as_json)
    if shown is not None:
        _report(record, shown, log, as_json=as_json)
    return exit_code(result)


def print_result(result: dict[str, Any], *, as_json: bool) -> None:
    """Print a result for a person or for a program."""
    if as_json:
        sys.stdout.write(json.dumps(result, ensure_ascii=False) + "\n")
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
    if record.has(DESK_REPORT):
        text += f". The run itself is stored: when the disk is in order, 'lostmotion show {record.id}' concludes it"
    sys.stderr.write(f"{text}\n")
    if as_json:
        try:
            stored = stored_result(record)
        except (OSError, StationError):  # a disk that takes nothing may give nothing back either
            stored = {"run": record.id, "record": str(record.folder)}
        result = stored | {"state": "interrupted", "verdict": "NOT DECIDABLE", "reasons": [text]}
        sys.stdout.write(json.dumps(result, ensure_ascii=False) + "\n")
    return EXIT_BENCH


def recipe_notes(store: Store, job: Job) -> list[str]:
    """Return what is to be noted of a recipe: unusual limits, and that its name has meant something else before."""
    recipe, sha256 = job.recipe.recipe, job.recipe_source.sha256
    before = store.another_recipe(recipe.name, recipe.revision, sha256)
    if before is None:
        return job.warnings
    note = (
        f"recipe {recipe.name} revision {recipe.revision} ({sha256[:8]}) is not the one of that name and revision that "
        f"run {before['id']} used ({before['recipe']['sha256'][:8]}): their verdicts cannot be compared. "
        "Raise the revision when a recipe is changed"
    )
    return [note, *job.warnings]


def _serial(options: Options, job: Job) -> str:
    """Return the serial number; a real unit must have one, one on the virtual bench may go without."""
    if options.serial is not None:
        return options.serial
    if job.bench.bench.embedded or options.virtual_time:
        return UNNAMED
    raise StationError(f"--serial is missing: scan the unit's label (bench {job.bench.bench.name} is a real one)")


def _unit(options: Options, job: Job) -> str | None:
    """Return the unit on the virtual bench; None on a real one."""
    if not (options.virtual_time or job.bench.bench.embedded):
        if options.unit is not None or options.scenario is not None:
            raise StationError(
                f"--unit and --scenario are for the virtual bench; {job.bench_source.path} is a real one. "
                "Leave them out, or add --virtual-time",
            )
        return None
    from station.bench.assemble_virtual import choose_unit  # noqa: PLC0415 - brings numba, which a real bench does not need

    return choose_unit(options.unit, job.recipe.unit_under_test.model)


def _scenario(options: Options) -> Source | None:
    if options.scenario is None:
        return None
    from station.bench.assemble_virtual import check_clock, parse_scenario  # noqa: PLC0415 - as above

    source = Source.read(options.scenario)
    scenario = parse_scenario(source.content, str(source.path))
    check_clock(source.path, scenario, wires=not options.virtual_time)
    return source


def _conclude(
    options: Options,
    job: Job,
    record: RunRecord,
    unit: str | None,
    progress: Progress,
) -> Conclusion:
    scenario = record.folder / "scenario.yaml" if record.has("scenario.yaml") else None
    if options.virtual_time and unit is not None:
        from station.run.virtual_run import run_in_virtual_time  # noqa: PLC0415 - brings numba

        ending = run_in_virtual_time(job, record, unit, scenario, progress.show)
    else:
        from station.run.desk import Desk  # noqa: PLC0415 - not needed in virtual time

        companion = None if scenario is None else _companion(scenario)
        try:
            ending = Desk(job, record, progress.show, progress.say, companion).run(unit, scenario)
        except BenchFaultError as error:
            record.samples.touch()
            ending = Ending.refused_by(record, error)
            ending.keep(record)
    progress.say("evaluating, reading the record back")
    return conclude(record, job, ending)


def _companion(scenario: Path) -> Companion:
    from station.bench.assemble_virtual import load_scenario  # noqa: PLC0415 - brings numba
    from station.run.fault_companion import Companion  # noqa: PLC0415 - for runs with faults only

    return Companion(load_scenario(scenario), judged=False)
