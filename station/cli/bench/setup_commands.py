"""`lostmotion profile ...` on the command line: what a bench of other devices is described by."""

# ruff: noqa: PLC0415, FBT002 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import JsonOption

profile_app = typer.Typer(help="Draft device profiles.", no_args_is_help=True)


@profile_app.callback()
def _profile() -> None:
    """Draft device profiles."""


@profile_app.command("from-eds")
def profile_from_eds(
    place: Annotated[
        Path, typer.Argument(metavar="FILE|FOLDER", help="EDS or DCF file of a drive, or a folder of them.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Write NAME.yaml there. Default: print it.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Draft a drive profile from the maker's EDS or DCF file, and list what the drive lacks.

    Exit code: 0; 1 when a drive cannot be used or a file of a folder cannot be read; 2 bad input.
    """
    from station.cli.bench import profile as command_profile

    raise typer.Exit(command_profile.from_eds(place, out, as_json=as_json))
