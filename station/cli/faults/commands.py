"""`lostmotion faults ...` on the command line."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import JsonOption, SeedOption, UnitOption, WallClockOption, data_folder

FaultDataOption = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="DIR",
        parser=data_folder,
        help="Folder that keeps the records, for 'lostmotion show' and 'replay'.",
    ),
]

faults_app = typer.Typer(help="Inject faults into the virtual bench and check the reaction.", no_args_is_help=True)


@faults_app.command("list")
def faults_list(as_json: JsonOption = False) -> None:
    """List the faults that can be injected, each as a scenario names it: target, verb and value."""
    from station.cli.faults import faults as command_faults

    raise typer.Exit(command_faults.list_faults(as_json=as_json))


@faults_app.command("reactions")
def faults_reactions(as_json: JsonOption = False) -> None:
    """List the reactions to faults, with drive command, state of the controller and contacts of each."""
    from station.cli.faults import reactions as command_reactions

    raise typer.Exit(command_reactions.list_reactions(as_json=as_json))


@faults_app.command("run")
def faults_run(
    scenario: Annotated[
        Path,
        typer.Argument(
            metavar="SCENARIO", help="Scenario file: faults to inject, and the reactions that are expected."
        ),
    ],
    recipe: Annotated[
        str | None,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="Recipe to run. Default: the recipe that the scenario names, or a short one.",
        ),
    ] = None,
    unit: UnitOption = None,
    seed: SeedOption = None,
    wires: Annotated[
        bool,
        typer.Option("--wires", help="Use real CAN and Modbus connections, with the virtual bench in its own process."),
    ] = False,
    wall_clock: WallClockOption = False,
    bench: Annotated[
        str | None,
        typer.Option(
            "--bench",
            metavar="FILE",
            help="With --wires: a real bench, with a gateway on its wires that injects the faults.",
        ),
    ] = None,
    data: FaultDataOption = None,
    as_json: JsonOption = False,
) -> None:
    """Inject the faults of a scenario file, and check the reactions that it lists under 'expect' and 'never'.

    Exit code: 0 all met, 1 not met, 2 bad input.
    """
    from station.cli.faults import faults as command_faults

    how = command_faults.How(recipe, unit, wires, wall_clock, bench, data, seed)
    raise typer.Exit(command_faults.run(scenario, how, as_json=as_json))


@faults_app.command("gateway")
def faults_gateway(
    scenario: Annotated[
        Path, typer.Argument(metavar="SCENARIO", help="Scenario file with faults of CAN and Modbus messages.")
    ],
    bench: Annotated[str, typer.Option("--bench", metavar="FILE", help="Bench file of the real bench.")],
) -> None:
    """Inject faults between controller and real bench, by a gateway. Prints its ports, then runs until Ctrl-C."""
    from station.cli.faults import faults as command_faults

    raise typer.Exit(command_faults.gateway(bench, scenario))


@faults_app.command("exits")
def faults_exits(
    only: Annotated[
        list[str] | None, typer.Argument(metavar="[ID]...", help="Ids of the shutdown paths. Default: all.")
    ] = None,
    page: Annotated[
        Path | None, typer.Option("--page", metavar="FILE", help="Write the measured times to FILE, as Markdown.")
    ] = None,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Number of parallel processes.")] = 2,
    as_json: JsonOption = False,
) -> None:
    """Measure the time to zero torque for every shutdown path. Exit code: 0 within limits, 1 not."""
    from station.cli.faults import exits as command_exits

    raise typer.Exit(command_exits.exits(only or [], page, workers, as_json=as_json))


@faults_app.command("pairs")
def faults_pairs(
    seed: Annotated[
        int, typer.Option("--seed", min=0, help="Seed of the draw: the same seed gives the same pairs.")
    ] = 1,
    count: Annotated[int, typer.Option("--count", min=1, help="Number of pairs of faults to inject.")] = 100,
    first: Annotated[
        int, typer.Option("--first", min=0, help="Number of the first pair to inject; with --count 1, only this pair.")
    ] = 0,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Number of parallel processes.")] = 2,
    as_json: JsonOption = False,
) -> None:
    """Inject pairs of faults, chosen at random, in virtual time. Exit code: 0 nothing wrong, 1 something is."""
    from station.cli.faults import pairs as command_pairs

    raise typer.Exit(command_pairs.pairs(seed, range(first, first + count), workers, as_json=as_json))


@faults_app.command("matrix")
def faults_matrix(
    only: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Inject only faults whose name contains NAME.")
    ] = None,
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="Write an HTML page with the recorded curves.")
    ] = None,
    page: Annotated[
        Path | None,
        typer.Option("--page", metavar="FILE", help="Write the measured reaction times to FILE, as Markdown."),
    ] = None,
    workers: Annotated[
        int, typer.Option("--workers", min=1, help="Number of parallel processes. Not with --wires.")
    ] = 2,
    wires: Annotated[
        bool, typer.Option("--wires", help="Use real CAN and Modbus connections; each fault in one state only.")
    ] = False,
    wall_clock: WallClockOption = False,
    data: FaultDataOption = None,
    as_json: JsonOption = False,
) -> None:
    """Inject every fault in every state in which it can act, in virtual time. Exit code: 0 within limits, 1 not."""
    from station.cli.faults import faults as command_faults

    if wires:
        raise typer.Exit(command_faults.wires_matrix(only or [], data, page, as_json=as_json, wall_clock=wall_clock))
    raise typer.Exit(command_faults.matrix(only or [], html, page, workers, as_json=as_json))
