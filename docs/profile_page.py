"""The page of every option of a device's profile, read off the classes that a profile file becomes."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from definitions.number_formats import Limits
from definitions.profiles.can import CanProfile
from definitions.profiles.drive import OPTIONAL_OBJECTS, RECEIVE_OBJECTS, TRANSMIT_OBJECTS, DriveProfile
from definitions.profiles.modbus import ModbusProfile
from docs.markdown import NOTE, table
from drivers.modbus.part_fields import BRAKE_FIELDS, OF_ANY_PART, PART_FIELDS, READ_FIELDS

KINDS: dict[str, tuple[type, str]] = {
    "A servo drive: `kind: cia402-drive`": (DriveProfile, "virtual-drive.yaml"),
    "A Modbus device: `kind: modbus`": (ModbusProfile, "virtual-amplifier.yaml"),
    "A sensor on CAN: `kind: can`": (CanProfile, "can-torque.yaml"),
}
"""What a profile may be, with the class that its file becomes and a shipped one to start from."""

FOLDER = "../drivers/profiles"
PLAIN = {int: "whole number", float: "number", str: "text", bool: "`true` or `false`"}
WORDS = {
    "ge": "from",
    "gt": "above",
    "le": "up to",
    "lt": "below",
    "min_length": "at least",
    "max_length": "and at most",
}
HEXADECIMAL_FROM = 0x100

ABOUT = """
A profile is a YAML file that says what a device is and where its values stand. It lies beside the bench file, in
`profiles/` beside it, or is a shipped one. `lostmotion profile from-eds FILE` drafts that of a drive; the others are
copies of a shipped one with the registers of your device, from its manual. `lostmotion check RECIPE --bench FILE` tells
each mistake with its line; `lostmotion bench probe` compares the profile with the device itself. A sensor on CAN may
have its maker's DBC file instead.
"""


def profile_options() -> str:
    """Return the page: each kind of profile with its sections, and the names that a field may have."""
    text = "# Every option of a device's profile\n\n" + NOTE + ABOUT
    shown: dict[type, str] = {}
    for title, (model, shipped) in KINDS.items():
        text += f"\n## {title}\n\n{_about(model)} Example: [{shipped}]({FOLDER}/{shipped}).\n\n{_options(model)}"
        for section, where in sections(model):
            if section in shown:
                same = shown[section]
                text += "" if same == where else f"\n### {where}\n\nAs [{same}](#{_anchor(same)}).\n"
                continue
            shown[section] = where
            text += f"\n### {where}\n\n{_about(section)}\n\n{_options(section)}"
        text += "".join(_names(model))
    return text


def sections(model: type, where: str = "") -> Iterator[tuple[type, str]]:
    """Yield the sections in a profile with the keys that lead to each, its own before those in it."""
    for name, hint in get_type_hints(model).items():
        for kind in dict.fromkeys(_kinds(hint)):
            if isinstance(kind, type) and is_dataclass(kind):
                each = " (each)" if "tuple" in str(hint) else ""
                yield kind, f"{where}{name}{each}"
                yield from sections(kind, f"{where}{name}: ")


def _about(model: type) -> str:
    return " ".join((inspect.getdoc(model) or "").split())


def _anchor(title: str) -> str:
    return "".join(sign for sign in title.lower().replace(" ", "-") if sign.isalnum() or sign in "-_")


def _names(model: type) -> Iterator[str]:
    """Yield the tables of names that stand in a profile of this kind."""
    if model is DriveProfile:
        for key, known in (("receive_pdos", RECEIVE_OBJECTS), ("transmit_pdos", TRANSMIT_OBJECTS)):
            rows = ((f"`{name}`", kind, "" if name in OPTIONAL_OBJECTS else "required") for name, kind in known.items())
            yield f"\n### Names in {key}\n\n" + table(("name", "type", ""), rows)
    if model is ModbusProfile:
        rows = ((f"`{part}`", *map(_listed, _fields_of(part))) for part in PART_FIELDS)
        yield (
            "\n### Names of fields\n\nThe amplifier needs the channels that the bench has sensors for. A brake needs one "
            "each way. Fields of a device that `channels` name are called as you like.\n\n"
            + table(("part", "needs", "may have", "is written"), rows)
        )


def _fields_of(part: str) -> tuple[Iterable[str], Iterable[str], Iterable[str]]:
    """Return what the profile of a part needs to deliver, may deliver besides, and is written."""
    needs = PART_FIELDS[part]
    may = [name for name in (*READ_FIELDS[part], *OF_ANY_PART) if name not in needs]
    return needs, may, sorted(BRAKE_FIELDS) if part == "brake" else ()


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _kinds(hint: Any) -> Iterator[Any]:
    """Yield what a type is made of, without its annotations."""
    if get_origin(hint) in (Annotated, Union, UnionType, tuple):
        for part in get_args(hint)[:1] if get_origin(hint) is Annotated else get_args(hint):
            yield from _kinds(part)
    elif hint not in (type(None), Ellipsis):
        yield hint


def _limits(hint: Any) -> Limits | None:
    """The limits of an option, wherever in its type they stand; of a list they are those of its length."""
    found = [part for part in get_args(hint) if isinstance(part, Limits)] if get_origin(hint) is Annotated else []
    inner = (_limits(part) for part in get_args(hint) if get_origin(hint) in (Annotated, Union, UnionType))
    return next((one for one in (*found, *inner) if one is not None), None)


def _number(value: float) -> str:
    return f"0x{int(value):X}" if value >= HEXADECIMAL_FROM and value == int(value) else f"{value:g}"


def _allowed(hint: Any) -> str:
    """What an option takes, in words."""
    kinds = list(_kinds(hint))
    choices = [str(value) for kind in kinds if get_origin(kind) is Literal for value in get_args(kind)]
    limits = _limits(hint)
    bounds = {} if limits is None else {key: getattr(limits, key) for key in WORDS if getattr(limits, key) is not None}
    words = " ".join(f"{WORDS[key]} {_number(value)}" for key, value in bounds.items())
    if choices:
        return " or ".join(f"`{choice}`" for choice in choices)
    if is_dataclass(kinds[0]):
        return f"list of {words}, see below" if words else "list or section, see below"
    of_length = " of " if kinds[0] is str and words else " "
    return f"{PLAIN[kinds[0]]}{of_length}{words}{' signs' if of_length.strip() else ''}".strip()


def _default(field: Field[Any]) -> str:
    if field.default is MISSING:
        return "required"
    if field.default in (None, ()) or is_dataclass(field.default):
        return ""
    shown = str(field.default).lower() if isinstance(field.default, bool) else field.default
    return f"default `{shown}`"


def _options(model: type) -> str:
    hints = get_type_hints(model, include_extras=True)
    return table(
        ("option", "what it takes", ""),
        ((f"`{field.name}`", _allowed(hints[field.name]), _default(field)) for field in fields(model)),
    )
