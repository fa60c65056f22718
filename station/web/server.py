"""The server of the station: the application put together, and served until it is asked to end."""

from __future__ import annotations

import gc
import socket
from dataclasses import dataclass
from pathlib import Path

import uvicorn
from nicegui import app as nicegui
from nicegui import ui
from starlette.types import ASGIApp

from station.errors import StationError
from station.heap import keep_heap_small
from station.store.engines import keep_connections
from station.web.aqdef.outbox import Writer
from station.web.aqdef.settings import load_aqdef
from station.web.evaluations import Evaluations
from station.web.guard import Guard
from station.web.labels.outbox import NOT_SET_UP, Printing, not_set_up
from station.web.labels.settings import load_labels
from station.web.mes.outbox import Sender
from station.web.mes.settings import load_mes
from station.web.models import ModelsFile, load_models
from station.web.pages.certificates import add_certificates
from station.web.pages.jog import add_jog
from station.web.pages.maintenance import add_maintenance
from station.web.pages.operator import add_pages
from station.web.pages.people import add_people
from station.web.pages.quality.page import add_quality_page
from station.web.pages.recipes.page import add_recipe_pages
from station.web.pages.results import add_results
from station.web.pages.run import add_run_page
from station.web.people import audit
from station.web.people.accounts import first_is_changed, first_password
from station.web.people.database import StationDatabase
from station.web.permission import likely_first
from station.web.rest.app import keeper_of, rest_of
from station.web.running import Running
from station.web.settings import load_settings
from station.web.station import Station

THE_SERVER = "lostmotion serve"
"""Name in the audit trail of what the server does by itself."""

LOOPBACK = ("127.0.0.1", "::1", "localhost")


@dataclass(frozen=True)
class Served:
    """How the station is served: where its runs are, its address, and TLS by a certificate and its key."""

    data: Path
    host: str
    port: int
    models: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    names: tuple[str, ...] = ()
    """Further names that lead to it, as those of its certificate."""
    run_options: tuple[str, ...] = ()


def open_station(served: Served, evaluations: Evaluations | None = None) -> tuple[Station, str | None]:
    """Open the station of a data folder; return it, and the first account's password where it was just made.

    evaluations: the process beside the server, where it was started before; the station closes it.

    Raises:
        StationError, RecipeError: the folder, the table of models or the address cannot be used.

    """
    if (served.certificate is None) != (served.key is None):
        raise StationError("--certificate and --key belong together. Name both, or none")
    models_file = ModelsFile(served.data, served.models)  # before it is read: a change while it is read is seen
    models, mes = load_models(served.data, served.models), load_mes(served.data)
    settings, labels, aqdef = load_settings(served.data), load_labels(served.data), load_aqdef(served.data)
    database = StationDatabase(served.data, serving=True)
    try:
        with database.writing() as connection:
            audit.tell_cut_off(connection)
            if labels is None and (runs := not_set_up(connection)):
                audit.write(connection, THE_SERVER, "set_label_aside", audit.DONE, {"runs": runs, "reason": NOT_SET_UP})
            password = first_password(connection)
            # within the transaction: the password of an account that was just made would be lost
            _refuse_unready(served, changed=first_is_changed(connection))
    except StationError:
        database.close()
        raise
    station = Station(
        served.data,
        database,
        models,
        Running(served.data),
        served.run_options,
        mes,
        settings,
        labels,
        aqdef,
        evaluations=evaluations or Evaluations(),
        models_file=models_file,
    )
    return station, password


def _refuse_unready(served: Served, *, changed: bool) -> None:
    """Refuse an address that other computers reach while the first password is not changed, or without TLS."""
    if served.host not in LOOPBACK and (not changed or served.certificate is None):
        raise StationError(
            f"--host {served.host}: other computers reach this address. Start on 127.0.0.1 first and change the first "
            "password; then name --certificate and --key too"
        )


def application(station: Station, served: Served, port: int) -> ASGIApp:
    """Return the whole application: pages and REST, behind the guard."""
    app = rest_of(station, secure=served.certificate is not None)
    add_pages(station)
    add_certificates(station)
    add_maintenance(station)
    add_jog(station)
    add_people(station)
    add_results(station)
    add_run_page(station)
    add_quality_page(station)
    station.evaluations.start(station.data)
    nicegui.on_shutdown(station.evaluations.close)
    nicegui.on_shutdown(station.trials.close)
    nicegui.on_startup(lambda: station.running.stay_ready(likely_first(station.data, station.models)))
    add_recipe_pages(station)
    # Tailwind would look for classes at every change of a page, in the browser: `style.css` has the rules instead.
    ui.run_with(app, title="lostmotion", language="en-US", tailwind=False, show_welcome_message=False)
    return Guard(app, hosts_of(served, port), keeper_of(station))


def hosts_of(served: Served, port: int) -> frozenset[str]:
    """Return what a browser may send as `Host`: this server's names, without the port where that is the usual one.

    They are its address, those that were given and, as the address says, loopback's or the computer's.
    """
    usual = 80 if served.certificate is None else 443
    computers = (socket.gethostname(), socket.getfqdn())
    names = {one.lower() for one in (served.host, *served.names, *(LOOPBACK if served.host in LOOPBACK else computers))}
    bracketed = {f"[{name}]" if ":" in name else name for name in names}
    return frozenset({f"{name}:{port}" for name in bracketed} | (bracketed if port == usual else set()))


def start_beside(data: Path) -> Evaluations:
    """Start the process that evaluates, where local time is that of the plant from here on, as it is there."""
    load_settings(data).use_time_zone()
    evaluations = Evaluations()
    evaluations.fork()
    return evaluations


def serve(served: Served) -> None:
    """Serve until the process is asked to end. A run that is on goes on without it.

    Raises:
        StationError, RecipeError: as `open_station`; the port is taken.

    """
    keep_heap_small()  # before the first thread: the process that evaluates is looked after by two
    evaluations = start_beside(served.data)  # before anything is opened: it would hold it too
    keep_connections()
    try:
        station, password = open_station(served, evaluations)
    except BaseException:
        evaluations.close()
        raise
    outboxes: list[Sender | Printing | Writer] = []
    try:
        if station.mes is not None:
            outboxes.append(Sender(station.database, station.data, station.mes))
        if station.labels is not None:
            outboxes.append(Printing(station.database, station.data, station.labels))
        if station.aqdef is not None:
            outboxes.append(Writer(station.database, station.data, station.aqdef))
        family = socket.AF_INET6 if ":" in served.host else socket.AF_INET
        with socket.socket(family, socket.SOCK_STREAM) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                listener.bind((served.host, served.port))
            except OSError as error:
                raise StationError(f"--port {served.port}: {error.strerror}. Choose another with --port") from error
            listener.listen(128)  # from here on a browser waits for the first answer, and is not refused
            port = listener.getsockname()[1]
            scheme = "http" if served.certificate is None else "https"
            print(f"station  {scheme}://{served.host}:{port}/", flush=True)  # noqa: T201 - what a person needs
            if password is not None:
                print(f"log in   admin, password {password} (choose your own at the first log-in)", flush=True)  # noqa: T201
            config = uvicorn.Config(
                application(station, served, port), log_level="warning", access_log=False,
                ssl_certfile=served.certificate, ssl_keyfile=served.key, server_header=False,
                timeout_graceful_shutdown=2,
            )  # fmt: skip
            for outbox in outboxes:
                outbox.start()
            # What is loaded by now stays for good: no later collection has to look through it.
            gc.freeze()
            uvicorn.Server(config).run(sockets=[listener])
    finally:
        for outbox in outboxes:
            outbox.close()
        station.close()
