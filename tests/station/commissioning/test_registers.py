"""The word order shows in what changes, whatever a value is and however it is written."""

from __future__ import annotations

import math
import random
import struct

import pytest

from definitions.number_formats import LETTERS
from station.bench.assemble import modbus_profile
from station.bench.files import FileAt
from station.bench.request import DRIVER_PROFILES
from station.commissioning.contacts import TASKS, Seen, judged
from station.commissioning.registers import shown_order

NOISE = random.Random(1)  # noqa: S311 - values of a sensor, not secrets
SERIES = {
    "noise about zero": [NOISE.gauss(0.0, 1.0) for _ in range(60)],
    "pressed": [40.0 * math.sin(step / 20.0) + NOISE.gauss(0.0, 0.05) for step in range(60)],
    "a counter": [1000.0 + 20.0 * step for step in range(60)],
    "coarse": [0.5 * (step % 7) for step in range(60)],
}


def seen(kind: str, values: list[float], *, swapped: bool) -> list[tuple[int, int]]:
    numbers = values if kind == "f32" else [round(1000.0 * value) for value in values]
    words = [struct.unpack(">HH", struct.pack(">" + LETTERS[kind], number)) for number in numbers]
    return [(low, high) if swapped else (high, low) for high, low in words]


@pytest.mark.parametrize("kind", ["i32", "f32"])
@pytest.mark.parametrize("name", SERIES)
def test_the_half_that_moves_in_small_steps_is_the_upper_one(kind: str, name: str) -> None:
    for swapped, order in ((False, "big"), (True, "little")):
        assert shown_order(kind, seen(kind, SERIES[name], swapped=swapped)) == order


@pytest.mark.parametrize("kind", ["i32", "f32"])
def test_what_stands_still_shows_nothing(kind: str) -> None:
    assert shown_order(kind, seen(kind, [12.34] * 60, swapped=False)) is None


def test_a_single_register_has_no_word_order() -> None:
    assert shown_order("u16", [(1,), (2,)]) is None


PROFILE = modbus_profile(FileAt(DRIVER_PROFILES / "virtual-remote-io.yaml"))
PRESS, RELEASE, OPEN, *_ = TASKS
ESTOP, GUARD = (1, 0), (1, 1)


@pytest.mark.parametrize(
    ("task", "changed", "told"),
    [
        (PRESS, {ESTOP: 0}, ""),
        (RELEASE, {ESTOP: 1}, ""),
        (PRESS, {ESTOP: 0, (1, 7): 1}, ""),
        (PRESS, {GUARD: 0}, "offset: 1, bit: 1"),
        (OPEN, {ESTOP: 0}, "offset: 1, bit: 0"),
        (PRESS, {(1, 7): 0}, "offset: 1, bit: 7"),
        (PRESS, {ESTOP: 1}, "the other contact"),
        (PRESS, {}, "Check the wiring"),
    ],
)
def test_a_contact_at_the_wrong_input_is_told_with_the_right_one(task, changed, told: str) -> None:
    findings = list(judged(PROFILE, Seen(task, changed, 1.0)))
    assert [told in finding.cure for finding in findings] == ([True] if told else [])
