"""Profiles drafted from EDS files that were written from what drives have: objects, types, access and mapping."""

from __future__ import annotations

from pathlib import Path

import pytest
from drivers_support import drive_profile
from eds_drives import DRIVES, Drive, Entry, eds_text
from ruamel.yaml import YAML

from definitions.profiles.drive import DriveProfile
from drivers.servo_drive.objects import missing_protections
from recipes import RecipeError
from station.bench.eds_profile import Draft, draft, eds_files

LACKS = {
    "epos4-like": {"setpoint_timeout", "torque_slope"},
    "nanotec-like": set(),
    "fixed-mapping": {"setpoint_timeout", "abort_connection"},
}
LIMIT = {"epos4-like": "max_current", "nanotec-like": "max_torque", "fixed-mapping": "max_torque"}


def drafted(folder: Path, drive: Drive, name: str = "drive") -> Draft:
    path = folder / f"{name}.eds"
    path.write_text(eds_text(drive), encoding="utf-8")
    return draft(path)


def completed(one: Draft) -> DriveProfile:
    """Return the profile of a draft, with what its file does not tell filled in."""
    raw = YAML(typ="rt").load(one.text)
    raw["scaling"].setdefault("position_counts_per_motor_rev", 4096.0)
    raw["scaling"].setdefault("velocity_counts_per_rad_s", 651.9)
    return drive_profile(raw)


@pytest.mark.parametrize("name", DRIVES)
def test_a_draft_has_what_the_drive_has_and_says_what_it_lacks(tmp_path: Path, name: str) -> None:
    one = drafted(tmp_path, DRIVES[name])
    profile = completed(one)
    assert not one.refused
    assert {row.name for row in missing_protections(profile)} == LACKS[name]
    assert len(one.lacks) == len(LACKS[name])
    assert profile.protections.torque_limit == LIMIT[name]
    assert (profile.profile.vendor_id, profile.profile.product_code) == (DRIVES[name].vendor, DRIVES[name].product)
    assert not profile.tried_on_hardware
    assert all(pdo.fixed_mapping is DRIVES[name].fixed for pdo in (*profile.receive_pdos, *profile.transmit_pdos))


def test_a_fixed_mapping_is_taken_over_entry_by_entry(tmp_path: Path) -> None:
    drive = DRIVES["fixed-mapping"]
    profile = completed(drafted(tmp_path, drive))
    assert tuple(tuple(item.mapping for item in pdo.objects) for pdo in profile.receive_pdos) == drive.receive
    assert tuple(tuple(item.mapping for item in pdo.objects) for pdo in profile.transmit_pdos) == drive.transmit


def test_what_the_file_does_not_tell_is_left_open_and_refused_where_the_profile_is_used(tmp_path: Path) -> None:
    one = drafted(tmp_path, DRIVES["fixed-mapping"])
    with pytest.raises(ValueError, match="position_counts_per_motor_rev"):
        drive_profile(YAML(typ="rt").load(one.text))
    assert any("0x608F" in text for text in one.open_places)
    assert any("0x6072 can only be read" in text for text in one.open_places)


@pytest.mark.parametrize(
    ("without", "told"), [(0x6071, "0x6071"), (0x6076, "0x6076"), (0x1017, "0x1017"), ((0x1016, 1), "dead controller")]
)
def test_a_drive_without_what_is_needed_is_told_as_such(
    tmp_path: Path, without: int | tuple[int, int], told: str
) -> None:
    drive = DRIVES["epos4-like"]
    objects = {place: entry for place, entry in drive.objects.items() if place != without}
    assert any(told in text for text in drafted(tmp_path, drive._replace(objects=objects)).refused)


def test_an_object_that_cannot_be_mapped_is_told(tmp_path: Path) -> None:
    drive = DRIVES["nanotec-like"]
    objects = drive.objects | {0x6071: Entry("i16", "rw", "0")}
    (text,) = drafted(tmp_path, drive._replace(objects=objects)).refused
    assert "0x6071" in text


def test_a_folder_is_gone_through_and_a_file_that_is_no_eds_is_told(tmp_path: Path) -> None:
    inner = tmp_path / "maker"
    inner.mkdir()
    drafted(inner, DRIVES["epos4-like"], "one")
    (tmp_path / "TWO.EDS").write_text("no EDS at all", encoding="utf-8")
    (tmp_path / "notes.txt").write_text("nothing", encoding="utf-8")
    found = eds_files(tmp_path)
    assert [path.name for path in found] == ["TWO.EDS", "one.eds"]
    with pytest.raises(RecipeError, match="EDS or DCF file"):
        draft(found[0])
