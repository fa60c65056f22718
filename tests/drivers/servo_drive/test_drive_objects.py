"""The rows that a drive is set up by, without a drive: values, places, and how they compare."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any, get_args, get_type_hints

import pytest
from drivers_support import PERIOD_NS, drive_config, drive_profile, raw_profile

from definitions.profiles.drive import DriveProtections
from definitions.protections import BY_NAME, DRIVE_PROTECTIONS, NONE
from drivers.config import DriveConfig
from drivers.servo_drive.mapping import mapping_groups
from drivers.servo_drive.objects import (
    HOMING_MODE,
    PROTECTIONS,
    Treatment,
    homing_rows,
    identity_rows,
    missing_protections,
    polarity_rows,
    protection_rows,
    rating_rows,
    synchronisation_rows,
)
from drivers.servo_drive.units import drive_units


def with_profile(**options: Any) -> DriveConfig:
    """Return a drive whose profile has these options instead."""
    return drive_config(profile=drive_profile(dict(raw_profile("virtual-drive")) | options))


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
        *polarity_rows(),
        *homing_rows(config),
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


@pytest.mark.parametrize(
    ("protection", "way", "objects"),
    [
        ("torque_limit", "max_torque", {0x6072: 1100}),
        ("torque_limit", "torque_limits", {0x60E0: 1100, 0x60E1: 1100}),
        ("torque_limit", "max_current", {0x6073: 1100}),
        ("torque_limit", "none", {}),
        ("torque_slope", "none", {}),
        ("abort_connection", "none", {}),
        ("speed_limit", "none", {}),
    ],
)
def test_a_protection_is_written_in_the_way_that_the_drive_has_it(
    protection: str, way: str, objects: dict[int, int]
) -> None:
    config = with_profile(protections={protection: way})
    of_it = {row.index for row in PROTECTIONS if row.name == protection}
    assert {row.index: row.value for row in protection_rows(config) if row.index in of_it} == objects
    assert [row.name for row in missing_protections(config.profile)] == ([protection] if way == "none" else [])


def test_a_set_point_without_time_out_and_a_drive_without_bit_12_are_missing_protections() -> None:
    raw = raw_profile("virtual-drive")
    raw["receive_pdos"][0]["timeout"] = False
    raw["protections"] = {"follows_command": "none"}
    assert [row.name for row in missing_protections(drive_profile(raw))] == ["setpoint_timeout", "follows_command"]


def test_every_way_of_the_table_is_one_of_the_profile_and_has_its_objects() -> None:
    hints = get_type_hints(DriveProtections)
    for row in DRIVE_PROTECTIONS:
        if row.name in hints:
            ways = [way for way, _ in row.ways]
            assert get_args(hints[row.name]) == (*ways, NONE)
    assert set(hints) <= {row.name for row in DRIVE_PROTECTIONS}
    written = {(row.name, row.way) for row in PROTECTIONS}
    in_pdos_and_words = {("setpoint_timeout", "rpdo_timeout"), ("follows_command", "status_bit_12")}
    assert {(row.name, way) for row in DRIVE_PROTECTIONS for way, _ in row.ways} == written | in_pdos_and_words
    for row in PROTECTIONS:
        objects = dict(BY_NAME[row.name].ways)[row.way]
        assert f"0x{row.index:04X}" in objects


def test_torque_in_a_unit_of_the_drives_own() -> None:
    config = with_profile(
        scaling=dict(raw_profile("virtual-drive")["scaling"])
        | {"torque_counts_per_rated": 10000.0, "rated_torque_counts_per_nm": 1e6}
    )
    assert {row.index: row.value for row in protection_rows(config)}[0x6072] == 11000
    assert {row.index: row.value for row in rating_rows(config)}[0x6076] == 5_000_000
    assert drive_units(config).torque_nm_per_count == pytest.approx(5.0 * 2.0 / 10000)


def test_a_drive_that_is_mounted_the_other_way_round_has_the_other_sign_in_all_three() -> None:
    config = drive_config()
    straight, reverse = drive_units(config), drive_units(dataclasses.replace(config, reversed=True))
    assert dataclasses.astuple(reverse) == tuple(-factor for factor in dataclasses.astuple(straight))


@pytest.mark.parametrize(("method", "rows"), [(0, []), (35, [35]), (37, [37])])
def test_homing_is_without_motion_or_not_at_all(method: int, rows: list[int]) -> None:
    config = with_profile(homing_method=method)
    assert [row.value for row in homing_rows(config)] == rows
    needed = {row.index: row.value for row in rating_rows(config)}[0x6502]
    assert bool(needed & HOMING_MODE) is bool(method)


def test_a_fixed_mapping_is_compared_and_never_written() -> None:
    raw = raw_profile("virtual-drive")
    raw["transmit_pdos"][0]["fixed_mapping"] = True
    config = dataclasses.replace(drive_config(), profile=drive_profile(raw))
    rows = [row for group in mapping_groups(config) for row in group if row.index == 0x1A00]
    assert len(rows) == 5
    assert {row.treatment for row in rows} == {Treatment.CHECK}
