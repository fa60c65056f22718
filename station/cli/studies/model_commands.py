"""Commands on the reducer as a model, for robot simulators."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import (
    DEFAULT_DATA,
    DataOption,
    JsonOption,
    TraceArgument,
)


def model(
    trace: TraceArgument,
    kind: Annotated[
        str,
        typer.Option(
            "--kind", metavar="NAME", help="Model to fit: cubic, dahl, bouc-wen, maxwell-slip, or all to compare."
        ),
    ] = "all",
    fix: Annotated[
        list[str] | None,
        typer.Option(
            "--fix", metavar="NAME=VALUE", help="Known value of a parameter, which is then not fitted; may be repeated."
        ),
    ] = None,
    recipe: Annotated[
        str | None,
        typer.Option("--recipe", metavar="RECIPE", help="Recipe to evaluate a file. A stored run uses its own recipe."),
    ] = None,
    bench: Annotated[
        str | None,
        typer.Option("--bench", metavar="FILE", help="Bench on which the file was recorded, for its fixture."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the parameters as JSON, for a simulator.")
    ] = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Identify a model of the reducer from its loop, with uncertainties, for a robot simulator."""
    from station.cli.studies.model import Asked
    from station.cli.studies.model import model as identify

    raise typer.Exit(identify(Asked(trace, kind, fix or [], recipe, bench, data, out), as_json=as_json))


def play_model(
    file: Annotated[Path, typer.Argument(metavar="MODEL", help="Model file that 'lostmotion model --out' wrote.")],
    angles: Annotated[Path, typer.Argument(metavar="ANGLES", help="CSV file with a column angle_arcmin.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="CSV file to write. Default: print on the screen.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Play an exported model: wind-ups in, torques out, as a simulator would."""
    from station.cli.studies import play_model as command_play_model

    raise typer.Exit(command_play_model.play_model(file, angles, out, as_json=as_json))
