"""Steps of a recipe's sequence, and the order that they must have.

In a file a step is an entry with one name, `- lock: {holding_torque: 600 N·m, ...}`; loaded it is a frozen section
whose `kind` is that name.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo

from recipes.text.problems import Problem, Source, did_you_mean, excerpt, nearest, one_of
from recipes.text.section import (
    FROM_DOCUMENT,
    Acceleration,
    Dwell,
    Frequency,
    Section,
    SmallAngle,
    Speed,
    SweepPeriod,
    TareTime,
    TimeLimit,
    Torque,
    TorqueOfRated,
    TorqueRate,
    refusal,
)

MeasuredCount = Annotated[int, Field(ge=1, le=1000)]
FatigueCount = Annotated[int, Field(ge=1, le=1_000_000)]
LevelCount = Annotated[int, Field(ge=2, le=1000)]
PeriodCount = Annotated[int, Field(ge=5, le=100)]


class Home(Section):
    """Drive enabled, reference found, sensors tared; the tares are the largest zero offsets that are accepted."""

    kind: Literal["home"] = "home"
    tare_time_s: TareTime
    torque_in_tare_nm: Torque
    torque_out_tare_nm: TorqueOfRated


class Lock(Section):
    """Lock closed and proven by a small torque under which the locked shaft must not move further than allowed."""

    kind: Literal["lock"] = "lock"
    holding_torque_nm: TorqueOfRated
    proof_torque_nm: TorqueOfRated
    max_motion_rad: SmallAngle
    proof_time_s: TareTime = 0.2


class Calibrate(Section):
    """Torque ratio measured in both directions, up and down."""

    kind: Literal["calibrate"] = "calibrate"
    peak_torque_nm: TorqueOfRated
    torque_rate_nm_s: TorqueRate
    dwell_s: Dwell = 0.2


class TorqueCycles(Section):
    """Loops by torque rate: zero, + peak, - peak, zero."""

    kind: Literal["torque_cycles"] = "torque_cycles"
    count: MeasuredCount
    peak_torque_nm: TorqueOfRated
    torque_rate_nm_s: TorqueRate
    dwell_s: Dwell = 0.2


class SpeedCycles(Section):
    """Loops at a constant speed of the drive's motor, turned round when the torque is reached."""

    kind: Literal["speed_cycles"] = "speed_cycles"
    count: MeasuredCount
    peak_torque_nm: TorqueOfRated
    speed_rad_s: Speed
    acceleration_rad_s2: Acceleration
    dwell_s: Dwell = 0.2
    time_limit_s: TimeLimit


class StepCycles(Section):
    """Loops in steps of equal torque with a dwell on each; `steps` is the number of levels from zero to the peak."""

    kind: Literal["step_cycles"] = "step_cycles"
    count: MeasuredCount
    peak_torque_nm: TorqueOfRated
    steps: LevelCount
    torque_rate_nm_s: TorqueRate
    dwell_s: Dwell = 0.2


class FatigueCycles(Section):
    """Loops that load the unit and are not evaluated."""

    kind: Literal["fatigue_cycles"] = "fatigue_cycles"
    count: FatigueCount
    peak_torque_nm: TorqueOfRated
    torque_rate_nm_s: TorqueRate


class TorqueSweep(Section):
    """A sine between the peak torque and twice the amplitude below it; its frequency goes up and down in each period.

    The frequency response is read from it (`lostmotion study frequency`): from all periods but the first and the last,
    in which the amplitude grows and fades.
    """

    kind: Literal["torque_sweep"] = "torque_sweep"
    peak_torque_nm: TorqueOfRated
    amplitude_nm: TorqueOfRated
    from_frequency_hz: Frequency
    to_frequency_hz: Frequency
    period_s: SweepPeriod
    periods: PeriodCount = 5
    torque_rate_nm_s: TorqueRate
    dwell_s: Dwell = 0.2

    @property
    def mean_torque_nm(self) -> float:
        """Torque about which the sine swings."""
        return self.peak_torque_nm - self.amplitude_nm


class Unload(Section):
    """Torque brought to zero at a bounded rate."""

    kind: Literal["unload"] = "unload"
    torque_rate_nm_s: TorqueRate


class Release(Section):
    """Lock opened, once the torque is proven to be below a limit."""

    kind: Literal["release"] = "release"
    max_torque_nm: TorqueOfRated


AnyStep = (
    Home | Lock | Calibrate | TorqueCycles | SpeedCycles | StepCycles | FatigueCycles | TorqueSweep | Unload | Release
)
Cycles = TorqueCycles | SpeedCycles | StepCycles | FatigueCycles

STAGES: dict[str, int] = {
    "home": 0,
    "lock": 1,
    "calibrate": 2,
    "torque_cycles": 3,
    "speed_cycles": 3,
    "step_cycles": 3,
    "fatigue_cycles": 3,
    "torque_sweep": 3,
    "unload": 4,
    "release": 5,
}
"""Every kind of step and its stage; a sequence never goes back to an earlier stage."""

CYCLES_STAGE = 3

WHY_REQUIRED: dict[str, str] = {
    "home": "Add '- home: {...}' as the first step: sensors are tared there",
    "lock": "Add '- lock: {...}' behind home: the unit must not be loaded before the lock is verified",
    "unload": "Add '- unload: {torque_rate: ...}' behind the cycles: a wound-up reducer stores energy",
    "release": "Add '- release: {max_torque: ...}' as the last step: it opens the lock",
}

ORDER = "home, lock, calibrate (may be left out), cycles (one block or more), unload, release"


def _step_with_kind(value: Any, info: ValidationInfo) -> Any:
    """Turn an entry `{lock: {...}}` into `{..., kind: lock}`."""
    if not (info.context or {}).get(FROM_DOCUMENT):
        return value
    allowed = f"one step: {one_of(list(STAGES))}"
    if not isinstance(value, dict) or not value:
        name = value if isinstance(value, str) else ""
        hint = f"Write '- {name or 'unload'}: {{...}}' with its options in the braces."
        raise refusal(excerpt(value), allowed, hint)
    (kind, options), *others = value.items()
    if others:
        names = ", ".join(str(name) for name, _ in others[:3])
        hint = f"Indent the options of {kind} further than its name, and begin every step with '- '."
        raise refusal(f"{names} in the same step as {excerpt(kind)}", "one kind of step per entry", hint)
    if kind not in STAGES:
        raise refusal(f"the unknown step {excerpt(kind)}", allowed, did_you_mean(kind, STAGES), at=kind)
    if options is not None and not isinstance(options, dict):
        raise refusal(excerpt(options), f"the options of {kind}", "Write them in braces.", at=kind)
    if "kind" in (options or {}):
        raise refusal("the unknown option 'kind'", f"the options of {kind}", "Delete it.", at=f"{kind}.kind")
    return {**(options or {}), "kind": kind}


Step = Annotated[
    Annotated[AnyStep, Field(discriminator="kind")],
    BeforeValidator(_step_with_kind),
]


def sequence_order(source: Source) -> Iterable[Problem]:
    """Yield what is wrong with the order of a recipe's steps, read from the plain data of its file."""
    data = source.data.get("sequence") if isinstance(source.data, dict) else None
    if not isinstance(data, list) or not data:
        return
    kinds = [_kind_of(entry) for entry in data]
    seen: dict[str, int] = {}
    latest = 0
    for index, kind in enumerate(kinds):
        if kind is None:
            continue
        stage = STAGES[kind]
        place = ("sequence", index)
        if stage != CYCLES_STAGE and kind in seen:
            yield source.problem(place, f"a second '{kind}'", f"each of these once: {ORDER}", "Delete one of them.")
        elif stage < latest:
            before = next(other for other in kinds[:index] if other is not None and STAGES[other] > stage)
            yield source.problem(place, f"'{kind}' behind '{before}'", ORDER, f"Move it before '{before}'.")
        seen.setdefault(kind, index)
        latest = max(latest, stage)
    for kind, why in WHY_REQUIRED.items():
        if kind not in seen:
            yield source.problem(("sequence",), f"a sequence without '{kind}'", ORDER, f"{why}.", at_name=True)
    if None not in kinds and CYCLES_STAGE not in {STAGES[kind] for kind in seen}:
        cycles = one_of([kind for kind, stage in STAGES.items() if stage == CYCLES_STAGE])
        hint = f"Add {cycles} before unload."
        yield source.problem(("sequence",), "a sequence without cycles", ORDER, hint, at_name=True)


def _kind_of(entry: object) -> str | None:
    """Return the kind that an entry has or most likely means."""
    name = next(iter(entry), None) if isinstance(entry, dict) else entry
    return nearest(name, STAGES) if isinstance(name, str) else None
