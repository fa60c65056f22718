"""Step `io`: which input changes when somebody presses the emergency stop, opens the guard and the like.

Every bit of the block is watched, not those alone that the profile names: so a contact that is wired to another input,
or that is read the wrong way round, is found and told by its place.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

from definitions.profiles.modbus import COIL_TABLES, ModbusProfile, ReadField
from drivers.modbus.device import COUNTERS
from recipes.compiler.jog import ENABLING_DEVICE
from station.commissioning.on_wires import ByHand, OnWires, pause
from station.commissioning.registers import places_of, words_in
from station.documents.commissioning import Figure, Finding

LOOK_EVERY_S = 0.02
STEADY_LOOKS = 5
"""Looks in a row that show the same before a change counts: contacts bounce."""

BITS = 16


class Task(NamedTuple):
    """What a person is asked to do, and what the contact's field is to read after it.

    if_there: only where the profile has the field.
    """

    ask: str
    field: str
    after: int
    if_there: bool = False


TASKS = (
    Task("Press the emergency stop", "estop_released", 0),
    Task("Release the emergency stop", "estop_released", 1),
    Task("Open the guard", "guard_closed", 0),
    Task("Close the guard", "guard_closed", 1),
    Task("Press the enabling device to its middle position, and hold it", ENABLING_DEVICE, 1, if_there=True),
    Task("Let the enabling device go", ENABLING_DEVICE, 0, if_there=True),
)
AT_REST = "Release the emergency stop and close the guard"
CLOSED_AT_REST = ("estop_released", "guard_closed")

Bit = tuple[int, int]
"""Register (offset in the block) and bit in it, 0 = least significant."""


class Seen(NamedTuple):
    """What a task has shown: the bits that changed, each with its new value; none when nothing did in time."""

    task: Task
    changed: dict[Bit, int]
    after_s: float


class Guided(NamedTuple):
    """What all tasks have shown."""

    seen: list[Seen]
    findings: tuple[Finding, ...]
    figures: tuple[Figure, ...]


def guide(bench: OnWires, seconds: float, say: Callable[[str], None]) -> Guided:
    """Ask for each task in turn and watch the inputs for at most `seconds` each; ends with the first that fails.

    Raises:
        DriverError: the remote I/O does not answer, or is another one.

    """
    by_hand = ByHand(bench.wires)
    profile = by_hand.devices["remote_io"].config.profile
    seen: list[Seen] = []
    findings: list[Finding] = []
    with by_hand.opened("remote_io"):
        if not _rests(by_hand, profile, seconds, say):
            what = f"{AT_REST}: {read_of(profile, by_hand.block('remote_io'))}; each has to read 1."
            cure = f"If they are, correct offset and bit of what reads 0 in profile {profile.profile.name}."
            return Guided([], (Finding(what=what, cure=cure),), ())
        watch = _Watch(by_hand, profile)
        names = {field.name for field in profile.read.fields}
        for task in TASKS:
            if task.if_there and task.field not in names:
                continue
            say(f"{task.ask}. You have {seconds:g} s.")
            begun = time.monotonic()
            changed = watch.change(seconds)
            one = Seen(task, changed, time.monotonic() - begun)
            seen.append(one)
            findings += judged(profile, one)
            places = ", ".join(place_of(profile, bit) for bit in changed) or "nothing"
            say(f"  seen: {places} changed")
            if findings:
                break
    figures = tuple(
        Figure(name=one.task.ask, value=", ".join(place_of(profile, bit) for bit in one.changed) or "nothing changed")
        for one in seen
    )
    return Guided(seen, tuple(findings), figures)


def _rests(by_hand: ByHand, profile: ModbusProfile, seconds: float, say: Callable[[str], None]) -> bool:
    """Wait until both contacts are closed, and ask for it when they are not."""
    until = time.monotonic() + seconds
    asked = False
    while not at_rest(profile, by_hand.block("remote_io")):
        if not asked:
            say(f"{AT_REST}. You have {seconds:g} s.")
            asked = True
        if time.monotonic() > until:
            return False
        pause(LOOK_EVERY_S)
    return True


class _Watch:
    """The bits of the block, without those of counters and measured values, which change by themselves."""

    def __init__(self, by_hand: ByHand, profile: ModbusProfile) -> None:
        self._by_hand = by_hand
        self._profile = profile
        lively = {
            word
            for field in profile.read.fields
            if field.bit is None and (field.scale is not None or field.name in COUNTERS)
            for word in places_of(field)
        }
        self._quiet = [word for word in range(profile.read.count) if word not in lively]
        self._state = self._steady(seconds=1.0) or self._look()

    def change(self, seconds: float) -> dict[Bit, int]:
        """Wait for a change that lasts; return the bits that are different then, none after the time."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            now = self._steady(seconds=LOOK_EVERY_S * STEADY_LOOKS * 2)
            if now is not None and now != self._state:
                before, self._state = self._state, now
                return dict(_differences(before, now))
            pause(LOOK_EVERY_S)
        return {}

    def _steady(self, seconds: float) -> dict[int, int] | None:
        """Return the registers when they were the same in some looks in a row."""
        until = time.monotonic() + seconds
        last, same = self._look(), 1
        while same < STEADY_LOOKS:
            if time.monotonic() > until:
                return None
            pause(LOOK_EVERY_S / 2)
            now = self._look()
            last, same = now, same + 1 if now == last else 1
        return last

    def _look(self) -> dict[int, int]:
        words = words_in(self._profile, self._by_hand.block("remote_io"))
        return {word: words[word] for word in self._quiet}


def _differences(before: dict[int, int], now: dict[int, int]) -> Iterator[tuple[Bit, int]]:
    for word, value in now.items():
        for bit in range(BITS):
            if (before[word] ^ value) >> bit & 1:
                yield (word, bit), value >> bit & 1


def judged(profile: ModbusProfile, seen: Seen) -> Iterator[Finding]:
    """Say what is wrong with a contact, by what a task has shown."""
    task, name = seen.task, profile.profile.name
    field = next(one for one in profile.read.fields if one.name == task.field)
    mine = [bit for bit in seen.changed if _is_of(field, bit)]
    if not seen.changed:
        cure = f"Check the wiring of this contact to the remote I/O, and table, address and count of profile {name}."
        yield Finding(what=f"{task.ask}: no input of the remote I/O changed.", cure=cure)
    elif not mine:
        places = ", ".join(place_of(profile, bit) for bit in seen.changed)
        word, bit = next(iter(seen.changed))
        there = _written(profile, word, bit)
        cure = (
            f"Wire this contact to {_place(profile, field.offset, field.bit)}, or write '{there}'"
            f" for {task.field} into profile {name}."
        )
        other = next((one for one in profile.read.fields if _is_of(one, (word, bit))), None)
        if other is not None:
            cure = (
                f"The two contacts look exchanged. Exchange their wires, or write '{there}' for {task.field} and"
                f" '{_written(profile, field.offset, field.bit)}' for {other.name} into profile {name}."
            )
        yield Finding(what=f"{task.ask}: input {places} changed; expected was {task.field} of the profile.", cure=cure)
    elif seen.changed[mine[0]] != task.after:
        what = f"{task.ask}: {task.field} became {1 - task.after}, {task.after} expected."
        cure = "Use the other contact of the switch: a wire that breaks must read as pressed, or as open."
        yield Finding(what=what, cure=cure)


def _written(profile: ModbusProfile, word: int, bit: int | None) -> str:
    """Return a place as it is written into a profile."""
    return f"offset: {word}" if profile.read.table in COIL_TABLES or bit is None else f"offset: {word}, bit: {bit}"


def _is_of(field: ReadField, bit: Bit) -> bool:
    return bit[0] == field.offset and field.bit in (None, bit[1])


def place_of(profile: ModbusProfile, bit: Bit) -> str:
    """Return a bit by the field that the profile has there, and by its place."""
    field = next((one for one in profile.read.fields if _is_of(one, bit)), None)
    place = _place(profile, *bit)
    return place if field is None else f"{field.name} ({place})"


def _place(profile: ModbusProfile, word: int, bit: int | None) -> str:
    address = profile.read.address + word
    if profile.read.table in COIL_TABLES:
        return f"{profile.read.table} {address}"
    return f"{profile.read.table} register {address}" + ("" if bit is None else f" bit {bit}")


def at_rest(profile: ModbusProfile, block: bytes) -> bool:
    """Tell whether both contacts are closed, by the profile."""
    fields = {field.name: field for field in profile.read.fields}
    return all(_value(profile, fields[name], block) for name in CLOSED_AT_REST)


def read_of(profile: ModbusProfile, block: bytes) -> str:
    """Return what both contacts of the safety chain read, and where."""
    fields = {field.name: field for field in profile.read.fields}
    contacts = [fields[name] for name in CLOSED_AT_REST]
    places = [_place(profile, field.offset, field.bit) for field in contacts]
    read = [_value(profile, field, block) for field in contacts]
    return ", ".join(
        f"{name} reads {value} ({place})" for name, value, place in zip(CLOSED_AT_REST, read, places, strict=True)
    )


def _value(profile: ModbusProfile, field: ReadField, block: bytes) -> int:
    word = words_in(profile, block)[field.offset]
    return word if field.bit is None else word >> field.bit & 1
