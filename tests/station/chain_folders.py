"""What tests do with a chain: read and write its lines, find its runs, forge a key, go to another computer."""

from __future__ import annotations

from pathlib import Path

import pytest

from station.own_place import PLACE
from station.records.chain.chain_file import CHAIN
from station.records.chain.keys import BenchKey


def another_computer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str = "another") -> None:
    monkeypatch.setenv(PLACE, str(tmp_path / name))


def lines(data: Path) -> list[bytes]:
    return (data / CHAIN).read_bytes().splitlines(keepends=True)


def write(data: Path, changed: list[bytes]) -> None:
    (data / CHAIN).write_bytes(b"".join(changed))


def folder(data: Path, number: int) -> Path:
    return sorted(data.glob("*Z-*"))[number]


def a_key() -> BenchKey:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey  # noqa: PLC0415 - one forger's

    return BenchKey(Ed25519PrivateKey.generate())
