"""The K-fields that are written, as a table: level, meaning, form, length. Source: AQDEF, ASCII transfer format.

A file has one part, its characteristics, and a line of values for each run: characteristics are parted by 0x0F, what is
said of one value by 0x14. Readers accept almost anything, so what is not in this table is not written.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Level = Literal["file", "part", "characteristic", "value"]
Form = Literal["text", "whole number", "number", "moment", "events"]

ENCODING = "cp1252"
INSTEAD = str.maketrans({"−": "-", "′": "'", "Δ": "d"})
"""Signs of definitions that the encoding lacks, and what is written for them."""

END_OF_LINE = "\r\n"
NEXT_CHARACTERISTIC, NEXT_ENTRY = "\x0f", "\x14"
MOMENT = "%d.%m.%Y/%H:%M:%S"

NO_LIMIT, SPECIFIED, NATURAL = 0, 1, 2
"""K2120, K2121: there is no limit; the recipe states it; no unit can be beyond it, such as a backlash below zero."""

VALID, NOT_MEASURED = 0, 255
"""K0002: the value counts; there is none, or its measurement was invalid."""


@dataclass(frozen=True)
class Field:
    """A K-field. length: most characters. choices: all values that a whole number may have; none: any."""

    level: Level
    meaning: str
    form: Form
    length: int
    required: bool = False
    choices: tuple[int, ...] = ()


FIELDS: dict[str, Field] = {
    "K0100": Field("file", "number of characteristics", "whole number", 5, required=True),
    "K1001": Field("part", "part number: the model of the unit", "text", 30, required=True),
    "K1002": Field("part", "part description: the recipe and its revision", "text", 80, required=True),
    "K1081": Field("part", "machine: the bench", "text", 40),
    "K1900": Field("part", "remark: the program, and what is not real", "text", 255),
    "K2001": Field("characteristic", "number of the characteristic", "text", 20, required=True),
    "K2002": Field("characteristic", "description: metric, choices, branch and side", "text", 80, required=True),
    "K2004": Field("characteristic", "kind: 0, variable", "whole number", 1, required=True, choices=(0,)),
    "K2101": Field("characteristic", "nominal value; a recipe states none, so it is not written", "number", 22),
    "K2110": Field("characteristic", "lower limit, as K2120 says", "number", 22),
    "K2111": Field("characteristic", "upper limit, as K2121 says", "number", 22),
    "K2120": Field("characteristic", "kind of the lower limit: 0 none, 1 specified, 2 natural", "whole number", 1,
                   required=True, choices=(NO_LIMIT, SPECIFIED, NATURAL)),
    "K2121": Field("characteristic", "kind of the upper limit: 0 none, 1 specified, 2 natural", "whole number", 1,
                   required=True, choices=(NO_LIMIT, SPECIFIED, NATURAL)),
    "K2142": Field("characteristic", "unit", "text", 20, required=True),
    "K2900": Field("characteristic", "remark: the definition of the metric", "text", 255),
    "K0001": Field("value", "value", "number", 22, required=True),
    "K0002": Field("value", "attribute: 0 valid, 255 none", "whole number", 3, required=True,
                   choices=(VALID, NOT_MEASURED)),
    "K0004": Field("value", "day and time of the run, UTC", "moment", 19, required=True),
    "K0005": Field("value", "events, numbers of the table below, parted by commas", "events", 40),
    "K0014": Field("value", "part ident: the serial number", "text", 40, required=True),
}  # fmt: skip
"""Every field by its key, in the order of a file."""

IN_A_VALUE = ("K0001", "K0002", "K0004", "K0005")
"""Fields of one value in a line of values, in their order; K0014 stands in a line of its own, for all of them."""

EVENTS: dict[int, str] = {
    1: "measured again: not the first attempt of the unit",
    2: "the run's verdict is FAIL",
    3: "the run's verdict is NOT DECIDABLE",
    4: "the value is beyond its limit",
    5: "simulated unit of the virtual bench",
}
"""Numbers of K0005, and what they say."""

LIMITS = {"K2110": "K2120", "K2111": "K2121"}
"""A limit and the field that says of what kind it is. A natural one stands only opposite a specified one."""
