"""`lostmotion profile ...` on the command line: what a bench of other devices is described by."""

# ruff: noqa: PLC0415, FBT002 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import JsonOption

profile_app = typer.Typer(help="Draft drive profiles, and compare a drive with its profile.", no_args_is_help=True)


@profile_app.command("from-eds")
def profile_from_eds(
    place: Annotated[
        Path, typer.Argument(metavar="FILE|FOLDER", help="EDS or DCF file of a drive, or a folder of them.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FOLDER", help="Folder to write each profile to, as NAME.yaml. Default: print it."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Draft a drive profile from the maker's EDS or DCF file, and list what the drive lacks.

    Exit code: 0; 1 when a drive cannot be used or a file of a folder cannot be read; 2 bad input.
    """
    from station.cli.bench import profile as command_profile

    raise typer.Exit(command_profile.from_eds(place, out, as_json=as_json))


@profile_app.command("compare")
def profile_compare(
    bench: Annotated[
        str, typer.Option("--bench", metavar="FILE", help="Bench file of the bench whose drive is compared.")
    ],
    as_json: JsonOption = False,
) -> None:
    """Read every object of the drive that a run checks or writes, and compare it with the profile. Nothing is written.

    Exit code: 0; 1 when a run would refuse this drive; 2 bad input; 4 bench fault.
    """
    from station.cli.bench import profile as command_profile

    raise typer.Exit(command_profile.compare(bench, as_json=as_json))


def schema(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="Kind of file: recipe, bench or profile.")],
) -> None:
    """Print the JSON Schema of recipe, bench or profile files, for editors. Exit code: 0, or 2 for another kind."""
    from recipes.schema.json_schema import KINDS_OF_FILE, json_schema
    from station.errors import StationError

    if kind not in KINDS_OF_FILE:
        raise StationError(f"KIND (kind of file): found '{kind}'; allowed: {', '.join(KINDS_OF_FILE)}")
    typer.echo(json.dumps(json_schema(kind), ensure_ascii=False, indent=1))
