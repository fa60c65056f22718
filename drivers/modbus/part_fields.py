"""What each part of the bench must deliver and take, and the check of the device profiles against it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from types import MappingProxyType

from definitions.image import REMOTE_IO_FIELDS
from definitions.profiles.modbus import ModbusProfile
from drivers.config import ChannelConfig, WireBenchConfig
from drivers.errors import Problem, ProfileError
from drivers.sample import SAMPLE_FIELDS

PART_FIELDS = MappingProxyType(
    {
        "amplifier": ("sample_counter",),
        "brake": (),
        "remote_io": ("estop_released", "guard_closed"),
    }
)
"""What each part must deliver besides the measured channels; other fields may be missing and then read 0."""

READ_FIELDS = MappingProxyType(
    {
        "amplifier": SAMPLE_FIELDS,
        "brake": ("brake_on", "brake_current_a"),
        "remote_io": tuple(field.name for field in REMOTE_IO_FIELDS),
    }
)
"""Fields that are read of each part, in the order in which the image takes them."""

OF_ANY_PART = ("identity", "life_counter")
BRAKE_FIELDS = frozenset({"brake_on", "brake_current_a"})
"""What a brake takes and delivers; one of them each way is enough: `definitions.device_proofs` says what lacks then."""
ALIKE = 0.8
"""Likeness (of difflib) from which a field is taken for a misspelt one."""


def check_parts(config: WireBenchConfig) -> None:
    """Raise ProfileError with every field that a part's profile lacks or misspells."""
    parts = {"amplifier": config.amplifier, "brake": config.brake, "remote_io": config.remote_io}
    profiles = {part: device.profile for part, device in parts.items() if device is not None}
    problems = part_problems(profiles, config.channels)
    if problems:
        raise ProfileError(*problems)


def part_problems(parts: Mapping[str, ModbusProfile], channels: Sequence[str]) -> list[Problem]:
    """Return what the profiles of amplifier, brake and remote I/O lack, by their parts; channels: those measured.

    A bench that names the source of each channel has no part called amplifier (`source_problems`).
    """
    problems = [problem for part, profile in parts.items() for problem in _of_reading(part, profile, channels)]
    brake = parts.get("brake")
    if brake is None:  # at an output of the drive
        return problems
    takes = {field.name for field in brake.write.fields} if brake.write else set()
    shows = {field.name for field in brake.read.fields} & BRAKE_FIELDS
    if not takes or not takes <= BRAKE_FIELDS:
        problems.append(
            Problem(
                "cannot be given the brake's orders",
                f"brake profile {brake.profile.name}",
                ", ".join(sorted(takes)) or "nothing to write",
                " or ".join(sorted(BRAKE_FIELDS)),
                "correct the write section of the profile",
            )
        )
    if not shows:
        problems.append(
            Problem(
                "does not say whether the brake is on",
                f"brake profile {brake.profile.name}",
                ", ".join(sorted(field.name for field in brake.read.fields)),
                " or ".join(sorted(BRAKE_FIELDS)),
                "read back what is written: a coil by table 'coil', a register by table 'holding'",
            )
        )
    return problems


def source_problems(sources: Sequence[ChannelConfig], blocks: Sequence[tuple[str, Sequence[str]]]) -> list[Problem]:
    """Return the channels whose field or proof their device does not deliver.

    `blocks`: name of the device and fields, of every block that is read and of every frame. A proof must be in the same
    one as its field: another tells nothing of it.
    """
    problems = []
    for source in sources:
        of_device = [fields for device, fields in blocks if device == source.device]
        whole = [name for one in of_device for name in one]
        together = next((list(one) for one in of_device if source.field in one), whole)
        for name, fields in ((source.field, whole), (source.proof_field, together)):
            if name and name not in fields:
                near = get_close_matches(name, fields, n=1, cutoff=ALIKE)
                hint = f"did you mean {near[0]}? Correct the name" if near else "name one of these"
                where = f"channel {source.channel} of device {source.device}"
                problems.append(Problem("names a field that is not there", where, name, ", ".join(fields), hint))
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
