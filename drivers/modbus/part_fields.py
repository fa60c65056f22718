"""What each part of the bench must deliver and take, and the check of the device profiles against it."""

from __future__ import annotations

from types import MappingProxyType

from drivers.config import WireBenchConfig
from drivers.errors import Problem, ProfileError

PART_FIELDS = MappingProxyType(
    {
        "amplifier": ("sample_counter",),
        "brake": ("brake_on", "brake_current_a"),
        "remote_io": ("estop_released", "guard_closed"),
    }
)
"""What each part must deliver besides the measured channels; other fields may be missing and then read 0."""

BRAKE_ORDERS = frozenset({"brake_on", "brake_current_a"})


def check_parts(config: WireBenchConfig) -> None:
    """Raise ProfileError with every field that a part's profile lacks."""
    parts = {"amplifier": config.amplifier, "brake": config.brake, "remote_io": config.remote_io}
    problems: list[Problem] = []
    for part, device in parts.items():
        delivers = {field.name for field in device.profile.read.fields}
        needed = {*PART_FIELDS[part], *(config.channels if part == "amplifier" else ())}
        if missing := sorted(needed - delivers):
            problems.append(
                Problem(
                    f"does not deliver {', '.join(missing)}",
                    f"{part} profile {device.profile.profile.name}",
                    ", ".join(sorted(delivers)),
                    ", ".join(sorted(needed)),
                    "add the fields to the profile, or remove the sensors from the bench file",
                )
            )
    write = config.brake.profile.write
    takes = {field.name for field in write.fields} if write else set()
    if takes != BRAKE_ORDERS:
        problems.append(
            Problem(
                "the brake's orders cannot be written",
                f"brake profile {config.brake.profile.profile.name}",
                ", ".join(sorted(takes)) or "nothing to write",
                ", ".join(sorted(BRAKE_ORDERS)),
                "correct the write section of the profile",
            )
        )
    if problems:
        raise ProfileError(*problems)
