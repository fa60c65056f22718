"""One controller at a time on a real bench: locks that the process holds which scans it, of its bus and its devices.

There is one for the CAN bus, one for each serial line, and one for each Modbus device on TCP, so two benches may share
a gateway, but no device. They are named by what is meant, however a bench file spells it.

The kernel lets go of them when that process ends, however it ends; the files stay and mean nothing. They stand in the
service's own place with mode 0600: elsewhere any local user could hold them, and keep the bench from measuring.
"""

from __future__ import annotations

import fcntl
import os
import re
import socket
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from threading import Thread
from typing import Protocol

from drivers.config import CanConfig
from station.errors import StationError
from station.own_place import own_folder

FOLDER = "benches"
FILE_PREFIX = "lostmotion-bench-"

LONGEST_LOOKUP_S = 2.0
"""Longest wait for the address of a host; one that is not known by then is named as it is written."""


class BenchBusyError(StationError):
    """Another process controls this bench."""


class OnModbus(Protocol):
    """A Modbus device, as a bench file or the configuration of the drivers has it."""

    @property
    def transport(self) -> str:
        """`tcp`, or `rtu` on a serial line."""

    @property
    def host(self) -> str:
        """Its host, on TCP."""

    @property
    def port(self) -> int:
        """Its port, on TCP."""

    @property
    def serial_port(self) -> str:
        """The port of its line, on RTU."""

    @property
    def unit_id(self) -> int:
        """Its address on the line or behind the gateway."""

    @property
    def line(self) -> str:
        """The connection, as a person would look for it."""


def can_lock(can: CanConfig) -> Path:
    """Return the lock's file of a CAN bus: two bench files that describe one bus share it.

    Raises:
        StationError: the service's own place cannot be had; a lock anywhere else could be held by any local user.

    """
    if can.interface == "socketcand":
        return _file(f"{can.interface}-{can.channel}-{_address(can.host)}-{can.port}")
    if can.interface == "slcan":
        return _file(f"{can.interface}-{_real(can.serial_port)}")
    return _file(f"{can.interface}-{can.channel}")


def modbus_lock(device: OnModbus) -> Path:
    """Return the lock's file of a Modbus device: its gateway and its unit id, or on a serial line that line.

    A gateway asks for two benches in turn; a serial line has one master. Otherwise as `can_lock`.
    """
    if device.transport == "rtu":
        return _file(f"modbus-{_real(device.serial_port)}")
    return _file(f"modbus-{_address(device.host)}-{device.port}-{device.unit_id}")


def _file(name: str) -> Path:
    return own_folder(FOLDER) / (FILE_PREFIX + re.sub(r"[^A-Za-z0-9._-]", "_", name))


def _real(port: str) -> str:
    """Return the device behind a serial port's name, which may be a link of udev's; a URL of pyserial is none."""
    return port if "://" in port else os.path.realpath(port)


@cache
def _address(host: str) -> str:
    """Return the address of a host (blocking, bounded); the host itself where it is not known."""
    with suppress(OSError, UnicodeError):
        return _first_address(host, socket.AI_NUMERICHOST)
    found: list[str] = []

    def look_up() -> None:
        with suppress(OSError, UnicodeError):
            found.append(_first_address(host))

    # A name server that is silent cannot be given up. The thread ends with it, before the drivers are connected.
    looking = Thread(target=look_up, daemon=True)
    looking.start()
    looking.join(LONGEST_LOOKUP_S)
    return found[0] if found else host.lower()


def _first_address(host: str, flags: int = 0) -> str:
    """Return the first address in order, of the fourth version where there is one: name servers mix the others."""
    found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM, flags=flags)
    return str(min((family != socket.AF_INET, address[0]) for family, _, _, _, address in found)[1])


@contextmanager
def alone_on(bench: str, can: CanConfig, devices: Iterable[OnModbus] = ()) -> Iterator[None]:
    """Hold a bench, told by its name, for this process: its bus and its Modbus devices, or nothing of it.

    Nothing has been sent to it before. `devices`: those that are asked; none where only the bus is used.

    Raises:
        BenchBusyError: another process holds a part of it, or a lock cannot be had.

    """
    try:
        locks = {modbus_lock(device): f"Modbus {device.line} unit {device.unit_id}" for device in devices}
        locks[can_lock(can)] = can.where
    except StationError as error:
        raise BenchBusyError(f"the bench cannot be reserved for this program: {error}") from error
    with ExitStack() as held:
        for path, part in sorted(locks.items()):
            held.enter_context(_held(path, bench, part))
        yield


@contextmanager
def _held(path: Path, bench: str, part: str) -> Iterator[None]:
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise BenchBusyError(
            f"{path}: the lock file of the bench cannot be opened: {error.strerror}. Give this user write permission"
        ) from error
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.pread(handle, 32, 0).decode("ascii", "replace").strip()
            raise BenchBusyError(
                f"the bench '{bench}' ({part}) is in use by process {holder or 'unknown'}; nothing was sent to it. "
                "Wait for that run to end, or stop it"
            ) from error
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(handle)
