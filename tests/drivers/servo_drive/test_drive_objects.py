"""The rows that a drive is set up by, without a drive: values, places, and how they compare."""

from __future__ import annotations

import dataclasses
import itertools
import math

import pytest
from drivers_support import PERIOD_NS, drive_config

from drivers.servo_drive.mapping import mapping_groups
from drivers.servo_drive.objects import (
    Treatment,
    homing_rows,
    identity_rows,
    protection_rows,
    rating_rows,
    synchronisation_rows,
)


def test_limits_are_rounded_down() -> None:
    config = drive_config(max_torque_nm=5.4999, max_speed_rad_s=2 * math.pi * 1.999)
    values = {row.index: row.value for row in protection_rows(config)}
    assert values[0x6072] == 1099
    assert values[0x6080] == 119


def test_no_object_is_asked_for_two_values() -> None:
    config = drive_config()
    rows = [
        *identity_rows(config),
        *rating_rows(config),
        *synchronisation_rows(config, PERIOD_NS),
        *protection_rows(config),
        *homing_rows(),
        *itertools.chain.from_iterable(mapping_groups(config)),
    ]
    places = [(row.index, row.subindex) for row in rows if row.treatment is not Treatment.STEP]
    assert len(places) == len(set(places))
    assert all(row.fits and row.meaning and row.next_step for row in rows)


@pytest.mark.parametrize(
    ("period_ns", "units", "power"), [(1_000_000, 1, -3), (500_000, 5, -4), (2_000_000, 2, -3), (125_000, 125, -6)]
)
def test_interpolation_period(period_ns: int, units: int, power: int) -> None:
    told = dataclasses.replace(drive_config().profile, write_sync_period=True)
    config = dataclasses.replace(drive_config(), profile=told)
    rows = {(row.index, row.subindex): row.value for row in synchronisation_rows(config, period_ns)}
    assert rows[0x60C2, 1] == units
    assert rows[0x60C2, 2] == power
    assert rows[0x1006, 0] == period_ns // 1000
    assert 0x1006 not in {row.index for row in synchronisation_rows(drive_config(), period_ns)}


def test_a_row_compares_without_the_bits_that_are_the_drives_own() -> None:
    row = next(
        row
        for row in itertools.chain.from_iterable(mapping_groups(drive_config()))
        if (row.index, row.treatment) == (0x1800, Treatment.WRITE)
    )
    on = dataclasses.replace(row, subindex=1, value=0x40000185, compare_mask=0xBFFFFFFF)
    assert on.matches(0x185)
    assert on.matches(0x40000185)
    assert not on.matches(0xC0000185)
