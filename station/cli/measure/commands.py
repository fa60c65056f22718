"""Commands that move a bench, and the check of what it would do."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import (
    DEFAULT_DATA,
    BenchOption,
    DataOption,
    JsonOption,
    RecipeArgument,
    RunArgument,
    ScenarioOption,
    SeedOption,
    UnitOption,
    WallClockOption,
)


class Pace(Enum):
    """How fast scans follow each other on a bench that waits for them."""

    deadlines = "deadlines"
    fast = "fast"


ReportOption = Annotated[
    bool | None,
    typer.Option(
        "--report/--no-report",
        help="Make the report after the run, or leave it to 'lostmotion report'. Default: as the recipe says.",
        show_default=False,
    ),
]


def check(recipe: RecipeArgument, bench: BenchOption = None, as_json: JsonOption = False) -> None:
    """Check a recipe and show its load profile, duration and peak torque. Exit code: 0 valid, 2 not."""
    from station.cli.measure import check as command_check

    raise typer.Exit(command_check.check(recipe, bench, as_json=as_json))


def run(
    context: typer.Context,
    recipe: RecipeArgument,
    serial: Annotated[
        str | None,
        typer.Option("--serial", metavar="SN", help="Serial number of the unit. Required on a real bench."),
    ] = None,
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    unit: UnitOption = None,
    scenario: ScenarioOption = None,
    virtual_time: Annotated[
        bool,
        typer.Option("--virtual-time", help="Simulate the bench in this process, faster than real time."),
    ] = False,
    wall_clock: WallClockOption = False,
    pace: Annotated[
        Pace,
        typer.Option("--pace", help="On a virtual bench: run in real time, or as fast as possible."),
    ] = Pace.deadlines,
    seed: SeedOption = None,
    operator: Annotated[
        str | None, typer.Option("--operator", metavar="NAME", help="Name of the operator, for 'lostmotion gage'.")
    ] = None,
    retest_reason: Annotated[
        str | None, typer.Option("--retest-reason", metavar="TEXT", help="Why the unit is measured again.")
    ] = None,
    note: Annotated[
        list[str] | None, typer.Option("--note", metavar="TEXT", help="A note for record and report; repeatable.")
    ] = None,
    clock_is_right: Annotated[
        str | None,
        typer.Option(
            "--clock-is-right",
            metavar="REASON",
            help="Why the computer's clock is right, though the data folder has later entries. Needed once.",
        ),
    ] = None,
    study: Annotated[
        str | None,
        typer.Option(
            "--study",
            metavar="NAME",
            help="Measure the next step of this guided study. The run does not count as production.",
        ),
    ] = None,
    report: ReportOption = None,
    judged: Annotated[
        list[str] | None,
        typer.Option(
            "--judged", metavar="SHA256", help="Allow only a recipe or bench file with this SHA-256; repeatable."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Run a recipe: measure a unit, judge it, store the record.

    Ctrl-C once brings the torque to zero and stops; twice is a quick stop.
    Exit code: 0 PASS, 1 FAIL, 2 bad input, 3 NOT DECIDABLE, 4 bench fault or stopped,
    70 the program failed.
    """
    from station.cli.measure import run as command_run

    options = command_run.Options(
        recipe,
        serial,
        bench,
        data,
        unit,
        scenario,
        virtual_time,
        as_json,
        operator,
        seed,
        report=report,
        retest_reason=retest_reason,
        notes=tuple(note or ()),
        clock_is_right=clock_is_right,
        study=study,
        wall_clock=wall_clock,
        fast=pace is Pace.fast,
        judged=tuple(judged or ()),
    )
    ahead = context.find_object(dict)
    raise typer.Exit(command_run.run(options, ahead))


def line(
    data: DataOption = DEFAULT_DATA,
    models: Annotated[
        Path | None,
        typer.Option(
            "--models",
            metavar="FILE",
            help="File that names the recipe of each model. Default: models.yaml in the data folder.",
        ),
    ] = None,
    operator: Annotated[str | None, typer.Option("--operator", metavar="NAME", help="Name of the operator.")] = None,
    fast: Annotated[
        bool, typer.Option("--fast", help="On a virtual bench: run as fast as possible, for trying things out.")
    ] = False,
) -> None:
    """Scan, run, scan: measure unit after unit by the serial numbers that a scanner or a person types.

    The conditions of a start are those of 'serve'. Ends with its input, or by Ctrl-C between two runs.
    """
    from station.cli.measure import line as command_line

    raise typer.Exit(command_line.line(data, models, operator, ("--pace", "fast") if fast else ()))


def resume(
    name: RunArgument,
    data: DataOption = DEFAULT_DATA,
    report: ReportOption = None,
    as_json: JsonOption = False,
) -> None:
    """Take over a run whose supervisor died, to its end and its verdict. Exit code as run.

    Ctrl-C once brings the torque to zero and stops; twice is a quick stop.
    """
    from station.cli.measure import resume as command_resume

    raise typer.Exit(command_resume.resume_run(name, data, as_json=as_json, report=report))


def recover(
    bench: Annotated[
        str | None,
        typer.Option(
            "--bench", metavar="FILE", help="Bench file or shipped bench. Default: the bench of the newest run."
        ),
    ] = None,
    data: DataOption = DEFAULT_DATA,
    yes: Annotated[
        bool, typer.Option("--yes", help="Recover the bench without a question. Only after you have checked the bench.")
    ] = False,
    by_signal: Annotated[
        bool,
        typer.Option(
            "--by-signal",
            help="Answer by signals instead of a terminal: SIGUSR1 is yes, SIGINT leaves the bench as it is.",
        ),
    ] = False,
    operator: Annotated[
        str | None, typer.Option("--operator", metavar="NAME", help="Name of the person who recovers the bench.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Recover the bench after a fault: show its state, acknowledge, bring the torque to zero, open the lock.

    It asks before it enables anything. The bench is the one of the newest run, or the one that --bench names.
    Exit code: 0 the unit is unloaded and the lock open, 2 bad input, 4 not.
    """
    from station.cli.measure import recover as command_recover

    raise typer.Exit(
        command_recover.recover(bench, data, yes=yes, as_json=as_json, by_signal=by_signal, operator=operator)
    )


def jog(
    recipe: RecipeArgument,
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    speed: Annotated[
        float, typer.Option("--speed", metavar="SHARE", help="Speed as a share of the largest jog speed, up to 1.")
    ] = 1.0,
    unit: UnitOption = None,
    operator: Annotated[
        str | None, typer.Option("--operator", metavar="NAME", help="Name of the person who jogs.")
    ] = None,
    by_lines: Annotated[
        bool,
        typer.Option("--by-lines", help="Read the keys as lines of standard input, without a terminal."),
    ] = False,
) -> None:
    """Jog: turn the shaft slowly while a key is held and the enabling device is pressed.

    Hold + or - to turn, q ends it. The recipe says which unit is on the bench. Nothing is measured.
    On the virtual bench e presses the enabling device, r releases it.
    Exit code: 0 ended with the drive off, 2 bad input, 4 bench fault.
    """
    from station.cli.measure import jog as command_jog

    raise typer.Exit(command_jog.jog(recipe, bench, data, speed=speed, operator=operator, unit=unit, by_lines=by_lines))


def conclude(
    name: Annotated[
        str | None, typer.Argument(metavar="[RUN]", help="Run id or part of it, serial number, folder, or 'last'.")
    ] = None,
    all_runs: Annotated[bool, typer.Option("--all", help="Every run whose supervisor process ended early.")] = False,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Conclude a run whose supervisor process ended: save its samples, evaluate them, store result and verdict.

    Looking at runs never does that. A run that cannot be read now stays as it is: try again later.
    Exit code: 0 nothing is left to conclude, 1 a run could not be concluded, 2 bad input.
    """
    from station.cli.measure import conclude as command_conclude

    raise typer.Exit(command_conclude.conclude_runs(name, data, all_runs=all_runs, as_json=as_json))
