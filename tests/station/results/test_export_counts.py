"""What an exported file counts of its recording: what no recording can have is a damaged description."""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import pytest

from station.documents.exported import Counts
from station.documents.reading import of_plain
from station.errors import RecordError

HELD = Counts(
    periods=1000,
    missed=0,
    oldest_sample_scans=2,
    torque_in_saturated=0,
    torque_out_saturated=0,
    not_ready=0,
    zeroes_again=400,
    torque_in_zero_shift_nm=-0.01,
    torque_out_zero_shift_nm=0.02,
    holds=0,
)
FILE = Path("loop.csv.json")
NUMBERS = [one.name for one in fields(Counts) if not one.name.endswith("_nm")]


def read(**changes: Any) -> Counts:
    return of_plain(Counts, asdict(HELD) | changes, FILE)


def test_counts_come_back() -> None:
    assert read() == HELD


@pytest.mark.parametrize("name", NUMBERS)
def test_no_count_is_below_zero(name: str) -> None:
    with pytest.raises(RecordError, match=f"{name}: found -1; allowed is a whole number from"):
        read(**{name: -1})


def test_a_recording_has_a_period() -> None:
    with pytest.raises(RecordError, match="periods: found 0"):
        read(periods=0)


@pytest.mark.parametrize("shift", [float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["torque_in_zero_shift_nm", "torque_out_zero_shift_nm"])
def test_a_shift_of_zero_is_a_number(name: str, shift: float) -> None:
    with pytest.raises(RecordError, match=f"{name}: found"):
        read(**{name: shift})
