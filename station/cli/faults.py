"""`lostmotion faults ...` on the command line."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import JsonOption, UnitOption

FaultDataOption = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="Keep the records there; 'lostmotion show' and 'replay' read them."),
]

faults_app = typer.Typer(help="Break the virtual bench on purpose, and judge what comes of it.", no_args_is_help=True)


@faults_app.command("list")
def faults_list(as_json: JsonOption = False) -> None:
    """List what can be injected: target, verb, value."""
    from station.commands import faults as command_faults

    raise typer.Exit(command_faults.list_faults(as_json=as_json))


@faults_app.command("run")
def faults_run(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO", help="Scenario file.")],
    recipe: Annotated[
        str | None, typer.Option("--recipe", metavar="RECIPE", help="Recipe. Default: the scenario's, or a short one.")
    ] = None,
    unit: UnitOption = None,
    wires: Annotated[
        bool, typer.Option("--wires", help="In real time over CAN and Modbus, the virtual bench in its own process.")
    ] = False,
    bench: Annotated[
        str | None,
        typer.Option("--bench", metavar="FILE", help="With --wires: a real bench, faults by a gateway on its wires."),
    ] = None,
    data: FaultDataOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run a scenario and judge its expect and never clauses. Exit code: 0 holds, 1 not, 2 bad input."""
    from station.commands import faults as command_faults

    how = command_faults.How(recipe, unit, wires, bench, data)
    raise typer.Exit(command_faults.run(scenario, how, as_json=as_json))


@faults_app.command("gateway")
def faults_gateway(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO", help="Scenario file: faults of can.… and modbus.…")],
    bench: Annotated[str, typer.Option("--bench", metavar="FILE", help="Bench file of the bench on the cable.")],
) -> None:
    """Stand on the wires of a real bench and inject faults there. Prints its ports, then runs until Ctrl-C."""
    from station.commands import faults as command_faults

    raise typer.Exit(command_faults.gateway(bench, scenario))


@faults_app.command("exits")
def faults_exits(
    only: Annotated[list[str] | None, typer.Argument(metavar="[ID]...", help="Exits by their id.")] = None,
    page: Annotated[Path | None, typer.Option("--page", metavar="FILE", help="Write the table as Markdown.")] = None,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Processes.")] = 2,
    as_json: JsonOption = False,
) -> None:
    """Measure how soon the torque is zero on every way in which a run can end. Exit code: 0 within bounds, 1 not."""
    from station.commands import exits as command_exits

    raise typer.Exit(command_exits.exits(only or [], page, workers, as_json=as_json))


@faults_app.command("matrix")
def faults_matrix(
    only: Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="Rows whose name holds NAME.")] = None,
    html: Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write a page with traces.")] = None,
    page: Annotated[Path | None, typer.Option("--page", metavar="FILE", help="Write the figures as Markdown.")] = None,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Processes, in virtual time.")] = 2,
    wires: Annotated[
        bool, typer.Option("--wires", help="In real time over CAN and Modbus, each fault in one state.")
    ] = False,
    data: FaultDataOption = None,
    as_json: JsonOption = False,
) -> None:
    """Inject every fault in every state in which it can act, in virtual time. Exit code: 0 within bounds, 1 not."""
    from station.commands import faults as command_faults

    if wires:
        raise typer.Exit(command_faults.wires_matrix(only or [], data, page, as_json=as_json))
    raise typer.Exit(command_faults.matrix(only or [], html, page, workers, as_json=as_json))
