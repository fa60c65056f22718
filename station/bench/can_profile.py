"""Profiles of CAN sensors as the drivers want them: from a YAML file, or from a DBC file as its maker gives it.

cantools reads DBC, here and nowhere else: the scan gets places of bits. Of a DBC file every signal is a field, by the
name `MESSAGE.SIGNAL`; a message counts when a channel names one of its signals.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from definitions.number_formats import SIZES
from definitions.profiles.can import CAN_BYTES, LAST_IDENTIFIER, CanField, CanFrame, CanFrameFile, CanProfile
from drivers.config import CanSensorConfig
from recipes import Problem, RecipeError, parse_document
from recipes.schema.channel_schema import CanSensor
from station.bench.files import File

if TYPE_CHECKING:
    from cantools.database.can import Message, Signal

DBC = ".dbc"
"""Ending of a profile that is a DBC file."""

WITH_NODE_ID = "only if the bench file gives this sensor a 'node_id'"


def can_sensor(file: File, sensor: CanSensor, named: Collection[str]) -> CanSensorConfig:
    """Return a sensor of a bench file by its profile; `named`: fields that channels name.

    Raises:
        RecipeError: the profile has problems, each with its place, or asks for what frames of a DBC file cannot give.

    """
    heartbeat_s, synchronous = sensor.heartbeat_s or 0.0, sensor.update_every_s is None
    if file.path.suffix.lower() == DBC:
        frames = tuple(_of_message(file.path, one, named) for one in _messages(file, named))
        return CanSensorConfig(sensor.name, sensor.node_id, frames, heartbeat_s=heartbeat_s, synchronous=synchronous)
    profile = parse_document(file.content, str(file.path), CanProfile)
    if sensor.node_id is None and (profile.identity or profile.startup):
        found = f"the section '{'identity' if profile.identity else 'startup'}'"
        raise _refused(file.path, found, WITH_NODE_ID, "Add 'node_id' to the bench file, or delete the section.")
    frames = tuple(_of_file(file.path, frame, sensor.node_id) for frame in profile.frames)
    return CanSensorConfig(
        sensor.name, sensor.node_id, frames, profile.identity, profile.startup, heartbeat_s, synchronous
    )


def _of_file(path: Path, frame: CanFrameFile, node_id: int | None) -> CanFrame:
    if frame.add_node_id and node_id is None:
        raise _refused(
            path,
            "the entry 'add_node_id'",
            WITH_NODE_ID,
            "Add 'node_id' to the bench file, or delete 'add_node_id'.",
        )
    identifier = frame.identifier + (node_id or 0) * frame.add_node_id
    if identifier > LAST_IDENTIFIER:
        raise _refused(
            path,
            f"CAN identifier 0x{identifier:X}",
            "up to 0x7FF",
            "Correct 'identifier' in this file, or 'node_id' in the bench file.",
        )
    fields = []
    for field in frame.fields:
        size = SIZES[field.type]
        last = field.offset + size
        kind = {"u": "unsigned", "i": "signed", "f": "float"}[field.type[0]]
        shift = 8 * (field.offset if frame.byte_order == "little" else frame.bytes - last)
        fields.append(CanField(field.name, shift, 8 * size, kind, frame.byte_order, field.scale, field.zero))  # type: ignore[arg-type]
    return CanFrame(identifier, frame.bytes, tuple(fields))


def _messages(file: File, named: Collection[str]) -> list[Message]:
    """Return the messages of a DBC file that have a named signal, in the file's order."""
    # Loaded where a bench has such a file: most have none.
    import cantools  # noqa: PLC0415
    from cantools.database.can import Database  # noqa: PLC0415

    try:
        found = cantools.database.load_string(file.content.decode("utf-8", "replace"), "dbc")
    except Exception as error:  # a bent file ends in whatever the parser stumbles over: KeyError, ValueError, its own
        text = " ".join(str(error).split())[:200]
        raise _refused(
            file.path, f"a file that is not a readable DBC file: {text}", "a DBC file", "Export the file again."
        ) from error
    assert isinstance(found, Database)  # noqa: S101 - of "dbc" it makes no other
    return [one for one in found.messages if any(_name(one, signal) in named for signal in one.signals)]


def _name(message: Message, signal: Signal) -> str:
    return f"{message.name}.{signal.name}"


def _of_message(path: Path, message: Message, named: Collection[str]) -> CanFrame:
    if message.is_extended_frame or message.length > CAN_BYTES:
        found = (
            f"message {message.name} with "
            f"{'29 bits of identifier' if message.is_extended_frame else f'{message.length} bytes'}"
        )
        raise _refused(
            path,
            found,
            "a CAN message with an 11-bit identifier and up to 8 bytes",
            "Set the device to send such messages.",
        )
    fields = []
    for signal in message.signals:
        name = _name(message, signal)
        multiplexed = signal.is_multiplexer or signal.multiplexer_ids
        if name in named and multiplexed:
            raise _refused(
                path,
                f"the multiplexed signal {name}",
                "a signal that is in every CAN message of its identifier",
                "Name another signal.",
            )
        if not multiplexed:
            fields.append(_of_signal(name, signal, message.length))
    return CanFrame(message.frame_id, message.length, tuple(fields))


def _of_signal(name: str, signal: Signal, size: int) -> CanField:
    """Return the place of a signal. Of a big-endian one DBC gives the highest bit, counted byte by byte."""
    if signal.byte_order == "little_endian":
        order, shift = "little", signal.start
    else:
        highest = 8 * (size - 1 - signal.start // 8) + signal.start % 8
        order, shift = "big", highest - signal.length + 1
    kind = "float" if signal.is_float else "signed" if signal.is_signed else "unsigned"
    scale, zero = float(signal.scale), float(signal.offset)
    return CanField(name, shift, signal.length, kind, order, scale, zero)  # type: ignore[arg-type]


def _refused(path: Path, found: str, allowed: str, hint: str) -> RecipeError:
    return RecipeError([Problem(str(path), 0, 0, "frames", found, allowed, hint)])
