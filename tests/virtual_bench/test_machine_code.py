"""The compiled plant: kept whole or not at all, and loaded without numba."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from math import isnan, nan
from pathlib import Path

import pytest
from test_same_bits import Y

from virtual_bench.physics import machine_code
from virtual_bench.physics.decay import decay

LOADS = """
import sys
from virtual_bench.physics.machine_code import look
look()
sys.exit("numba" in sys.modules)
"""


@pytest.fixture(scope="module")
def code() -> bytes:
    """What is kept of the kernel on this computer; compiled here only where no other test has had it compiled."""
    machine_code.look()
    kept = [machine_code._read(file) for folder in machine_code._folders() for file in folder.glob("plant-*.o")]
    found = [one for one in kept if one is not None]
    assert found
    return found[0]


def test_what_was_compiled_once_is_loaded_without_numba(code: bytes) -> None:
    assert code
    assert subprocess.run([sys.executable, "-c", LOADS], check=False).returncode == 0


@pytest.mark.parametrize("harm", ["cut short", "one bit", "only the hash", "empty"])
def test_a_damaged_file_is_not_loaded(code: bytes, tmp_path: Path, harm: str) -> None:
    file = tmp_path / "plant.o"
    assert machine_code._keep(file, code)
    assert machine_code._read(file) == code
    whole = file.read_bytes()
    middle = len(whole) // 2
    file.write_bytes(
        {
            "cut short": whole[:-1],
            "one bit": whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :],
            "only the hash": whole[: machine_code.DIGEST_BYTES],
            "empty": b"",
        }[harm]
    )
    assert machine_code._read(file) is None


def test_where_nothing_can_be_kept_the_plant_still_runs(
    code: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nowhere() -> Iterator[Path]:
        blocked = tmp_path / "file"
        blocked.touch()
        yield blocked / "folder"

    monkeypatch.setattr(machine_code, "_folders", nowhere)
    monkeypatch.setattr(machine_code, "_compiled", lambda *_: code)
    assert callable(machine_code.look.__wrapped__())


def test_code_that_calls_more_than_can_be_found_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine_code, "ROUNDS", 0)
    with pytest.raises(RuntimeError, match="numba_gil_ensure"):
        machine_code._compiled("", "")


def test_what_is_compiled_gives_the_same_bits() -> None:
    """Here, where numba has been loaded for the test before: that takes seconds."""
    from virtual_bench.physics.plant_kernel import decay_of as compiled  # noqa: PLC0415

    assert [compiled(y) for y in Y.tolist()] == decay(Y).tolist()
    assert isnan(compiled(nan))
