"""The OPC UA server of a data folder: a process of its own, which reads what runs leave and writes none of it."""

from __future__ import annotations

import asyncio
import errno
import fcntl
import logging
import os
import signal
import socket
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from asyncua import Server, ua

from station.errors import StationError
from station.heap import keep_heap_small
from station.opcua.access import Doorkeeper, Guest, ReadOnlyRules, StationServer, tell
from station.opcua.address_space import AddressSpace, built_in
from station.opcua.bench_view import BenchView
from station.opcua.certificates import Trust, checked_certificate
from station.opcua.courier import Courier
from station.opcua.methods import ResultMethods
from station.opcua.outbox import Outbox
from station.opcua.settings import FILE, OpcUaSettings, load_opcua
from station.version import version
from station.wall_clock import WALL_CLOCK
from station.web.people.database import StationDatabase

LOCK = "opcua.lock"
COLLECT_EVERY_S = 0.5
ACCOUNTS_EVERY_S = 5.0


def serve(data: Path) -> None:
    """Serve until the process is asked to end.

    Raises:
        StationError, RecipeError: the settings, the certificate, an account or the port cannot be used.

    """
    keep_heap_small()
    settings = load_opcua(data)
    _, uri = checked_certificate(data, settings)
    for name in ("asyncua", "asyncio"):  # what a person needs of a client that came or fell is told by `access`
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with _held(data):
        _refuse_taken(settings)
        database = StationDatabase(data)
        try:
            asyncio.run(_Service(data, settings, database, uri).run())
        finally:
            database.close()


def _refuse_taken(settings: OpcUaSettings) -> None:
    """Refuse an address on which nobody can listen before the nodes are made, which takes seconds."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            settings.host, settings.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        with socket.socket(family, kind, protocol) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
    except OSError as error:
        raise _cannot_listen(settings, error) from error


def _cannot_listen(settings: OpcUaSettings, error: OSError) -> StationError:
    """Return the error of an address that the computer did not give the server."""
    where = f"{FILE}: endpoint: {settings.endpoint}"
    if error.errno == errno.EADDRINUSE:
        return StationError(
            f"{where}: another program uses this port. Choose another port in opcua.yaml, or stop that program"
        )
    return StationError(
        f"{where}: the server cannot listen at this address: {error.strerror or error}. Correct endpoint in opcua.yaml"
    )


@contextmanager
def _held(data: Path) -> Iterator[None]:
    """Hold the folder against another server of its own kind."""
    handle = os.open(data / LOCK, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(handle)
        raise StationError(f"{data}: another 'lostmotion opcua serve' serves this folder. Stop it first") from error
    try:
        yield
    finally:
        os.close(handle)


class _Service:
    """The server with what it does again and again."""

    def __init__(self, data: Path, settings: OpcUaSettings, database: StationDatabase, uri: str) -> None:
        self._data, self._settings, self._uri = data, settings, uri
        self._doorkeeper = Doorkeeper(data, settings, database)
        self._outbox = Outbox(database, data)
        self._outbox.set_up(settings.clients)
        self._end = asyncio.Event()
        self._told: dict[str, str] = {}
        self._courier: Courier
        self._server: StationServer

    async def run(self) -> None:
        """Serve until a signal comes."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self._end.set)
        trust = Trust(self._data / self._settings.trusted)
        self._server = StationServer(self._doorkeeper, trust, self._watch)
        server = Server(iserver=self._server)
        space = await self._prepared(server)
        self._courier = Courier(server, self._outbox)
        await self._courier.use(space)
        await ResultMethods(server, self._outbox, self._courier.wake).link(space)
        self._outbox.collect()
        try:
            await server.start()
        except OSError as error:  # somebody took the port while the nodes were made
            raise _cannot_listen(self._settings, error) from error
        try:
            print(f"opcua    {self._address(server)}  {self._uri}", flush=True)  # noqa: T201 - what a person needs
            await asyncio.gather(self._collect(), self._deliver(), self._show(space), self._watch_accounts())
        finally:
            await server.stop()

    def _watch(self, guest: Guest, subscription: int, items: list[tuple[int, ua.NodeId]]) -> None:
        self._courier.watch(guest, subscription, items)

    async def _prepared(self, server: Server) -> AddressSpace:
        settings = self._settings
        await server.init()
        await server.set_application_uri(self._uri)
        server.set_server_name(f"lostmotion {settings.machine.serial_number}")
        server.product_uri = "urn:lostmotion"
        await server.set_build_info(
            "urn:lostmotion", settings.machine.manufacturer, "lostmotion", version(), "", WALL_CLOCK.now()
        )
        server.application_type = ua.ApplicationType.Server
        server.set_endpoint(settings.endpoint)
        server.set_security_policy(
            [ua.SecurityPolicyType[f"{name}_SignAndEncrypt"] for name in settings.policies], ReadOnlyRules()
        )
        await server.load_certificate(self._data / settings.certificate)
        await server.load_private_key(self._data / settings.key)
        return await built_in(server, settings)

    def _address(self, server: Server) -> str:
        """Return the address with the port that was chosen."""
        listening = getattr(server.bserver, "_server", None)
        port = listening.sockets[0].getsockname()[1] if listening is not None else self._settings.port
        host = self._settings.host
        return f"opc.tcp://{f'[{host}]' if ':' in host else host}:{port}/"

    async def _collect(self) -> None:
        await self._again(COLLECT_EVERY_S, "results", self._collect_once)

    async def _collect_once(self) -> None:
        if await asyncio.to_thread(self._outbox.collect):
            self._courier.wake.set()

    async def _deliver(self) -> None:
        """Send what is due, at once where something new is due, and now and then for what is to be repeated."""
        while not self._end.is_set():
            with suppress(TimeoutError):
                await asyncio.wait_for(self._courier.wake.wait(), COLLECT_EVERY_S)
            self._courier.wake.clear()
            await self._guarded("events", self._courier.deliver)

    async def _show(self, space: AddressSpace) -> None:
        view = BenchView(self._data)

        async def look() -> None:
            seen = await asyncio.to_thread(view.look)
            await space.show_state(seen.states)
            await space.show_texts(seen.texts)
            await space.show_values(seen.values)

        await self._again(self._settings.values_every_s, "values", look)

    async def _watch_accounts(self) -> None:
        async def look() -> None:
            for session in self._server.sessions():
                user = session.user
                account = user.account if isinstance(user, Guest) else ""
                if account and await self._closed(account):
                    tell(f"account {account!r}: its session ends: the account was closed")
                    await session.close_session()

        await self._again(ACCOUNTS_EVERY_S, "accounts", look)

    async def _closed(self, account: str) -> bool:
        return await asyncio.to_thread(self._doorkeeper.closed, account)

    async def _again(self, every_s: float, what: str, do: Callable[[], Awaitable[None]]) -> None:
        while not self._end.is_set():
            await self._guarded(what, do)
            with suppress(TimeoutError):
                await asyncio.wait_for(self._end.wait(), every_s)

    async def _guarded(self, what: str, do: Callable[[], Awaitable[None]]) -> None:
        """Do something that a disk may hinder: it is tried again, and each new reason is told once."""
        try:
            await do()
            why = ""
        except (StationError, OSError, ValueError, KeyError) as error:
            why = f"{what}: {error}"  # nothing is lost: it is looked at again
        if why and why != self._told.get(what):
            tell(why)
        self._told[what] = why
