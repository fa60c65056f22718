"""How far a bench is commissioned: its protocol, read and written here, against bench file and profiles as they are.

A step that passed is due again when an entry that its result depends on has changed since, and so is every step behind
it. Comments, layout and sections that no step depends on change nothing.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

from definitions.commissioning import CHANGED, STEPS, UNFINISHED, Step, concerns
from definitions.profiles.drive import DriveProfile, DriveProfileHeader
from recipes import Bench
from recipes.schema.bench_schema import PARTS
from station.atomic_file import write_atomic
from station.bench.assemble import drive_profile, modbus_profile
from station.bench.files import File, FileAt
from station.documents.commissioning import Protocol, StepDone
from station.documents.entries import plain
from station.documents.reading import read_document
from station.errors import StationError

ENDING = ".commissioning.json"
PROFILE = " profile"
WATCHDOGS = "watchdogs"

MOST_SHOWN = 3
"""Changed entries that a note names; `lostmotion bench status` names all."""

State = Literal["passed", "not passed", "due again", "to do"]


class Change(NamedTuple):
    """An entry of bench file or profiles that is not what it was when a step was done; '' where it is missing."""

    part: str
    was: str
    now: str


class Standing(NamedTuple):
    """How a step stands: what was done last, what has changed since, and which steps before it stand in its way."""

    step: Step
    state: State
    done: StepDone | None
    changes: tuple[Change, ...]
    waits_for: tuple[str, ...]


def protocol_path(bench_file: Path) -> Path:
    """Return the protocol of a bench file: beside it."""
    return bench_file.with_name(bench_file.stem + ENDING)


def read_protocol(bench_file: Path, bench: Bench) -> Protocol:
    """Return what was done on this bench; RecordError when the protocol is damaged."""
    path = protocol_path(bench_file)
    return read_document(Protocol, path) if path.exists() else Protocol(bench=bench.bench.name)


def add_to_protocol(bench_file: Path, bench: Bench, done: StepDone) -> None:
    """Put a step that was done behind the others; RecordError when the protocol is damaged or cannot be written."""
    protocol = read_protocol(bench_file, bench)
    whole = replace(protocol, steps=(*protocol.steps, done))
    write_atomic(protocol_path(bench_file), json.dumps(plain(whole), ensure_ascii=False, indent=1).encode() + b"\n")


LEFT_OUT = str(None)
"""Of an option that the file leaves out; a protocol from before there was such an option does not have it at all."""


def parts_of(bench: Bench, profiles: Mapping[str, File]) -> dict[str, str]:
    """Return every entry of a bench and of its profiles by its dotted name; `profiles` are their files by name.

    Raises:
        recipes.RecipeError: a profile has problems.

    """
    parts = dict(_leaves("", bench.model_dump(mode="json")))
    parts |= _leaves("drive" + PROFILE, asdict(drive_profile(profiles[bench.drive.profile])))
    for name, device in bench.modbus_devices.items():
        part = name + PROFILE if name in PARTS else f"devices{PROFILE}.{name}"
        parts |= _leaves(part, asdict(modbus_profile(profiles[device.profile])))
    for one in bench.can_devices:  # a profile or a DBC file: told apart as a whole
        parts[f"can_devices{PROFILE}.{one.name}"] = hashlib.sha256(profiles[one.profile].content).hexdigest()
    return parts


def _leaves(name: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _leaves(f"{name}.{key}".removeprefix("."), inner)
    elif isinstance(value, list | tuple):
        for place, inner in enumerate(value):
            key = inner.get("name", place) if isinstance(inner, Mapping) else place
            yield from _leaves(f"{name}[{key}]", inner)
    else:
        yield name, str(value)


def depended_on(step: Step, parts: Mapping[str, str]) -> dict[str, str]:
    """Return the entries that the result of a step depends on."""
    return {part: value for part, value in parts.items() if concerns(step, part)}


def standings(protocol: Protocol, parts: Mapping[str, str]) -> tuple[Standing, ...]:
    """Return how each step stands, in their order."""
    newest = {done.step: done for done in protocol.steps}
    stands: list[Standing] = []
    behind: list[str] = []
    for step in STEPS:
        done = newest.get(step.id)
        changes = () if done is None else changed_since(step, done, parts)
        state: State = "to do"
        if done is not None:
            state = "not passed" if not done.passed else "due again" if changes or behind else "passed"
        stands.append(Standing(step, state, done, changes, tuple(behind)))
        if state != "passed":
            behind.append(step.id)
    return tuple(stands)


def changed_since(step: Step, done: StepDone, parts: Mapping[str, str]) -> tuple[Change, ...]:
    """Return what of a step's entries has changed since it was done."""
    was, now = done.parts, depended_on(step, parts)
    names = [*was, *(name for name in now if name not in was)]
    changed = [name for name in names if was.get(name, LEFT_OUT) != now.get(name, LEFT_OUT)]
    return tuple(Change(name, was.get(name, ""), now.get(name, "")) for name in changed)


@cache
def _virtual_drive(path: Path) -> DriveProfileHeader:
    return drive_profile(FileAt(path)).profile


def is_virtual_drive(profile: DriveProfile, shipped: Path) -> bool:
    """Tell whether a profile is that of the virtual drive, by its identity, which every run checks in the drive.

    `shipped` is the file of the virtual drive's profile.
    """
    virtual = _virtual_drive(shipped)
    return (profile.profile.vendor_id, profile.profile.product_code) == (virtual.vendor_id, virtual.product_code)


def watchdogs_measured(bench_file: Path, bench: Bench, profiles: Mapping[str, File]) -> StepDone | None:
    """Return the measurement of the drive's watchdogs that passed and still holds; None where there is none.

    The steps before it do not matter here: what they prove, a run sees for itself.

    Raises:
        recipes.RecipeError, RecordError: a profile or the protocol is damaged.

    """
    step = next(step for step in STEPS if step.id == WATCHDOGS)
    done = next((one for one in reversed(read_protocol(bench_file, bench).steps) if one.step == WATCHDOGS), None)
    if done is None or not done.passed or changed_since(step, done, parts_of(bench, profiles)):
        return None
    return done


def commissioning_note(stands: tuple[Standing, ...]) -> str:
    """Return what a result says of a bench that somebody began to commission, and which is not as it then was.

    '' where every step holds, and where none was ever done: whether a bench has to be commissioned depends on its
    drive. It goes by the protocol alone, so a virtual bench that somebody practises on is told of too.
    """
    if not any(one.done for one in stands):
        return ""
    changed = {change.part: change for one in stands for change in one.changes}
    if changed:
        shown = [f"{part} {one.was or 'nothing'} → {one.now or 'nothing'}" for part, one in changed.items()]
        more = f" and {len(shown) - MOST_SHOWN} more" if len(shown) > MOST_SHOWN else ""
        what = f"{CHANGED}: {', '.join(shown[:MOST_SHOWN])}{more}"
    else:
        what = UNFINISHED
    due = [one.step.id for one in stands if one.state != "passed"]
    return f"{what}. Steps due: {', '.join(due)}. Run: lostmotion bench status" if due else ""


def refuse_before(step: Step, stands: tuple[Standing, ...], bench_file: Path) -> None:
    """Refuse a step while one before it has not passed, or is due again.

    Raises:
        StationError: it has not; which, and the command for it.

    """
    waits_for = next(one.waits_for for one in stands if one.step.id == step.id)
    if waits_for:
        states = {one.step.id: one.state for one in stands}
        told = ", ".join(f"{name} ({states[name]})" for name in waits_for)
        raise StationError(
            f"bench {step.id}: other steps of commissioning have to pass first: {told}. "
            f"Next: lostmotion bench {waits_for[0]} --bench {bench_file}"
        )
