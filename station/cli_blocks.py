"""Commands that print what a run measured of the bench itself, as blocks for the bench file."""

# ruff: noqa: PLC0415, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

DueOption = Annotated[
    str | None, typer.Option("--due", metavar="DATE", help="Day to repeat it. Default: a year after it was made.")
]
DataOption = Annotated[Path, typer.Option("--data", metavar="DIR", help="Folder that holds the runs.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else.")]
DEFAULT_DATA = Path("runs")


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
    run: Annotated[str, typer.Argument(metavar="RUN", help="Run id or part of it, serial number, folder, or 'last'.")],
    due: DueOption = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,  # noqa: FBT002
) -> None:
    """Print the torque ratio that a run measured as an entry of 'calibrations' in a bench file."""
    from station import command_blocks

    raise typer.Exit(command_blocks.calibration(run, data, due=due, as_json=as_json))
