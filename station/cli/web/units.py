"""The station as a service of the computer: units of systemd for the server and for the screen at the bench.

A unit is made of the options that `serve` was given, so that what a technician has tried by hand is what starts with
the computer.
"""

from __future__ import annotations

import getpass
import sys
from collections.abc import Sequence
from pathlib import Path

from station.atomic_file import write_atomic
from station.errors import RecordError, StationError
from station.own_place import own_place
from station.own_program import own_module

SERVER, KIOSK, OPCUA = "lostmotion.service", "lostmotion-kiosk.service", "lostmotion-opcua.service"

HARDENING = """\
NoNewPrivileges=yes
ProtectSystem=strict
PrivateTmp=yes
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectHostname=yes
ProtectClock=yes
RestrictSUIDSGID=yes
RestrictNamespaces=yes
LockPersonality=yes
SystemCallArchitectures=native
CapabilityBoundingSet=
UMask=0027"""
"""What neither server has a use for; each unit adds what it alone has no use for."""

SERVER_UNIT = """\
[Unit]
Description=lostmotion station
After=network.target

[Service]
Type=exec
ExecStart={command}
User={user}
WorkingDirectory={data}
Environment=LOSTMOTION_STATE={state}
Restart=always
RestartSec=2
# A run is a process of its own: it goes on while the server is stopped, updated or started again.
KillMode=process
TimeoutStopSec=15
# Real time for the scan of a run.
LimitRTPRIO=95
LimitMEMLOCK=infinity
LimitNICE=-20
# What the station has no use for. Memory that is written and run stays allowed: the virtual bench compiles its physics.
{hardening}
ReadWritePaths={data} {state}
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_CAN AF_NETLINK
DevicePolicy=closed
DeviceAllow=char-ttyUSB rw
DeviceAllow=char-ttyACM rw
DeviceAllow=char-ttyS rw

[Install]
WantedBy=multi-user.target
"""

KIOSK_UNIT = """\
[Unit]
Description=lostmotion on the screen at the bench
After={server}
Wants={server}
Conflicts=getty@tty1.service

[Service]
Type=exec
User={user}
PAMName=login
TTYPath=/dev/tty1
StandardInput=tty
ExecStart=/usr/bin/cage -s -- /usr/bin/chromium --kiosk --no-first-run --noerrdialogs --disable-translate {url}
Restart=always
RestartSec=5

[Install]
WantedBy=multi-user.target
"""

OPCUA_UNIT = """\
[Unit]
Description=lostmotion by OPC UA
After=network.target

[Service]
Type=exec
ExecStart={command}
User={user}
WorkingDirectory={data}
Environment=LOSTMOTION_STATE={state}
Restart=always
RestartSec=5
TimeoutStopSec=15
# It only reads what runs leave: a run has the processor first.
Nice=5
{hardening}
ReadWritePaths={data}
PrivateDevices=yes
RestrictRealtime=yes
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6

[Install]
WantedBy=multi-user.target
"""


def install_units(folder: Path, data: Path, words: Sequence[str], url: str) -> int:
    """Write both units into a folder, and say what starts them; return 0.

    words: further options of `lostmotion serve`. url: the address that the screen opens.

    Raises:
        StationError: a path holds what a unit cannot name, or the folder cannot be written.

    """
    named = _named(data)
    server = SERVER_UNIT.format(command=_command("serve", "--data", named["data"], *words), **named)
    kiosk = KIOSK_UNIT.format(server=SERVER, url=_quoted(url), user=named["user"])
    _write(folder, {SERVER: server, KIOSK: kiosk})
    sys.stdout.write(
        f"written  {folder / SERVER}\n         {folder / KIOSK}\n"
        f"start    systemctl daemon-reload && systemctl enable --now {SERVER}\n"
        f"screen   systemctl enable --now {KIOSK}   (needs cage and chromium)\n"
    )
    return 0


def install_opcua_unit(folder: Path, data: Path) -> int:
    """Write the unit of the OPC UA server into a folder, and say what starts it; return 0. StationError as above."""
    named = _named(data)
    _write(folder, {OPCUA: OPCUA_UNIT.format(command=_command("opcua", "serve", "--data", named["data"]), **named)})
    sys.stdout.write(f"written  {folder / OPCUA}\nstart    systemctl daemon-reload && systemctl enable --now {OPCUA}\n")
    return 0


def _named(data: Path) -> dict[str, str]:
    """Return what units have: hardening, user, data folder and place of the bench's own files; both are made."""
    data, state = data.resolve(), own_place().resolve()
    data.mkdir(parents=True, exist_ok=True)
    state.mkdir(mode=0o700, parents=True, exist_ok=True)
    names = {"user": getpass.getuser(), "data": _plain(str(data)), "state": _plain(str(state))}
    return names | {"hardening": HARDENING}


def _command(*words: str) -> str:
    return " ".join(_quoted(word) for word in own_module("station", *words))


def _write(folder: Path, units: dict[str, str]) -> None:
    try:
        for name, text in units.items():
            write_atomic(folder / name, text.encode())
    except RecordError as error:
        raise StationError(f"--install-unit {folder}: the systemd units cannot be written: {error}") from error


def _plain(path: str) -> str:
    """Return a path that a unit can name without quotes."""
    if any(sign.isspace() or sign in "\"'\\%$" for sign in path):
        raise StationError(f"folder {path} contains spaces, quotes, % or $. Choose a folder without these characters")
    return path


def _quoted(word: str) -> str:
    """Return a word of a command line of a unit: systemd expands % and $, and divides at blanks."""
    if "\n" in word:
        raise StationError(f"{word!r}: contains a line break. Remove it: a systemd unit cannot contain one")
    escaped = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return f'"{escaped}"' if escaped != word or any(sign.isspace() for sign in word) or not word else word
