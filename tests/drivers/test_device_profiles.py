"""Profile models: the shipped files load, and each kind of mistake is refused with its reason."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from drivers_support import PROFILES, can_profile, drive_profile, modbus_profile, raw_profile
from eds_drives import DRIVES
from pydantic import ValidationError

READERS = {"cia402-drive": drive_profile, "modbus": modbus_profile, "can": can_profile}


@pytest.mark.parametrize("path", sorted(PROFILES.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_profiles_load(path: Any) -> None:
    raw = raw_profile(path.stem)
    profile = READERS[raw["profile"]["kind"]](raw)
    assert profile.profile.name == path.stem


def test_mapping_entry_is_index_subindex_bits() -> None:
    profile = drive_profile(raw_profile("virtual-drive"))
    assert [item.mapping for item in profile.receive_pdos[0].objects] == [0x60400010, 0x60600008, 0x60710010]


def _set(*path: Any) -> Callable[[Any], None]:
    *keys, last, value = path

    def change(raw: Any) -> None:
        for key in keys:
            raw = raw[key]
        raw[last] = value

    return change


DRIVE_MISTAKES = [
    (_set("receive_pdos", 0, "objects", 2, "name", "target_torq"), "unknown name 'target_torq'"),
    (_set("receive_pdos", 0, "objects", 2, "type", "i32"), "target_torque has type i32; CiA 402 requires i16"),
    (_set("transmit_pdos", 1, "number", 1), "a PDO number is used twice"),
    (_set("transmit_pdos", 1, "objects", 1, "name", "actual_position"), "an object is listed twice"),
    (lambda raw: raw["receive_pdos"].pop(), "required objects are missing: target_velocity"),
    (_set("profile", "vendor_id", "0x12"), "valid integer"),
    (_set("scaling", "velocity_counts_per_rad_s", 0.0), "greater than 0"),
    (_set("comment", "x"), "Unexpected keyword argument"),
    (
        lambda raw: raw["transmit_pdos"][1]["objects"].append(raw["transmit_pdos"][0]["objects"][3]),
        "PDO 2: its objects have 9 bytes; a CAN message holds 8",
    ),
]


@pytest.mark.parametrize(("change", "reason"), DRIVE_MISTAKES, ids=[reason for _, reason in DRIVE_MISTAKES])
def test_drive_profile_mistakes(change: Callable[[Any], None], reason: str) -> None:
    raw = raw_profile("virtual-drive")
    change(raw)
    with pytest.raises(ValidationError, match=reason):
        drive_profile(raw)


MODBUS_MISTAKES = [
    (_set("read", "count", 3), "outside the 3 registers that are read"),
    (_set("read", "fields", 1, "type", "i16"), "allowed: 'bit' with type u16, without scale"),
    (_set("read", "fields", 1, "name", "identity"), "a field name is used twice"),
    (_set("read", "table", "coil"), "found type u16 in table coil; allowed: type bit"),
    (_set("identity", "value", 65536), "65535"),
    (_set("identity", "text", "AB"), "'value' is needed, and 'text' is not allowed"),
    (_set("read", "fields", 4, "scale", 0.0), "found scale 0"),
    (_set("read", "fields", 2, "bit", 0), "estop_released and guard_closed read the same bit"),
    (_set("read", "fields", -1, "scale", -1.0), "a counter has no scale and no zero. Delete 'scale'"),
    (_set("write", {"table": "input", "address": 0, "fields": []}), "Input should be 'holding'"),
    (
        _set("write", {"table": "holding", "address": 0, "fields": [{"name": "a", "offset": 1, "type": "u16"}]}),
        "expected 0",
    ),
]


@pytest.mark.parametrize(("change", "reason"), MODBUS_MISTAKES, ids=[reason for _, reason in MODBUS_MISTAKES])
def test_modbus_profile_mistakes(change: Callable[[Any], None], reason: str) -> None:
    raw = raw_profile("virtual-remote-io")
    change(raw)
    with pytest.raises(ValidationError, match=reason):
        modbus_profile(raw)


def test_the_shipped_profile_of_an_epos4_maps_only_what_such_a_drive_lets_map() -> None:
    """By a public EDS of it the error register (0x1001) cannot be mapped: the set-up would end there."""
    profile = drive_profile(raw_profile("maxon-epos4"))
    mapped = [one.index for pdo in (*profile.receive_pdos, *profile.transmit_pdos) for one in pdo.objects]
    assert mapped
    assert [f"0x{index:04X}" for index in mapped if not DRIVES["epos4-like"].objects[index].mappable] == []
