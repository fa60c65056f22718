"""What a virtual bench, or the gateway before a real one, is told when it is started for a run, and what it answers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Self

from station.bench.virtual_unit import VirtualUnit
from station.documents.entries import Plain


@dataclass(frozen=True, kw_only=True)
class BenchSpec:
    """Bench file, profiles, scenario, and where the torque in the unit is to be written (`truth`), all as paths.

    unit: None behind a gateway. clock: "scan" lets the scan lead, "wall" has the bench live by the wall clock.
    """

    bench: str
    profiles: Mapping[str, str]
    unit: VirtualUnit | None
    scenario: str | None = None
    truth: str | None = None
    embedded: bool = True
    clock: str


class Address(NamedTuple):
    """Where a part of a started bench listens; `channel`: of the CAN bus."""

    host: str
    port: int
    channel: str = ""


@dataclass(frozen=True)
class Ports:
    """Where a started bench listens: its CAN bus, its Modbus devices by their names, and what sets the pace if any."""

    can: Address
    devices: Mapping[str, Address]
    pace: Address | None

    @classmethod
    def of_ready_line(cls, line: bytes) -> Self:
        """Return what a bench says when it is ready; ValueError for what is no such line."""
        said = json.loads(line)
        try:
            parts = {name: _address(part) for name, part in said.items() if isinstance(part, dict) and "port" in part}
            return cls(parts.pop("can"), parts, parts.pop("pace", None))
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(
                f"the virtual bench did not start: expected its addresses, found {line[:100]!r}. See its log"
            ) from error


def _address(part: Plain) -> Address:
    return Address(part["host"], part["port"], part.get("channel", ""))
