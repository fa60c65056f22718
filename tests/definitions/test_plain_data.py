"""Dataclasses as plain data: what was written reads back exactly, and every other content is refused with its place."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Literal

import pytest

from definitions.plain_data import InexactError, exact, plain


class Colour(IntEnum):
    RED = 1
    BLUE = 2


@dataclass(frozen=True)
class Part:
    length_mm: float
    number: int


@dataclass(frozen=True)
class Whole:
    name: str
    on: bool
    colour: Colour
    way: Literal["in", "out"]
    limit_nm: float
    parts: tuple[Part, ...]
    spare: Part | None
    least: float | None


WHOLE = Whole("a", True, Colour.BLUE, "in", 0.1 + 0.2, (Part(1e-300, -5), Part(2.0, 1 << 40)), None, None)  # noqa: FBT003


def _as_read(whole: Whole) -> Any:
    return json.loads(json.dumps(plain(whole), allow_nan=False))


def test_what_was_written_reads_back() -> None:
    data = _as_read(WHOLE)
    assert exact(Whole, data) == WHOLE
    assert repr(exact(Whole, data)) == repr(WHOLE)
    data["spare"] = {"length_mm": 3, "number": 3}
    spare = exact(Whole, data).spare
    assert spare == Part(3.0, 3)
    assert type(spare.length_mm) is float


def test_no_limit_is_read_where_it_may_be_and_nowhere_else() -> None:
    data = _as_read(WHOLE) | {"limit_nm": None}
    assert exact(Whole, data, unlimited=True).limit_nm == math.inf
    assert exact(Whole, data, unlimited=True).least is None
    with pytest.raises(InexactError, match="limit_nm: found None; allowed is a finite number"):
        exact(Whole, data)


def _put(**values: Any) -> Callable[[Any], Any]:
    return lambda data: data | values


REFUSED: list[tuple[Callable[[Any], Any], str]] = [
    (lambda data: {name: data[name] for name in data if name != "least"}, "least is missing"),
    (_put(more=1), "more is unknown"),
    (_put(name=1), "name: found 1; allowed is a text"),
    (_put(on=1), "on: found 1; allowed is true or false"),
    (_put(colour=3), "colour: found 3; allowed is one of"),
    (_put(colour=True), "colour: found True"),
    (_put(way="up"), "way: found 'up'; allowed is 'in' or 'out'"),
    (_put(limit_nm="1"), "limit_nm: found '1'; allowed is a finite number"),
    (_put(limit_nm=False), "limit_nm: found False"),
    (_put(limit_nm=math.nan), "limit_nm: found nan"),
    (_put(limit_nm=math.inf), "limit_nm: found inf"),
    (_put(limit_nm=10**400), "limit_nm: found 1000"),
    (_put(parts={}), "parts: found {}; allowed is a list"),
    (_put(parts=[[]]), r"parts\[0\]: found \[\]; allowed is the fields of Part"),
    (_put(parts=[{"length_mm": 1.0, "number": 1.0}]), r"parts\[0\].number: found 1.0; allowed is a whole number"),
    (_put(parts=[{"length_mm": 1.0, "number": True}]), r"parts\[0\].number: found True"),
    (_put(spare={"length_mm": 1.0}), "spare.number is missing"),
    (lambda _: [], "the whole: found"),
    (lambda _: None, "the whole: found None"),
]


@pytest.mark.parametrize(("change", "reason"), REFUSED, ids=[reason for _, reason in REFUSED])
def test_anything_else_is_refused_with_its_place(change: Callable[[Any], Any], reason: str) -> None:
    with pytest.raises(InexactError, match=reason):
        exact(Whole, change(_as_read(WHOLE)))


def test_every_problem_is_told() -> None:
    with pytest.raises(InexactError) as caught:
        exact(Whole, _as_read(WHOLE) | {"name": 1, "on": 1, "more": 1})
    assert len(caught.value.problems) == 3
