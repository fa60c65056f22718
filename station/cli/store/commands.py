"""Commands on the store, and on a data folder as a whole."""

# ruff: noqa: PLC0415, FBT002 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import DEFAULT_DATA, DataOption, JsonOption

store_app = typer.Typer(
    help="Database behind list, capability and other commands. The run folders remain the original data.",
    no_args_is_help=True,
)


retention_app = typer.Typer(
    help="Removal of old records by rules. A removed run keeps a signed entry and does not count as missing.",
    no_args_is_help=True,
)
RulesOption = Annotated[
    Path | None,
    typer.Option("--rules", metavar="FILE", help="File with the rules. Default: retention.yaml in the data folder."),
]


@retention_app.command("plan")
def retention_plan(rules: RulesOption = None, data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """Print the runs whose retention time is over, and why some of them would be kept. Nothing is removed."""
    from station.cli.store import retention as command_retention

    raise typer.Exit(command_retention.plan_retention(data, rules, as_json=as_json))


@retention_app.command("apply")
def retention_apply(
    operator: Annotated[
        str, typer.Option("--operator", metavar="NAME", help="Name of the person who removes the records.")
    ],
    backup: Annotated[
        Path | None,
        typer.Option("--backup", metavar="FILE", help="Backup that contains the runs to remove, if a rule needs one."),
    ] = None,
    rules: RulesOption = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Remove the runs whose retention time is over and that are in a backup, or in the archive.

    Exit code: 0 all removed, 1 some were kept, 2 bad input.
    """
    from station.cli.store import retention as command_retention

    raise typer.Exit(command_retention.apply_retention(data, rules, backup, operator, as_json=as_json))


@store_app.command()
def rebuild(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """Rebuild the store from the run folders. Exit code: 0, or 2 if the store cannot be used."""
    from station.cli.store import store as command_store

    raise typer.Exit(command_store.rebuild_store(data, as_json=as_json))


@store_app.command()
def state(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """Print place and number of runs of the store, and missing runs. Exit code: 0, or 2 if the store cannot be used."""
    from station.cli.store import store as command_store

    raise typer.Exit(command_store.store_state(data, as_json=as_json))


def backup(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Backup file to write, best on another disk.")],
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Write a data folder into one file: runs, chain, accounts and audit trail, each with its hash.

    Exit code: 0, 1 when the folder itself does not pass 'verify' or a run is not concluded, 2 when no backup was made.
    """
    from station.cli.store import backup as command_backup

    raise typer.Exit(command_backup.backup(file, data, as_json=as_json))


def restore(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Backup file to restore.")],
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Make a data folder of a backup, all of it or nothing, and check it as 'verify' does. Exit code as backup."""
    from station.cli.store import backup as command_backup

    raise typer.Exit(command_backup.restored(file, data, as_json=as_json))
