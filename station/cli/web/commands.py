"""`lostmotion serve` and `lostmotion audit` on the command line."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from station.cli.options import DEFAULT_DATA, DataOption, JsonOption
from station.counted import counted
from station.documents.entries import plain
from station.own_program import loading

if TYPE_CHECKING:
    from station.web.people.database import StationDatabase

audit_app = typer.Typer(help="Audit trail: who did what at the station.", no_args_is_help=True)


def serve(
    data: DataOption = DEFAULT_DATA,
    host: Annotated[
        str, typer.Option("--host", metavar="ADDRESS", help="IP address at which the station listens.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port of the station. 0: any free port.")
    ] = 8080,
    models: Annotated[
        Path | None,
        typer.Option(
            "--models",
            metavar="FILE",
            help="File that names the recipe of each model. Default: models.yaml in the data folder.",
        ),
    ] = None,
    certificate: Annotated[
        Path | None, typer.Option("--certificate", metavar="FILE", help="File of the TLS certificate.")
    ] = None,
    key: Annotated[
        Path | None, typer.Option("--key", metavar="FILE", help="File of the private key of the certificate.")
    ] = None,
    names: Annotated[
        list[str] | None,
        typer.Option(
            "--name", metavar="NAME", help="Another host name of this station, as in the certificate; repeatable."
        ),
    ] = None,
    fast: Annotated[
        bool, typer.Option("--fast", help="On a virtual bench: run as fast as possible, for trying things out.")
    ] = False,
    install_unit: Annotated[
        Path | None,
        typer.Option(
            "--install-unit", metavar="DIR", help="Write systemd units for these options into DIR, and do not serve."
        ),
    ] = None,
) -> None:
    """Serve the station: the operator's page and the REST interface. Runs go on without it."""
    if install_unit is not None:
        from station.cli.web.units import install_units

        given: list[tuple[str, Path | None]] = [("--models", models), ("--certificate", certificate), ("--key", key)]
        words = ["--host", host, "--port", str(port)]
        words += [word for name, file in given if file is not None for word in (name, str(file.resolve()))]
        words += [word for name in names or () for word in ("--name", name)] + (["--fast"] if fast else [])
        scheme, shown = ("http" if certificate is None else "https"), (names or [host])[0]
        raise typer.Exit(install_units(install_unit, data, words, f"{scheme}://{shown}:{port}/"))
    with loading():
        from station.web.server import Served, serve

    options = ("--pace", "fast") if fast else ()
    serve(Served(data, host, port, models, certificate, key, tuple(names or ()), options))


@audit_app.command("verify")
def audit_verify(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """Check that no line of the audit trail was changed, removed or added. Exit code: 0 unchanged, 1 not."""
    from station.web.people import audit

    database = _database_of(data)
    with database.reading() as connection:
        head, problems = audit.head_of(connection), audit.problems_of(connection)
    database.close()
    if as_json:
        found = {**head._asdict(), "problems": problems}
        sys.stdout.write(json.dumps(found) + "\n")
    else:
        lines = [
            *problems,
            f"{counted(head.lines, 'line')}, head {head.head_sha256}: {'CHANGED' if problems else 'unchanged'}",
        ]
        sys.stdout.write("\n".join(lines) + "\n")
    raise typer.Exit(1 if problems else 0)


@audit_app.command("shift")
def audit_shift(
    since: Annotated[
        str,
        typer.Option("--since", metavar="DATE", help="Start of the shift, such as 2026-01-31T06:00, in local time."),
    ],
    until: Annotated[
        str | None,
        typer.Option("--until", metavar="DATE", help="End of the shift, written as for --since. Default: now."),
    ] = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Report a shift: runs, first-pass and final yield, bypasses, refused starts, and the head of the audit trail."""
    from station.cli.runs.run_table import moment_of
    from station.errors import StationError
    from station.store.run_table import run_table
    from station.store.stored_runs import Wanted
    from station.store.view import look_at
    from station.wall_clock import now_text
    from station.web.shift_report import alarms_of, shift_of

    begin, end = moment_of(since), now_text() if until is None else moment_of(until, "--until")
    if begin >= end:
        ends = "now" if until is None else f"at {until!r} (--until)"
        raise StationError(f"--since: found {since!r}, and the shift ends {ends}; allowed is a moment before its end")
    database = _database_of(data)
    with look_at(data) as view:
        rows = run_table(view, Wanted(since=begin))
    with database.reading() as connection:
        found = shift_of(rows, alarms_of(data, rows, end), connection, begin, end)
    database.close()
    sys.stdout.write(json.dumps(plain(found), ensure_ascii=False) + "\n" if as_json else found.as_text())


def _database_of(data: Path) -> StationDatabase:
    from station.errors import StationError
    from station.web.people.database import FILE, StationDatabase

    if not (data / FILE).is_file():
        raise StationError(
            f"folder {data} has no {FILE}, so no station was served from it. Name another folder with --data"
        )
    return StationDatabase(data)
