"""An AQDEF file read back and held against the table of its fields: what is not as it says is named with its line."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime

from station.errors import StationError
from station.quality.dfq.fields import (
    ENCODING,
    END_OF_LINE,
    EVENTS,
    FIELDS,
    IN_A_VALUE,
    LIMITS,
    MOMENT,
    NATURAL,
    NEXT_CHARACTERISTIC,
    NEXT_ENTRY,
    SPECIFIED,
    VALID,
    Field,
)

CODED = re.compile(r"(K\d{4})(?:/(\d{1,5}))? (.*)", re.DOTALL)
WHOLE = re.compile(r"\d+")
NUMBER = re.compile(r"-?\d+(\.\d+)?([eE][+-]?\d+)?")
MOST_SHOWN = 5
SERIAL = "K0014"
COUNT = "K0100"


class DfqError(StationError):
    """A file is not as the table of fields says. problems: all of them, each with its line or its run."""

    def __init__(self, problems: list[str], hint: str = "") -> None:
        shown = problems[:MOST_SHOWN]
        more = [f"and {len(problems) - MOST_SHOWN} more"] if len(problems) > MOST_SHOWN else []
        super().__init__("not a file as AQDEF has it: " + "; ".join([*shown, *more]) + (f". {hint}" if hint else ""))
        self.problems = problems


@dataclass(frozen=True)
class DfqValue:
    """One value of a run: None where the attribute says that there is none."""

    value: float | None
    attribute: int
    moment: datetime
    events: tuple[int, ...]


@dataclass(frozen=True)
class DfqRow:
    """The values of a run, one of each characteristic, and its serial number."""

    serial: str
    values: tuple[DfqValue, ...]


@dataclass
class DfqFile:
    """A file: the fields of its part, of each characteristic, and its rows."""

    part: dict[str, str] = field(default_factory=dict)
    characteristics: list[dict[str, str]] = field(default_factory=list)
    rows: list[DfqRow] = field(default_factory=list)


def serial_problems(serial: str) -> list[str]:
    """Return why a file cannot hold a serial number; nothing where it can."""
    try:
        serial.encode(ENCODING)
    except UnicodeEncodeError as error:
        return [f"{SERIAL}: the sign '{serial[error.start]}' cannot be written in {ENCODING}"]
    return _form_problems(SERIAL, FIELDS[SERIAL], serial)


def checked_dfq(content: bytes) -> DfqFile:
    """Return what a file says; DfqError with everything that is not as the table of fields says."""
    reader = _Reader()
    reader.read(content)
    if reader.problems:
        raise DfqError(reader.problems)
    return reader.file


class _Reader:
    """Reads a file line by line, and goes on behind a problem, so that all of them are told at once."""

    def __init__(self) -> None:
        self.file = DfqFile()
        self.problems: list[str] = []
        self._count = 0
        self._open: tuple[DfqValue, ...] | None = None
        self._line = 0

    def read(self, content: bytes) -> None:
        """Read all of it."""
        try:
            text = content.decode(ENCODING)
        except UnicodeDecodeError as error:
            self._wrong(f"byte {error.start + 1} is no character of {ENCODING}")
            return
        if not text.endswith(END_OF_LINE):
            self._wrong("the last line does not end: the file was cut short")
        lines = text.split(END_OF_LINE)
        for number, line in enumerate(lines[:-1] if lines[-1] == "" else lines, start=1):
            self._line = number
            self._one(line)
        self._line = len(lines)
        self._whole()

    def _one(self, line: str) -> None:
        if "\r" in line or "\n" in line:
            self._wrong("lines end by carriage return and line feed, and by nothing else")
        elif not line:
            self._wrong("an empty line")
        elif line[0] == "K":
            self._coded(line)
        else:
            self._values(line)

    def _coded(self, line: str) -> None:
        match = CODED.fullmatch(line)
        if match is None:
            self._wrong(f"'{line[:20]}': expected a key such as K2001/1, a blank and its value")
            return
        key, index, value = match[1], match[2], match[3]
        row = FIELDS.get(key)
        if row is None or key in IN_A_VALUE:
            self._wrong(f"{key}: {'stands in a line of values' if row else 'is no field of the table'}")
            return
        for problem in _form_problems(key, row, value):
            self._wrong(problem)
        if row.level == "value":
            self._serial(index, value)
            return
        if self.file.rows or self._open is not None:
            self._wrong(f"{key}: stands behind the first line of values")
        into = self._into(key, row, index)
        if into is None:
            return
        if key in into:
            self._wrong(f"{key}: stands twice")
        into[key] = value

    def _into(self, key: str, row: Field, index: str | None) -> dict[str, str] | None:
        """Return where a field belongs; None where its index is wrong, which is said."""
        if row.level == "file":
            if index is not None or self._line != 1:
                self._wrong(f"{key}: stands once, in the first line, without an index")
            return self.file.part
        if self._line == 1:
            self._wrong(f"{key}: the first line is {COUNT}")
        if row.level == "part":
            if index not in (None, "1"):
                self._wrong(f"{key}/{index}: there is one part, 1")
            return self.file.part
        self._set_up()
        if index is None or not 1 <= int(index) <= len(self.file.characteristics):
            self._wrong(f"{key}/{index}: expected a characteristic from 1 to {len(self.file.characteristics)}")
            return None
        return self.file.characteristics[int(index) - 1]

    def _set_up(self) -> None:
        if not self._count:
            text = self.file.part.get(COUNT, "")
            self._count = int(text) if WHOLE.fullmatch(text) and len(text) <= FIELDS[COUNT].length else 0
            self.file.characteristics = [{} for _ in range(self._count)]

    def _values(self, line: str) -> None:
        if self._open is not None:
            self._wrong(f"values without a {SERIAL} between them and those before")
        self._set_up()
        parts = line.split(NEXT_CHARACTERISTIC)
        if len(parts) != self._count:
            self._wrong(f"{len(parts)} values for {self._count} characteristics")
        found = [self._value(number, part) for number, part in enumerate(parts, start=1)]
        self._open = tuple(one for one in found if one is not None)

    def _value(self, number: int, part: str) -> DfqValue | None:
        entries = part.split(NEXT_ENTRY)
        if len(entries) != len(IN_A_VALUE):
            self._wrong(f"value {number}: {len(entries)} entries; expected {len(IN_A_VALUE)}: {', '.join(IN_A_VALUE)}")
            return None
        given = dict(zip(IN_A_VALUE, entries, strict=True))
        problems = [
            f"value {number}: {problem}"
            for key, value in given.items()
            if value or FIELDS[key].required
            for problem in _form_problems(key, FIELDS[key], value)
        ]
        for problem in problems:
            self._wrong(problem)
        if problems:
            return None
        attribute = int(given["K0002"])
        value = float(given["K0001"]) if attribute == VALID else None
        events = tuple(int(one) for one in given["K0005"].split(",") if one)
        return DfqValue(value, attribute, datetime.strptime(given["K0004"], MOMENT), events)  # noqa: DTZ007 - UTC by the table

    def _serial(self, index: str | None, value: str) -> None:
        if index != "0":
            self._wrong(f"{SERIAL}: is of all characteristics, which is index 0")
        if self._open is None:
            self._wrong(f"{SERIAL}: stands behind no values")
            return
        self.file.rows.append(DfqRow(value, self._open))
        self._open = None

    def _whole(self) -> None:
        """Check what only the whole file shows."""
        self._set_up()
        if self._open is not None:
            self._wrong(f"the last values have no {SERIAL}")
        if not self.file.rows:
            self._wrong("there are no values")
        part = {key for key, row in FIELDS.items() if row.required and row.level in ("file", "part")}
        self._missing(part - set(self.file.part), "")
        each = {key for key, row in FIELDS.items() if row.required and row.level == "characteristic"}
        for number, one in enumerate(self.file.characteristics, start=1):
            self._missing(each - set(one), f"/{number}")
            self._limits(number, one)
        numbers = [one.get("K2001", "") for one in self.file.characteristics]
        if len(set(numbers)) < len(numbers):
            self._wrong("K2001: two characteristics have the same number")
        if self._count == 0:
            self._wrong(f"{COUNT}: expected 1 or more characteristics")

    def _limits(self, number: int, one: dict[str, str]) -> None:
        for limit, kind in LIMITS.items():
            if (limit in one) != (one.get(kind) in (str(SPECIFIED), str(NATURAL))):
                self._wrong(f"{limit}/{number}: a limit stands exactly where {kind} is {SPECIFIED} or {NATURAL}")
        kinds = {one.get(kind) for kind in LIMITS.values()}
        if str(NATURAL) in kinds and str(SPECIFIED) not in kinds:
            self._wrong(f"K2120/{number}: a natural limit stands only opposite a specified one")
        low, high = (one.get(limit, "") for limit in LIMITS)
        if NUMBER.fullmatch(low) and NUMBER.fullmatch(high) and float(low) > float(high):
            self._wrong(f"K2110/{number}: {low} is above the upper limit {high}")

    def _missing(self, keys: Iterable[str], where: str) -> None:
        for key in sorted(keys):
            self._wrong(f"{key}{where}: is missing ({FIELDS[key].meaning})")

    def _wrong(self, text: str) -> None:
        self.problems.append(f"line {self._line}: {text}")


def _form_problems(key: str, row: Field, value: str) -> list[str]:
    """Return what is wrong with a value by its field."""
    if not value or not value.strip():
        return [f"{key}: is empty"]
    if len(value) > row.length:
        return [f"{key}: {len(value)} characters; at most {row.length} ({row.meaning})"]
    if any(ord(sign) < ord(" ") for sign in value):
        return [f"{key}: has a control character"]
    return [] if _is_of(row, value) else [f"{key}: found '{value[:30]}'; expected {_words(row)}"]


def _is_of(row: Field, value: str) -> bool:
    if row.form == "whole number":
        return WHOLE.fullmatch(value) is not None and (not row.choices or int(value) in row.choices)
    if row.form == "number":
        return NUMBER.fullmatch(value) is not None and math.isfinite(float(value))
    if row.form == "moment":
        try:
            return datetime.strptime(value, MOMENT).strftime(MOMENT) == value  # noqa: DTZ007 - UTC by the table
        except ValueError:
            return False
    if row.form == "events":
        return all(WHOLE.fullmatch(one) is not None and int(one) in EVENTS for one in value.split(","))
    return True


def _words(row: Field) -> str:
    if row.choices:
        return " or ".join(str(one) for one in row.choices)
    if row.form == "moment":
        return "a date and time such as 31.01.2026/08:00:00"
    if row.form == "events":
        return f"numbers of quality events, from {min(EVENTS)} to {max(EVENTS)}, separated by commas"
    return f"a {row.form}, with a point for its decimals" if row.form == "number" else f"a {row.form}"
