"""The file `opcua.yaml`: what a site decides about its OPC UA server."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from recipes import load_document
from recipes.text.section import refusal
from station.errors import StationError

FILE = "opcua.yaml"
PORT = 4840
"""Port of OPC UA, as registered with IANA."""

EXAMPLE = """\
machine:
  manufacturer: Example GmbH
  model: RV test bench
  serial_number: TB-0001
"""

Text = Field(min_length=1, max_length=200)


class Machine(BaseModel):
    """The bench as OPC 40001-1 identifies it. `uri`: its ProductInstanceUri, without it made of the other three."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    manufacturer: str = Text
    model: str = Text
    serial_number: str = Text
    location: str | None = Field(default=None, min_length=1, max_length=200)
    uri: str | None = Field(default=None, min_length=1, max_length=500)


class Client(BaseModel):
    """A client whose results wait for it while it is away, known by its account or by the certificate of its user.

    `certificate`: a path beside the file, or a whole one. `from_first`: it is also owed the results that were there
    before it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1, max_length=64, pattern=r"[A-Za-z0-9._-]+")
    user: str | None = Field(default=None, min_length=1, max_length=64)
    certificate: str | None = Field(default=None, min_length=1)
    from_first: bool = False

    @model_validator(mode="after")
    def _is_known_by_one(self) -> Client:
        if (self.user is None) == (self.certificate is None):
            found = "neither of them" if self.user is None else "both of them"
            raise refusal(f"client {self.name} with {found}", "exactly one of user and certificate")
        return self


class OpcUaSettings(BaseModel):
    """The file.

    `endpoint`: address on which the server listens and which it offers. `policies`: of security, all of them sign and
    encrypt. `certificate`, `key`, `trusted`: files of the server, and folder of the certificates of the clients'
    applications; paths beside the file, or whole ones. `anonymous`: whether a trusted application may read without a
    user. `values_every_s`: between two looks at the bench.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    machine: Machine
    endpoint: str = f"opc.tcp://127.0.0.1:{PORT}/"
    policies: tuple[Literal["Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"], ...] = Field(
        default=("Basic256Sha256",), min_length=1
    )
    certificate: str = "opcua/server.der"
    key: str = "opcua/server.key.pem"
    trusted: str = "opcua/trusted"
    anonymous: bool = False
    values_every_s: float = Field(default=0.25, ge=0.1, le=10.0)
    clients: tuple[Client, ...] = ()

    @field_validator("endpoint")
    @classmethod
    def _is_address(cls, text: str) -> str:
        wanted = f"an address such as opc.tcp://127.0.0.1:{PORT}/"
        try:
            parts = urlsplit(text)
            port = parts.port
        except ValueError as error:
            raise refusal(text, wanted) from error
        if parts.scheme != "opc.tcp" or not parts.hostname or port is None or parts.username is not None:
            raise refusal(text, wanted)
        return text

    @model_validator(mode="after")
    def _has_clients_of_their_own(self) -> OpcUaSettings:
        for kind in ("name", "user", "certificate"):
            given = [value for client in self.clients if (value := getattr(client, kind)) is not None]
            twice = sorted({value for value in given if given.count(value) > 1})
            if twice:
                raise refusal(f"two clients with the {kind} {twice[0]}", f"a different {kind} for each client")
        return self

    @property
    def host(self) -> str:
        """Host of the endpoint."""
        return str(urlsplit(self.endpoint).hostname)

    @property
    def port(self) -> int:
        """Port of the endpoint; 0: a free one."""
        return int(urlsplit(self.endpoint).port or 0)

    @property
    def every_address(self) -> bool:
        """Whether the server listens on every address of the computer."""
        try:
            return ipaddress.ip_address(self.host).is_unspecified
        except ValueError:
            return False

    @property
    def product_uri(self) -> str:
        """ProductInstanceUri of the bench."""
        machine = self.machine
        parts = (machine.manufacturer, machine.model, machine.serial_number)
        return machine.uri or ":".join(("urn", *("-".join(part.lower().split()) for part in parts)))


def load_opcua(data: Path) -> OpcUaSettings:
    """Return the settings of a data folder.

    Raises:
        StationError: there is no such file; with what is to be written into it.
        RecipeError: with all problems of the file.

    """
    file = data / FILE
    if not file.exists():
        raise StationError(
            f"{file}: is missing. Make this file, with the data on the bench's type plate, such as:\n{EXAMPLE}"
        )
    return load_document(file, OpcUaSettings)
