"""An OPC UA server in a process of its own, over runs that were sealed for it, and clients that are not its own."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from asyncua import Client, Node, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from station_support import PASSWORD, open_database
from stored_runs import metric, store_run

from station.opcua.certificates import Trust, made_certificate, make_certificate
from station.opcua.server import serve
from station.opcua.settings import load_opcua

PATIENCE_S = 60.0
"""Longest wait for what takes a moment on an idle computer."""

URI = "urn:lostmotion:test:client"
NODE_CLIENT = Path(__file__).parent / "opcua" / "node" / "client.mjs"
KEY = rsa.generate_private_key(public_exponent=65537, key_size=2048)

SETTINGS = """\
machine: {{manufacturer: Example GmbH, model: RV bench, serial_number: TB-1, location: Hall 3}}
endpoint: opc.tcp://127.0.0.1:{port}/
clients:
  - {{name: mes, user: the mes, from_first: true}}
  - {{name: node, user: the quality, from_first: true}}
"""


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def write_pair(folder: Path, name: str, key: rsa.RSAPrivateKey = KEY, days: int = 30) -> tuple[Path, Path]:
    """Write certificate and key of a client's application."""
    certificate, key_file = folder / f"{name}.pem", folder / f"{name}.key.pem"
    made = made_certificate(key, URI, ["localhost"], days, name)
    certificate.write_bytes(made.public_bytes(serialization.Encoding.PEM))
    kinds = serialization
    key_file.write_bytes(key.private_bytes(kinds.Encoding.PEM, kinds.PrivateFormat.PKCS8, kinds.NoEncryption()))
    return certificate, key_file


@dataclass
class Plant:
    """A data folder with its server, and the certificate of a client that it trusts."""

    data: Path
    port: int = field(default_factory=free_port)
    process: Any = None

    @property
    def url(self) -> str:
        return f"opc.tcp://127.0.0.1:{self.port}/"

    def set_up(self, settings: str = SETTINGS) -> None:
        """Write the settings, make the certificates and the accounts."""
        self.data.mkdir(parents=True, exist_ok=True)
        (self.data / "opcua.yaml").write_text(settings.format(port=self.port))
        open_database(self.data).close()
        make_certificate(self.data, load_opcua(self.data), ())
        certificate, _ = write_pair(self.data.parent, "client")
        Trust(self.data / "opcua" / "trusted").add(certificate)

    def seal(self, *serials: str, failed: str | None = None) -> list[str]:
        """Seal a run of each serial number; return their ids."""
        return [store_run(self.data, serial, [metric(0.5)], failed=failed).id for serial in serials]

    def start(self) -> None:
        """Start the server: a fork, which has all that it imports."""
        self.process = get_context("fork").Process(target=serve, args=(self.data,), daemon=True)
        self.process.start()
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            assert self.process.is_alive(), "the server ended"
            with socket.socket() as one:
                if one.connect_ex(("127.0.0.1", self.port)) == 0:
                    return
            time.sleep(0.05)
        raise AssertionError("the server does not listen")

    def kill(self, number: int = signal.SIGKILL) -> None:
        if self.process is not None:
            os.kill(self.process.pid, number)
            self.process.join()
            self.process = None

    def client(self, user: str | None = "the mes", password: str = PASSWORD) -> Client:
        client = Client(self.url, timeout=PATIENCE_S)
        client.application_uri = URI
        if user is not None:
            client.set_user(user)
            client.set_password(password)
        return client

    async def secure(self, client: Client, name: str = "client") -> None:
        """Give a client the certificate and the key of an application."""
        folder = self.data.parent
        await client.set_security(
            SecurityPolicyBasic256Sha256, str(folder / f"{name}.pem"), str(folder / f"{name}.key.pem"),
            server_certificate=str(self.data / "opcua" / "server.der"),
        )  # fmt: skip

    @asynccontextmanager
    async def session(self, user: str | None = "the mes", name: str = "client", **words: Any) -> AsyncIterator[Client]:
        """Log in over an encrypted channel."""
        client = self.client(user, **words)
        await self.secure(client, name)
        async with client:
            yield client

    def node(self, kept: Path, until: int, user: str = "the quality", *, quiet: bool = False) -> subprocess.Popen[str]:
        """Start node-opcua, which keeps and acknowledges results until there are so many different ones."""
        asked = {
            "url": self.url, "certificate": self.data.parent / "client.pem",
            "key": self.data.parent / "client.key.pem", "server": self.data / "opcua" / "server.der",
            "pki": self.data.parent / "pki", "user": user, "password": PASSWORD, "kept": kept, "until": until,
        }  # fmt: skip
        words = ["node", str(NODE_CLIENT), json.dumps(asked, default=str)]
        said = subprocess.DEVNULL if quiet else subprocess.PIPE
        return subprocess.Popen(words, stdout=said, stderr=said, text=True)


def kept_by(file: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


class Heard:
    """What a subscription of asyncua's client brings."""

    def __init__(self) -> None:
        self.runs: list[str] = []
        self.events: list[Any] = []

    def event_notification(self, event: Any) -> None:
        self.events.append(event)
        self.runs.append(event.Result.ResultMetaData.ResultId)

    async def wait_for(self, count: int) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while len(self.runs) < count:
            assert time.monotonic() < end_s, f"{len(self.runs)} of {count} came"
            await asyncio.sleep(0.02)


def of_ours(client: Client, name: str, ours: int = 5) -> Node:
    return client.get_node(ua.NodeId(name, ours))


async def listen(client: Client) -> Heard:
    """Wait for results as they come."""
    await know_types(client)
    heard = Heard()
    subscription = await client.create_subscription(50, heard)
    kind = of_ours(client, "LostmotionResultReadyEventType")
    await subscription.subscribe_events(of_ours(client, "Machine.ResultManagement"), kind)
    return heard


async def know_types(client: Client) -> None:
    """Learn the structures of the server, once in a process: it takes a second of processor time."""
    if not hasattr(ua, "ResultMetaDataType"):
        await client.load_data_type_definitions()


async def call(client: Client, name: str, *arguments: ua.Variant) -> Any:
    results = of_ours(client, "Machine.ResultManagement")
    return await results.call_method(ua.NodeId(f"Machine.ResultManagement.{name}", 5), *arguments)


async def acknowledge(client: Client, runs: list[str]) -> list[Any]:
    return await call(client, "AcknowledgeResults", ua.Variant(runs, ua.VariantType.String, is_array=True))


async def keep_results(plant: Plant, kept: Path, until: int, user: str = "the mes") -> None:
    """Do what the client of node-opcua does, by asyncua: keep each result, acknowledge it then, until all are there."""
    known = {one["id"] for one in kept_by(kept)}
    async with plant.session(user) as client:
        heard = await listen(client)
        taken = 0
        while len(known) < until:
            await heard.wait_for(taken + 1)
            (run,) = heard.runs[taken : taken + 1]
            taken += 1
            if run in known:
                _keep(kept.with_name(f"{kept.name}.again"), {"id": run})
            else:
                _, result, error = await call(
                    client, "GetResultById", ua.Variant(run), ua.Variant(0, ua.VariantType.Int32)
                )
                assert error == 0
                _keep(kept, {"id": run, "verdict": json.loads(result.ResultContent[0].Value)["verdict"]})
                known.add(run)
            assert (await acknowledge(client, [run]))[1] == 0


def _keep(file: Path, line: dict[str, Any]) -> None:
    with file.open("a") as opened:
        opened.write(json.dumps(line) + "\n")
