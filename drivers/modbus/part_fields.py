"""What each part of the bench must deliver and take, and the check of the device profiles against it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from types import MappingProxyType

from definitions.image import REMOTE_IO_FIELDS
from drivers.config import WireBenchConfig
from drivers.errors import Problem, ProfileError
from drivers.profile import ModbusProfile

PART_FIELDS = MappingProxyType(
    {
        "amplifier": ("sample_counter",),
        "brake": ("brake_on", "brake_current_a"),
        "remote_io": ("estop_released", "guard_closed"),
    }
)
"""What each part must deliver besides the measured channels; other fields may be missing and then read 0."""

READ_FIELDS = MappingProxyType(
    {
        "amplifier": (
            "torque_in_nm",
            "torque_out_nm",
            "angle_in_rad",
            "angle_out_rad",
            "sample_counter",
            "sample_time_us",
            "sample_status",
        ),
        "brake": ("brake_on", "brake_current_a"),
        "remote_io": tuple(field.name for field in REMOTE_IO_FIELDS),
    }
)
"""Fields that are read of each part, in the order in which the image takes them."""

OF_ANY_PART = ("identity", "life_counter")
BRAKE_ORDERS = frozenset({"brake_on", "brake_current_a"})
ALIKE = 0.8
"""Likeness (of difflib) from which a field is taken for a misspelt one."""


def check_parts(config: WireBenchConfig) -> None:
    """Raise ProfileError with every field that a part's profile lacks or misspells."""
    parts = {"amplifier": config.amplifier, "brake": config.brake, "remote_io": config.remote_io}
    problems = part_problems({part: device.profile for part, device in parts.items()}, config.channels)
    if problems:
        raise ProfileError(*problems)


def part_problems(parts: Mapping[str, ModbusProfile], channels: Sequence[str]) -> list[Problem]:
    """Return what the profiles of amplifier, brake and remote I/O lack, by their parts; channels: those measured."""
    problems = [problem for part, profile in parts.items() for problem in _of_reading(part, profile, channels)]
    write = parts["brake"].write
    takes = {field.name for field in write.fields} if write else set()
    if takes != BRAKE_ORDERS:
        problems.append(
            Problem(
                "cannot be given the brake's orders",
                f"brake profile {parts['brake'].profile.name}",
                ", ".join(sorted(takes)) or "nothing to write",
                ", ".join(sorted(BRAKE_ORDERS)),
                "correct the write section of the profile",
            )
        )
    return problems


def _of_reading(part: str, profile: ModbusProfile, channels: Sequence[str]) -> Iterator[Problem]:
    delivers = [field.name for field in profile.read.fields]
    needed = {*PART_FIELDS[part], *(channels if part == "amplifier" else ())}
    where = f"{part} profile {profile.profile.name}"
    if missing := sorted(needed - set(delivers)):
        yield Problem(
            f"does not deliver {', '.join(missing)}",
            where,
            ", ".join(sorted(delivers)),
            ", ".join(sorted(needed)),
            "add the fields to the profile, or remove the sensors from the bench file",
        )
    known = (*READ_FIELDS[part], *OF_ANY_PART)
    for name in delivers:
        near = get_close_matches(name, [one for one in known if one not in delivers], n=1, cutoff=ALIKE)
        if name not in known and near and near[0] not in missing:
            yield Problem(
                "has a field that nothing reads",
                where,
                name,
                ", ".join(known),
                f"did you mean {near[0]}? Correct the name",
            )
