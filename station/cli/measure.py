"""Commands that move a bench, and the check of what it would do."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

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
    UnitOption,
)

NoReportOption = Annotated[bool, typer.Option("--no-report", help="Leave report and pictures to 'lostmotion report'.")]


def check(recipe: RecipeArgument, bench: BenchOption = None, as_json: JsonOption = False) -> None:
    """Check a recipe and show its load profile, duration and peak torque. Exit code: 0 in order, 2 not."""
    from station.commands import check as command_check

    raise typer.Exit(command_check.check(recipe, bench, as_json=as_json))


def run(
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
        typer.Option("--virtual-time", help="Against the plant in process, faster than real time."),
    ] = False,
    operator: Annotated[
        str | None, typer.Option("--operator", metavar="NAME", help="Who measures, for 'lostmotion gage'.")
    ] = None,
    no_report: NoReportOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run a recipe: measure a unit, judge it, store the record.

    Ctrl-C once brings the torque to zero and stops; twice is a quick stop.
    Exit code: 0 PASS, 1 FAIL, 2 bad input, 3 NOT DECIDABLE, 4 bench fault or stopped,
    70 the program failed.
    """
    from station.commands import run as command_run

    options = command_run.Options(
        recipe, serial, bench, data, unit, scenario, virtual_time, as_json, operator, report=not no_report
    )
    raise typer.Exit(command_run.run(options))


def resume(
    name: RunArgument,
    data: DataOption = DEFAULT_DATA,
    no_report: NoReportOption = False,
    as_json: JsonOption = False,
) -> None:
    """Take over a run whose desk died, to its end and its verdict. Exit code as run.

    Ctrl-C once brings the torque to zero and stops; twice is a quick stop.
    """
    from station.commands import resume as command_resume

    raise typer.Exit(command_resume.resume_run(name, data, as_json=as_json, report=not no_report))


def recover(
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask: what must be checked has been checked.")] = False,
    as_json: JsonOption = False,
) -> None:
    """The way back after a fault: show how the bench was left, acknowledge, bring the torque to zero, open the lock.

    Nothing is enabled before you say so. The bench is the one of the newest run, or the one that --bench names.
    Exit code: 0 the unit is unloaded and the lock open, 2 bad input, 4 not.
    """
    from station.commands import recover as command_recover

    raise typer.Exit(command_recover.recover(bench, data, yes=yes, as_json=as_json))
