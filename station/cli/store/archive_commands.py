"""`lostmotion archive ...` on the command line."""

# ruff: noqa: PLC0415, FBT002 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from typing import Annotated

import typer

from station.cli.options import DEFAULT_DATA, DataOption, JsonOption

archive_app = typer.Typer(
    help="Archive of concluded runs in a folder or an S3 bucket. Settings: archive.yaml in the data folder.",
    no_args_is_help=True,
)


@archive_app.command()
def push(
    new: Annotated[
        bool,
        typer.Option("--new-archive", help="archive.yaml names a new archive. Copy every run into it."),
    ] = False,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Copy every concluded run that is not in the archive into it. Exit code: 0, 1 some were left out, 2 bad input."""
    from station.cli.store import archive as command_archive

    raise typer.Exit(command_archive.push_runs(data, new=new, as_json=as_json))


@archive_app.command()
def status(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """Print how many runs are archived, waiting, or only in the archive. Of the archive only its id is read."""
    from station.cli.store import archive as command_archive

    raise typer.Exit(command_archive.status(data, as_json=as_json))


@archive_app.command()
def verify(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """Read the whole archive and compare every object with its hash. Exit code: 0 passed, 1 not, 2 bad input."""
    from station.cli.store import archive as command_archive

    raise typer.Exit(command_archive.verify(data, as_json=as_json))


@archive_app.command()
def fetch(
    name: Annotated[str, typer.Argument(metavar="RUN", help="Id of an archived run, or part of it.")],
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Copy the record of a run from the archive back into the data folder, and check that it is unchanged."""
    from station.cli.store import archive as command_archive

    raise typer.Exit(command_archive.fetch_run(data, name, as_json=as_json))


@archive_app.command()
def ask(
    sql: Annotated[
        str, typer.Argument(metavar="SQL", help="SELECT on the views runs, metrics, traces and files (DuckDB).")
    ],
    most: Annotated[int, typer.Option("--most", metavar="N", min=1, help="Largest number of rows.")] = 1000,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print the result as CSV.")] = False,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Query the archive in SQL, read-only."""
    from station.cli.store import archive as command_archive

    raise typer.Exit(command_archive.ask_archive(data, sql, most, as_csv=as_csv, as_json=as_json))
