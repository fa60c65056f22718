"""Commands on the store."""

# ruff: noqa: PLC0415, FBT002 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

import typer

from station.cli.options import DEFAULT_DATA, DataOption, JsonOption

store_app = typer.Typer(
    help="Database behind list, capability and other commands. The run folders remain the original data.",
    no_args_is_help=True,
)


@store_app.command()
def rebuild(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """Rebuild the store from the run folders. Exit code: 0, or 2 if the store cannot be used."""
    from station.cli.store import store as command_store

    raise typer.Exit(command_store.rebuild_store(data, as_json=as_json))


@store_app.command()
def state(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """Print the place of the store, its number of runs, and the runs that are missing. Exit code as rebuild."""
    from station.cli.store import store as command_store

    raise typer.Exit(command_store.store_state(data, as_json=as_json))
