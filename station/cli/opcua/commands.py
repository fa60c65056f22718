"""`lostmotion opcua`: the server, its certificate, the clients that it trusts, and what they are owed."""

# ruff: noqa: PLC0415, FBT002 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from station.cli.options import DEFAULT_DATA, DataOption, JsonOption

if TYPE_CHECKING:
    from collections.abc import Iterator

    from station.opcua.outbox import Outbox

opcua_app = typer.Typer(help="Serve the bench to the systems of a plant by OPC UA.", no_args_is_help=True)


def _needs_asyncua() -> None:
    from importlib.util import find_spec

    from station.errors import StationError

    if find_spec("asyncua") is None:
        raise StationError("OPC UA needs the package asyncua. Install it with: pip install 'lostmotion[plant]'")


@opcua_app.command("serve")
def opcua_serve(
    data: DataOption = DEFAULT_DATA,
    install_unit: Annotated[
        Path | None,
        typer.Option(
            "--install-unit", metavar="DIR", help="Write a systemd unit for this folder into DIR, and do not serve."
        ),
    ] = None,
) -> None:
    """Serve states, live values and results by OPC UA, as opcua.yaml in the data folder says. Runs go on without it."""
    _needs_asyncua()
    if install_unit is not None:
        from station.cli.web.units import install_opcua_unit

        raise typer.Exit(install_opcua_unit(install_unit, data))
    from station.opcua.server import serve

    serve(data)


@opcua_app.command("certificate")
def opcua_certificate(
    data: DataOption = DEFAULT_DATA,
    names: Annotated[
        list[str] | None,
        typer.Option("--name", metavar="NAME", help="Another host name or address of this computer; repeatable."),
    ] = None,
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace the certificate. All clients then have to trust the new one.")
    ] = False,
) -> None:
    """Make the key and the certificate by which clients know this server."""
    from station.opcua.certificates import checked_certificate, fingerprint, make_certificate
    from station.opcua.settings import load_opcua

    settings = load_opcua(data)
    file = make_certificate(data, settings, names or (), replace=replace)
    made, uri = checked_certificate(data, settings)
    sys.stdout.write(
        f"written  {file}\n"
        f"for      {uri}\n"
        f"until    {made.not_valid_after_utc:%Y-%m-%d}\n"
        f"SHA-256  {fingerprint(made)}\n"
        f"next     trust clients: lostmotion opcua trust FILE\n"
    )


@opcua_app.command("trust")
def opcua_trust(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Certificate of the client's application, DER or PEM.")],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Trust the certificate of a client's application; a running server accepts it at once."""
    from station.opcua.certificates import Trust, fingerprint
    from station.opcua.settings import load_opcua

    kept, certificate = Trust(data / load_opcua(data).trusted).add(file)
    sys.stdout.write(
        f"trusted  {certificate.subject.rfc4514_string()}\n"
        f"SHA-256  {fingerprint(certificate)}\n"
        f"until    {certificate.not_valid_after_utc:%Y-%m-%d}\n"
        f"kept     {kept}   (to end the trust, remove this file)\n"
    )


@opcua_app.command("clients")
def opcua_clients(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """List the clients that receive results: how many results wait for each, and the time of its last contact."""
    with _outbox(data) as outbox:
        rows = outbox.clients()
        if as_json:
            sys.stdout.write(json.dumps([row._asdict() for row in rows]) + "\n")
        else:
            lines = [
                f"{row.name:24} {row.waiting:6} waiting  {row.acknowledged:8} acknowledged  last {row.heard or 'never'}"
                for row in rows
            ]
            sys.stdout.write("\n".join(lines or ["no clients: name them under clients in opcua.yaml"]) + "\n")


@opcua_app.command("forget")
def opcua_forget(
    name: Annotated[str, typer.Argument(metavar="CLIENT", help="Name of the client in opcua.yaml.")],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Delete the results that wait for a client that opcua.yaml no longer lists."""
    with _outbox(data) as outbox:
        sys.stdout.write(f"forgotten  {name}, with {outbox.forget(name)} results that it was owed\n")


@contextmanager
def _outbox(data: Path) -> Iterator[Outbox]:
    """Yield the outbox of a data folder, and close its database behind."""
    from station.errors import StationError
    from station.opcua.outbox import Outbox
    from station.web.people.database import FILE, StationDatabase

    if not (data / FILE).is_file():
        raise StationError(
            f"folder {data} has no {FILE}: no server ran with this folder. Name another folder with --data"
        )
    database = StationDatabase(data)
    try:
        yield Outbox(database, data)
    finally:
        database.close()
