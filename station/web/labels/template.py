"""Templates of labels in ZPL: which fields they may have, what is refused of them, and how they are filled.

A field stands in braces within the data of a ZPL field, `^FH^FD{serial}^FS`. What it becomes is written as bytes of
UTF-8 in hexadecimal wherever ZPL could take it for something else, which is what `^FH` is for: no serial number and no
name of an operator is ever a command of the printer.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from typing import NamedTuple

from definitions.metrics import METRICS
from station.documents.manifest import Manifest
from station.documents.result import Result
from station.errors import StationError

FIELD = re.compile(r"\{([^{}]*)\}")
PLAIN = re.compile(r"[A-Za-z0-9 .,:;/()+*=%#'\"!?&@<>\[\]|$-]")
"""Characters that are written as they are; all others as bytes of UTF-8."""

IN_BAR_CODES = re.compile(r"[A-Za-z0-9 .:/+_-]+")
"""What a field may be in a bar code: nothing that one of its kinds takes for a change of its character set."""

BEFORE_CODE = re.compile(r"(?:[HQML][AM],|>[9:;])?")
"""What may stand in front of the text of a bar code: error correction of a QR code, subset of a Code 128."""

REFUSED = {
    "CC": "this command changes the character with which commands begin",
    "CD": "this command changes the character between values",
    "CT": "this command changes the character with which control commands begin",
    "DF": "this command stores the label in the printer",
    "XF": "this command prints a label that is stored in the printer",
    "JU": "this command changes the stored settings of the printer",
}
"""Commands that a template cannot have, and what they do."""

ONE_LABEL = re.compile(r"1?(,0?(,[01]?(,[YN]?(,[YN]?)?)?)?)?")
"""Values of `^PQ` that print one label: quantity, pause after, replicates, and whether to pause and to cut."""

_COMMAND = re.compile(r"\^([A-Z0-9@]{1,2})([^^]*)", re.DOTALL)
_HEX = re.compile(r"_(?![0-9A-Fa-f]{2})")


class LabelError(StationError):
    """A template that is refused, or a run of which no label can be made."""


class Source(NamedTuple):
    """What a label is made of: a sealed run, its result, the code of its certificate, and which copy it is."""

    manifest: Manifest
    result: Result
    code: str
    copy: int = 1

    @property
    def ended(self) -> datetime:
        """When the run ended, by the plant's time."""
        return datetime.fromisoformat(self.manifest.ended or self.manifest.started).astimezone()


class Field(NamedTuple):
    """One row: what stands in its place, and how it is had."""

    text: str
    of: Callable[[Source], str]


def _before(one: Source) -> str:
    return "; ".join(str(earlier) for earlier in one.manifest.before or ())


FIELDS: dict[str, Field] = {
    "serial": Field("serial number", lambda one: one.manifest.serial),
    "model": Field("model of the unit", lambda one: one.manifest.unit.model),
    "verdict": Field("PASS, FAIL or NOT DECIDABLE", lambda one: one.result.verdict),
    "attempt": Field("which attempt it was", lambda one: str(one.manifest.attempt)),
    "before": Field("what became of the attempts before, as 'attempt 1 FAIL Backlash'; nothing on the first", _before),
    "recipe": Field("name of the recipe", lambda one: one.manifest.recipe.name),
    "revision": Field("revision of the recipe", lambda one: str(one.manifest.recipe.revision)),
    "bench": Field("name of the bench", lambda one: one.manifest.bench.name),
    "operator": Field("who measured it", lambda one: one.manifest.operator or ""),
    "run": Field("id of the run", lambda one: one.manifest.id),
    "code": Field("code of the certificate: run and hash, as `verify` checks it", lambda one: one.code),
    "date": Field("day on which the run ended, as 2026-01-05", lambda one: f"{one.ended:%Y-%m-%d}"),
    "time": Field("time at which the run ended, as 08:00", lambda one: f"{one.ended:%H:%M}"),
    "copy": Field("'copy 2' and so on; nothing on the first", lambda one: f"copy {one.copy}" if one.copy > 1 else ""),
}
"""Fields of a template. The id of a metric is a field too: its value with its unit."""


@dataclass(frozen=True)
class _Part:
    """A piece of a template: a text as it stands, or the name of a field, and whether that is in a bar code."""

    text: str
    field: str = ""
    in_code: bool = False


@dataclass(frozen=True)
class Template:
    """A template that was checked. bar_codes: the texts of its bar codes, with their fields."""

    parts: tuple[_Part, ...]
    bar_codes: tuple[str, ...]

    def fill(self, source: Source) -> str:
        """Return the label of a run, in ZPL.

        Raises:
            LabelError: a field has no value, or one that a bar code cannot hold.

        """
        return "".join(one.text if not one.field else _written(one, value_of(one.field, source)) for one in self.parts)

    def holds(self, text: str) -> bool:
        """Say whether one of its bar codes is read as this text, with fields."""
        return any(one.endswith(text) and BEFORE_CODE.fullmatch(one[: -len(text)]) for one in self.bar_codes)


def value_of(name: str, source: Source) -> str:
    """Return what a field is for a run; LabelError where it has no value there."""
    if name in FIELDS:
        return FIELDS[name].of(source)
    metric = next((one for one in source.result.metrics if one.id == name), None)
    if metric is None or metric.value is None:
        raise LabelError(
            f"{{{name}}}: run {source.manifest.id} has no value of this metric. Remove this field from the template"
        )
    return f"{metric.value:.4g} {metric.unit}".strip()


def filled(text: str, source: Source) -> str:
    """Return a text with its fields filled, as a scanner reads it."""
    return FIELD.sub(lambda found: value_of(found[1], source), text)


def unknown_fields(text: str) -> list[str]:
    """Return the fields of a text that no label has."""
    return [name for name in FIELD.findall(text) if name not in FIELDS and name not in METRICS]


def parse(text: str, shown_as: str) -> Template:
    """Return a template from its ZPL.

    Raises:
        LabelError: it is not one label in ZPL, has a field that is none, or one where a value could become a command.

    """

    def refuse(why: str) -> LabelError:
        return LabelError(f"{shown_as}: {why}")

    if "~" in text:
        raise refuse("found '~'; allowed are commands that begin with '^'. Remove it")
    commands = list(_COMMAND.finditer(text))
    if text.count("^") != len(commands) or any(len(one[1]) == 1 for one in commands):
        raise refuse("found '^' without a command, or a command in small letters. Write commands in capitals")
    names = [one[1] for one in commands]
    if names[:1] != ["XA"] or names[-1:] != ["XZ"] or names.count("XA") != 1 or names.count("XZ") != 1:
        raise refuse("found no label, or several. A label template begins with ^XA and ends with ^XZ, once each")
    if text[: commands[0].start()].strip() or commands[-1][2].strip():
        raise refuse("found text before ^XA or after ^XZ. Remove it")
    for name in names:
        if name in REFUSED:
            raise refuse(f"found ^{name}: {REFUSED[name]}. Remove it")
    if any(one[1] == "PQ" and not ONE_LABEL.fullmatch("".join(one[2].split())) for one in commands):
        raise refuse("found ^PQ with more than one label; a unit gets one label. Remove ^PQ")
    if not any(one[1] == "CI" and one[2].strip() == "28" for one in commands):
        raise refuse("found no ^CI28, which makes the printer read UTF-8. Write it after ^XA")
    parts, codes = _parts(commands, refuse)
    return Template(tuple(parts), tuple(codes))


def _parts(commands: list[re.Match[str]], refuse: Callable[[str], LabelError]) -> tuple[list[_Part], list[str]]:
    parts: list[_Part] = []
    codes: list[str] = []
    of_field: list[str] = []  # commands since the last ^FS
    for command in commands:
        name, data = command[1], command[2]
        if name == "FS":
            of_field = []
        of_field.append(name)
        in_code = any(one.startswith("B") and one != "BY" for one in of_field)
        if name not in ("FD", "FV"):
            if FIELD.search(data):
                raise refuse(f"found {data.strip()[:40]!r} in ^{name}; a field in braces is allowed in ^FD only")
            parts.append(_Part(command[0]))
            continue
        if unknown := unknown_fields(data):
            allowed = ", ".join(FIELDS)
            raise refuse(f"found {{{unknown[0]}}}; allowed are {allowed}, and the id of a metric")
        if FIELD.search(data) and "FH" not in of_field:
            raise refuse(
                f"found {data.strip()[:40]!r} without ^FH before ^FD, so a value could be read as a command. Write ^FH "
                "before ^FD"
            )
        if "FH" in of_field and _HEX.search(FIELD.sub("", data)):
            raise refuse(f"found '_' in {data.strip()[:40]!r}. After ^FH, write _5F for it")
        if in_code:
            codes.append(data.rstrip("\r\n"))
        parts += _of_data(f"^{name}", data, in_code=in_code)
    if any(one[1] == "FH" and one[2].strip() for one in commands):
        raise refuse("found ^FH with another character than '_'. Write ^FH alone")
    return parts, codes


def _of_data(begin: str, data: str, *, in_code: bool) -> list[_Part]:
    parts, at = [_Part(begin)], 0
    for found in FIELD.finditer(data):
        parts += [_Part(data[at : found.start()]), _Part("", found[1], in_code)]
        at = found.end()
    return [*parts, _Part(data[at:])]


def _written(part: _Part, value: str) -> str:
    if part.in_code and not IN_BAR_CODES.fullmatch(value):
        allowed = "letters, digits, blank and . : / + _ -"
        raise LabelError(f"{{{part.field}}}: found {value[:60]!r}; allowed in a bar code: {allowed}")
    if not value.isprintable():
        raise LabelError(f"{{{part.field}}}: found {value[:60]!r}, which cannot be printed")
    return "".join(
        one if PLAIN.fullmatch(one) else "".join(f"_{byte:02X}" for byte in one.encode("utf-8")) for one in value
    )
