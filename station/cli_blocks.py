"""Commands that print what a run measured of the bench itself, as blocks for the bench file."""

# ruff: noqa: PLC0415, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from typing import Annotated

import typer

from station.cli_options import DEFAULT_DATA, DataOption, JsonOption, RunArgument

DueOption = Annotated[
    str | None, typer.Option("--due", metavar="DATE", help="Day to repeat it. Default: a year after it was made.")
]


def blank(
    trace: Annotated[str, typer.Argument(metavar="TRACE", help="Stored run, or a CSV or Parquet file.")],
    recipe: Annotated[
        str | None,
        typer.Option("--recipe", metavar="RECIPE", help="How the dummy was loaded. Default for a run: its own recipe."),
    ] = None,
    bench: Annotated[
        str | None, typer.Option("--bench", metavar="FILE", help="Bench that the trace comes from.")
    ] = None,
    name: Annotated[str | None, typer.Option("--id", metavar="ID", help="Name of the blank test.")] = None,
    due: DueOption = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,  # noqa: FBT002
) -> None:
    """Print a bench file's block 'fixture' from a loop on a rigid dummy: the fixture's deflection over torque."""
    from station import command_blocks

    raise typer.Exit(command_blocks.blank(trace, recipe, bench, data, name=name, due=due, as_json=as_json))


def calibration(
    run: RunArgument,
    due: DueOption = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,  # noqa: FBT002
) -> None:
    """Print the torque ratio that a run measured as an entry of 'calibrations' in a bench file."""
    from station import command_blocks

    raise typer.Exit(command_blocks.calibration(run, data, due=due, as_json=as_json))
