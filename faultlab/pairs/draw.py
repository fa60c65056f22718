"""Which two faults come together, in which states and how large: drawn by chance, the same for the same numbers."""

from __future__ import annotations

import random
from typing import NamedTuple

from faultlab.rows import AFTER_SCANS, STATES
from virtual_bench.faults.scenario import Fault, Header, Scenario, When
from virtual_bench.faults.vocabulary import FAULTS, ONLY_OVER_WIRES


class Size(NamedTuple):
    """Range from which a value is drawn, each decade as often as the next; `around` is added, with either sign."""

    low: float
    high: float
    around: float | None = None
    whole: bool = False


def _signal(full: float) -> dict[str, Size]:
    """Sizes of what a sensor can do wrong, from what nobody sees to what nobody misses; `full` in its unit."""
    return {
        "offset": Size(1e-4 * full, full, 0.0),
        "scale": Size(1e-4, 1.0, 1.0),
        "drift": Size(1e-5 * full, full, 0.0),
        "spike": Size(1e-4 * full, full, 0.0),
        "noise": Size(1e-4 * full, full),
        "lag": Size(1e-3, 1.0),
    }


_SHARE = Size(0.01, 1.0)
_FACTOR = Size(1e-3, 3.0, 1.0)
SIZES: dict[tuple[str, str], Size] = {
    **{(target, "drop"): _SHARE for target, verb in FAULTS if verb == "drop" and target.startswith("can.")},
    ("can.drive.tpdo1", "drop_next"): Size(1, 100, whole=True),
    ("can.setpoint", "drop_next"): Size(1, 100, whole=True),
    ("can.drive.tpdo1", "delay"): Size(0.1, 100.0),
    ("can.drive.tpdo1", "jitter"): Size(0.1, 100.0),
    ("can.drive.tpdo1", "truncate"): Size(1, 8, whole=True),
    ("drive.setpoint", "scale"): _FACTOR,
    ("drive.torque", "scale"): _FACTOR,
    ("drive.emcy", "raise"): Size(0x1000, 0xFFFF, whole=True),
    ("drive.emcy", "storm"): Size(0x1000, 0xFFFF, whole=True),
    **{(f"modbus.{device}", "slow"): Size(0.5, 500.0) for device in ("amplifier", "brake", "remote_io")},
    **{("sensor.torque_in", verb): size for verb, size in _signal(5.0).items()},
    **{("sensor.torque_out", verb): size for verb, size in _signal(500.0).items()},
    **{("sensor.angle_in", verb): size for verb, size in _signal(1.0).items()},
    **{("sensor.angle_out", verb): size for verb, size in _signal(0.01).items()},
    ("lock", "slip"): _SHARE,
    ("brake.current", "fade"): _SHARE,
    ("unit", "crack"): _SHARE,
    ("unit", "jam"): Size(1.0, 30.0),
    ("io.housing_temp", "offset"): Size(0.1, 100.0, 0.0),
    ("scan.overrun", "miss"): Size(1, 100, whole=True),
}
"""Of every fault that takes a value in virtual time."""

DRAWN = tuple(key for key in FAULTS if key not in ONLY_OVER_WIRES)
_OF_SENSORS = tuple(key for key in DRAWN if key[0].startswith("sensor."))
SHARE_OF_SENSORS = 0.7
"""Of the pairs, in which one fault is a sensor's: these alone reach a verdict without ending the run."""

OF_THE_UNIT = frozenset({"unit", "coupling"})
"""Targets that make another unit of this one: what it reads is then its own, and no clean run can say it."""

SHORT_MS = (5.0, 5000.0)
SHARE_OF_SHORT = 0.5


def pair_of(seed: int, number: int) -> Scenario:
    """Return the pair `number` of the draw `seed`: two faults with different targets or verbs."""
    dice = random.Random(f"{seed}:{number}")  # noqa: S311 - chance that can be repeated
    first = dice.choice(_OF_SENSORS if dice.random() < SHARE_OF_SENSORS else DRAWN)
    second = dice.choice([key for key in DRAWN if key != first])
    faults = tuple(_fault(dice, *key) for key in (first, second))
    return Scenario(scenario=Header(name=f"pair {number} of {seed}"), faults=faults)


def _fault(dice: random.Random, target: str, verb: str) -> Fault:
    state = dice.choice(STATES)
    when = When(state=state, after_scans=dice.randrange(2 * AFTER_SCANS[state]))
    size, row = SIZES.get((target, verb)), FAULTS[target, verb]
    value = None
    if size is not None:
        value = size.low * (size.high / size.low) ** dice.random()
        if size.around is not None:
            value = size.around + value * dice.choice((-1.0, 1.0))
        value = float(round(value)) if size.whole else float(f"{value:.4g}")
        value = min(max(value, row.low), row.high)
    low, high = SHORT_MS
    for_ms = round(low * (high / low) ** dice.random(), 1) if dice.random() < SHARE_OF_SHORT else None
    return Fault(target=target, verb=verb, value=value, when=when, for_ms=for_ms)
