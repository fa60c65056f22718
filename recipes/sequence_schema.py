"""The sequence of a recipe: its steps, what each takes, and the order they must stand in."""

from __future__ import annotations

import itertools
from typing import Annotated, Any, Literal

from pydantic import Field

from recipes.quantity import (
    Acceleration,
    PositiveAngle,
    PositiveTime,
    PositiveTorque,
    Speed,
    Time,
    Torque,
    TorqueRate,
)
from recipes.section import Section

Count = Annotated[int, Field(ge=1, le=100_000)]


class Home(Section):
    """Zeroes taken at rest, drive enabled and referenced."""

    kind: Literal["home"]
    tare_time_s: PositiveTime = Field(alias="tare_time")
    torque_in_tare_nm: Torque = Field(alias="torque_in_tare")
    torque_out_tare_nm: Torque = Field(alias="torque_out_tare")


class Lock(Section):
    """Lock closed and proven by a small torque."""

    kind: Literal["lock"]
    holding_torque_nm: PositiveTorque = Field(alias="holding_torque")
    proof_torque_nm: PositiveTorque = Field(alias="proof_torque")
    max_motion_rad: PositiveAngle = Field(alias="max_motion")
    proof_time_s: PositiveTime = Field(alias="proof_time", default=0.2)


class Calibrate(Section):
    """Input torque against output torque, both directions, up and down."""

    kind: Literal["calibrate"]
    peak_torque_nm: PositiveTorque = Field(alias="peak_torque")
    torque_rate_nm_s: TorqueRate = Field(alias="torque_rate")
    dwell_s: Time = Field(alias="dwell", default=0.2)


class TorqueCycles(Section):
    """Measured cycles, ramped by torque rate."""

    kind: Literal["torque_cycles"]
    count: Count
    peak_torque_nm: PositiveTorque = Field(alias="peak_torque")
    torque_rate_nm_s: TorqueRate = Field(alias="torque_rate")
    dwell_s: Time = Field(alias="dwell", default=0.2)


class SpeedCycles(Section):
    """Measured cycles at constant speed of the motor shaft until a torque."""

    kind: Literal["speed_cycles"]
    count: Count
    peak_torque_nm: PositiveTorque = Field(alias="peak_torque")
    speed_rad_s: Speed = Field(alias="speed")
    acceleration_rad_s2: Acceleration = Field(alias="acceleration")
    dwell_s: Time = Field(alias="dwell", default=0.2)
    time_limit_s: PositiveTime = Field(alias="time_limit")


class StepCycles(Section):
    """Measured cycles in equal steps of torque, with a dwell on each."""

    kind: Literal["step_cycles"]
    count: Count
    peak_torque_nm: PositiveTorque = Field(alias="peak_torque")
    steps: Annotated[int, Field(ge=1, le=1000)]
    torque_rate_nm_s: TorqueRate = Field(alias="torque_rate")
    dwell_s: PositiveTime = Field(alias="dwell")


class FatigueCycles(Section):
    """Load cycles that condition the unit; never evaluated."""

    kind: Literal["fatigue_cycles"]
    count: Count
    peak_torque_nm: PositiveTorque = Field(alias="peak_torque")
    torque_rate_nm_s: TorqueRate = Field(alias="torque_rate")


class Unload(Section):
    """Torque to zero at a bounded rate."""

    kind: Literal["unload"]
    torque_rate_nm_s: TorqueRate = Field(alias="torque_rate")


class Release(Section):
    """Lock opened, once the torque is proven below `max_torque`."""

    kind: Literal["release"]
    max_torque_nm: PositiveTorque = Field(alias="max_torque")


Cycles = TorqueCycles | SpeedCycles | StepCycles | FatigueCycles
Step = Annotated[Home | Lock | Calibrate | Cycles | Unload | Release, Field(discriminator="kind")]

STEP_KINDS: tuple[str, ...] = (
    "home", "lock", "calibrate", "torque_cycles", "speed_cycles", "step_cycles", "fatigue_cycles", "unload", "release",
)  # fmt: skip
CYCLE_KINDS: frozenset[str] = frozenset({"torque_cycles", "speed_cycles", "step_cycles", "fatigue_cycles"})

RANK: dict[str, int] = {
    "home": 0,
    "lock": 1,
    "calibrate": 2,
    **dict.fromkeys(CYCLE_KINDS, 3),
    "unload": 4,
    "release": 5,
}
"""Place of a step in the order: home, lock, [calibrate], one or more cycles, unload, release."""

REQUIRED: tuple[tuple[str, str], ...] = (
    ("home", "the drive must be enabled and the sensors zeroed"),
    ("lock", "there is no torque without a proven lock"),
    ("unload", "a wound-up reducer stores energy: the torque must be brought to zero"),
    ("release", "the lock must be opened, once the torque is proven low"),
)


def order_faults(kinds: list[str]) -> list[tuple[int | None, str, str]]:
    """What is wrong with the order of the steps: (index or None for the whole, found, allowed); empty when right."""
    faults: list[tuple[int | None, str, str]] = []
    order = "home, lock, calibrate (optional), one or more cycles, unload, release"
    for kind, reason in REQUIRED:
        if kind not in kinds:
            faults.append((None, f"no '{kind}' step: {reason}", order))
    if not any(kind in CYCLE_KINDS for kind in kinds):
        faults.append((None, "no cycles: nothing would be measured", order))
    known = [(index, kind) for index, kind in enumerate(kinds) if kind in RANK]
    for (_, before), (index, kind) in itertools.pairwise(known):
        if kind not in CYCLE_KINDS and kinds.index(kind) != index:
            faults.append((index, f"a second '{kind}' step", order))
        elif RANK[kind] < RANK[before]:
            faults.append((index, f"'{kind}' stands after '{before}'", order))
    return faults


def unfold(value: Any) -> Any:
    """`{calibrate: {...}}` as the file has it, to `{kind: calibrate, ...}` as the models want it."""
    if isinstance(value, dict) and len(value) == 1:
        (kind, body) = next(iter(value.items()))
        if isinstance(kind, str) and (body is None or isinstance(body, dict)):
            return {"kind": kind, **{key: item for key, item in (body or {}).items() if key != "kind"}}
    return value
