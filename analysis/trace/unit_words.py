"""What one cell of a row of units says: which unit, and whether it is that of its column.

The name of a column has its unit; a cell says the same, another unit of the same quantity, a unit of something else, or
no unit at all. Units are written in many ways: `Nm`, `N·m`, `[Nm]`, `Torque (Nm)`, `M/Nm`, `in Nm`, `Newtonmeter`, and
with a factor, as `10 Nm`, which is another unit.
"""

from __future__ import annotations

import re
from enum import Enum, auto
from typing import NamedTuple

BETWEEN = str.maketrans("", "", " \t·⋅∙•*.×-‐‑–—−")
"""Signs that stand between the parts of a unit, or alone where there is none."""

DEGREES = str.maketrans({"º": "°", "˚": "°", "℃": "°C", "℉": "°F"})
"""Other signs of a degree, and what they are taken for."""

OPENING, CLOSING = "[(<{", "])>}"
LONGEST = 60
"""Characters of a cell that may say a unit; longer ones are text."""

LABEL = re.compile(
    r"(?:[\w ]*[ _])?(?:units?|(?:ma(?:ß|ss))?einheit(?:en)?)(?:[ _]label)?(?![^\W_])\s*[:=]?\s*",
    re.IGNORECASE | re.ASCII,
)
"""What a row of units may call itself, before the first unit or in a cell of its own."""

NAMED = re.compile(
    r"(?P<name>.*?)(?:\s*[\[(<{]\s*(?:in\s+)?|(?:^|\s)in\s+|/)(?P<unit>[^\[(<{]+)", re.IGNORECASE | re.DOTALL
)
"""A unit behind the name of what it is of."""

FACTOR = re.compile(r"[x×*·\s]*[+\-−]?\d[\d.,^/+\-−⁺⁻⁰¹²³⁴-⁹]*(?:e[+\-−]?\d+)?[x×*·\s]*", re.IGNORECASE)
"""A number before a unit."""


def _plain(text: str) -> str:
    """Return a unit in one spelling, without letter case, brackets and signs between its parts; '' for a dash."""
    return text.translate(DEGREES).strip(f" {OPENING}{CLOSING}").casefold().translate(BETWEEN)


def _units(*words: str) -> frozenset[str]:
    return frozenset(_plain(word) for word in words)


class _Quantity(NamedTuple):
    """Units of a quantity in one spelling: those that are the unit of a column, and others."""

    shown: str
    own: frozenset[str]
    others: frozenset[str]


SIGNALS = _units("V", "mV", "A", "mA", "%", "‰", "count", "counts", "digit", "digits", "pulses", "LSB")
"""Units of a sensor's signal, whatever it measures."""

SECONDS = _units("s", "sec", "sek", "second", "seconds", "Sekunde", "Sekunden")
OTHER_TIMES = _units(
    *("ms", "msec", "msek", "millisec", "millisecond", "milliseconds", "Millisekunde", "Millisekunden"),
    *("us", "µs", "usec", "µsec", "microsecond", "microseconds", "Mikrosekunde", "Mikrosekunden"),
    *("ns", "nsec", "nanosecond", "nanoseconds", "Nanosekunde", "Nanosekunden"),
    *("min", "minute", "minutes", "Minuten", "h", "hr", "hrs", "hour", "hours", "Stunde", "Stunden"),
)
NEWTON_METRES = _units(
    "N·m", *(f"Newton{metre}" for metre in ("meter", "meters", "metre", "metres")), "Newtons meter", "Newtons metre"
)
OTHER_TORQUES = _units(
    *("kN·m", "MN·m", "mN·m", "µN·m", "uN·m", "daN·m", "N·cm", "N·mm", "kN·mm", "kN·cm", "Kilonewtonmeter"),
    *("Millinewtonmeter", "kilonewton metre", "kilonewton metres", "millinewton metre", "millinewton metres"),
    *("lbf·ft", "lb·ft", "ft·lbf", "ft·lb", "ft·lbs", "lbf·in", "lb·in", "in·lbf", "in·lb", "in·lbs"),
    *("ozf·in", "oz·in"),
    *("in·oz", "in·ozf", "foot pound", "foot pounds", "inch pound", "inch pounds", "pound foot", "pound feet"),
    *("kgf·m", "kg·m", "kgf·cm", "kg·cm", "kp·m", "kp·cm"),
)
RADIANS = _units("rad", "radian", "radians", "Radiant")
ARC_MINUTES = _units(
    *("arcmin", "arcmins", "′", "'", "’", "arc minute", "arc minutes", "minute of arc", "minutes of arc"),
    *("Bogenminute", "Bogenminuten", "Bogenmin", "Winkelminute", "Winkelminuten"),
)
OTHER_ANGLES = _units(
    *("deg", "degs", "°", "degree", "degrees", "Grad", "Altgrad", "Winkelgrad", "gon", "mdeg", "millidegrees"),
    *("mrad", "milliradian", "milliradians", "µrad", "urad", "microradian", "microradians"),
    *("arcsec", "arcsecs", '"', "″", "”", "arc second", "arc seconds", "second of arc", "seconds of arc"),
    *("Bogensekunde", "Bogensekunden", "Winkelsekunde", "Winkelsekunden"),
    *("turns", "revolution", "revolutions", "Umdrehung", "Umdrehungen"),
)
CELSIUS = _units(
    "°C", "C", "degC", "degrees C", "Celsius", "degree Celsius", "degrees Celsius", "Grad Celsius", "Grad C"
)
OTHER_TEMPERATURES = _units("K", "Kelvin", "°F", "F", "degF", "degrees F", "Fahrenheit", "degrees Fahrenheit", "Grad F")
ELSEWHERE = _units("rpm", "Hz", "kHz", "N", "kN", "mm", "µm", "bar", "W", "kW")
"""Units of quantities that a trace does not have, by which a row is known as one of units, too."""

TIME = _Quantity("s", SECONDS, OTHER_TIMES)
TORQUE = _Quantity("N·m", NEWTON_METRES, OTHER_TORQUES | SIGNALS)
ANGLE_RAD = _Quantity("rad", RADIANS, ARC_MINUTES | OTHER_ANGLES | SIGNALS)
ANGLE_ARCMIN = _Quantity("arcmin", ARC_MINUTES, RADIANS | OTHER_ANGLES | SIGNALS)
TEMPERATURE = _Quantity("°C", CELSIUS, OTHER_TEMPERATURES | SIGNALS)

QUANTITIES: dict[str, _Quantity] = {
    "t_s": TIME,
    "torque_in_nm": TORQUE,
    "torque_out_nm": TORQUE,
    "angle_in_rad": ANGLE_RAD,
    "angle_in_arcmin": ANGLE_ARCMIN,
    "angle_out_rad": ANGLE_RAD,
    "angle_out_arcmin": ANGLE_ARCMIN,
    "windup_rad": ANGLE_RAD,
    "windup_arcmin": ANGLE_ARCMIN,
    "temperature_c": TEMPERATURE,
    "drive_torque_nm": TORQUE,
    "drive_angle_rad": ANGLE_RAD,
}
"""Of each column that has a unit what it may say; the name has the unit, and nothing may contradict it."""

KNOWN: frozenset[str] = frozenset().union(
    ELSEWHERE, *(words for one in QUANTITIES.values() for words in (one.own, one.others))
)

WORDS_TOO = frozenset({"min", "second"})
"""Units that are as often a word; so is a letter that stands alone: a shift, an operator, a version.

Units of a signal are no surer: a recorder tells its ranges and loads in them.
"""

NOTHING = frozenset({"", "n/a"})
"""What says in one spelling that a column has no unit."""


class Kind(Enum):
    """What a cell is in a row that may be one of units."""

    EMPTY = auto()
    LABEL = auto()
    """The word unit itself."""
    SURE = auto()
    """A unit of the quantity of the column that is hardly anything else."""
    FITS = auto()
    """A unit of the quantity of the column that may be a letter or word, or has a factor."""
    UNIT = auto()
    """A unit of another quantity."""
    BRACKETS = auto()
    """Whatever stands in brackets, without a number."""
    WORD = auto()


class _Said(NamedTuple):
    """A cell taken apart: the unit in one spelling, '' where there is none."""

    word: str
    label: bool = False
    named: bool = False
    factor: bool = False
    brackets: bool = False


def _said(cell: str) -> _Said:
    text = cell.strip()
    if len(text) > LONGEST:
        return _Said(text)
    label = LABEL.match(text)
    text = text[label.end() :] if label else text
    word = _plain(text)
    if word in NOTHING:
        return _Said("", label=label is not None)
    brackets = text[0] in OPENING and text[-1] in CLOSING and not any(sign.isdecimal() for sign in text)
    if word in KNOWN:
        return _Said(word, brackets=brackets)
    text = text.strip(f" {OPENING}{CLOSING}")
    split = NAMED.fullmatch(text)
    # N·m/rad is a unit of its own; M/N·m and a/rad say of what N·m and rad are the units: a letter is a symbol there
    named = split is not None and (len(split["name"].strip()) < 2 or _plain(split["name"]) not in KNOWN)
    if split and named:
        text = split["unit"]
    number = FACTOR.match(text)
    bare = _plain(text[number.end() :] if number else text)
    if bare not in KNOWN:
        return _Said(word, brackets=brackets)
    return _Said(bare, named=named, factor=number is not None, brackets=brackets)


def kind_of(cell: str, column: str) -> Kind:
    """Return what a cell is in a row that may be one of units; column: the name over which it stands, of any kind."""
    said = _said(cell)
    if not said.word:
        return Kind.LABEL if said.label else Kind.EMPTY
    quantity = QUANTITIES.get(column)
    if quantity is not None and said.word in quantity.own | quantity.others:
        letter = len(said.word) == 1 and said.word.isalpha()
        unsure = said.factor or letter or said.word in WORDS_TOO | SIGNALS
        return Kind.FITS if unsure else Kind.SURE
    # a unit with the name of what it is of says nothing of another column: that is text
    if said.word in KNOWN and not said.named:
        return Kind.UNIT
    return Kind.BRACKETS if said.brackets else Kind.WORD


def contradicts(cell: str, column: str) -> bool:
    """Whether a cell in a row of units says anything but the unit that the name of its column has."""
    said, quantity = _said(cell), QUANTITIES.get(column)
    return quantity is not None and said.word != "" and (said.factor or said.word not in quantity.own)


def same_unit(one: str, other: str, column: str) -> bool:
    """Whether two cells say the same unit for a column; one that says none goes with any other."""
    if not _said(one).word or not _said(other).word:
        return True
    right = not contradicts(one, column) and not contradicts(other, column)
    return right or _plain(one) == _plain(other)
