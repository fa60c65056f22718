"""What the registers of a Modbus device mean: orders of bytes and words, bits, scales, and what does not fit."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

import pytest
from drivers_support import modbus_profile, raw_profile
from hypothesis import given
from hypothesis import strategies as st

from definitions.profiles.modbus import IdentityRegister, ModbusProfile
from drivers.modbus.registers import RegisterReader, RegisterWriter, identity_registers
from virtual_bench.devices.modbus_servers import encode


def profile(fields: list[dict[str, Any]], count: int, **options: str) -> ModbusProfile:
    return modbus_profile(
        {
            "profile": {"name": "test", "kind": "modbus"},
            "identity": {"table": "input", "address": 100, "type": "u16", "value": 0x1234},
            "read": {"table": "input", "address": 0, "count": count, "fields": fields},
            "write": {
                "table": "holding",
                "address": 0,
                "fields": [
                    {"name": "a", "offset": 0, "type": "i32", "scale": 0.5},
                    {"name": "b", "offset": 2, "type": "u16"},
                ],
            },
            **options,
        }
    )


def sent(*registers: int) -> bytes:
    return struct.pack(f">{len(registers)}H", *registers)


ORDERS_OF_BYTES = [("big", "big"), ("big", "little"), ("little", "big"), ("little", "little")]


@pytest.mark.parametrize(("byte_order", "word_order"), ORDERS_OF_BYTES)
@given(st.integers(-(2**31), 2**31 - 1), st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_every_order_of_bytes_and_words(byte_order: str, word_order: str, whole: int, real: float) -> None:
    fields = [
        {"name": "real", "offset": 2, "type": "f32"},
        {"name": "whole", "offset": 0, "type": "i32", "scale": 0.25},
    ]
    reader = RegisterReader(profile(fields, 4, byte_order=byte_order, word_order=word_order))
    registers = b""
    for data in (struct.pack(">i", whole), struct.pack(">f", real)):
        words = [data[:2], data[2:]]
        words = words[::-1] if word_order == "little" else words
        registers += b"".join(word if byte_order == "big" else word[::-1] for word in words)
    assert reader.values(registers) == [real, whole * 0.25]


@pytest.mark.parametrize(("byte_order", "word_order"), ORDERS_OF_BYTES)
@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, 0xFFFF))
def test_what_is_written_reads_back(byte_order: str, word_order: str, whole: int, word: int) -> None:
    fields = [{"name": "a", "offset": 0, "type": "i32", "scale": 0.5}, {"name": "b", "offset": 2, "type": "u16"}]
    model = profile(fields, 3, byte_order=byte_order, word_order=word_order)
    orders = {"a": whole * 0.5, "b": word}
    assert RegisterReader(model).values(sent(*RegisterWriter(model).registers(orders))) == [whole * 0.5, word]


def test_bits_gaps_and_scales() -> None:
    bits = [{"name": f"bit_{bit}", "offset": 1, "type": "u16", "bit": bit} for bit in (0, 1)]
    scaled = [{"name": f"scaled_{offset}", "offset": offset, "type": "i16", "scale": 0.1} for offset in (2, 4)]
    reader = RegisterReader(profile([*bits, *scaled, {"name": "whole", "offset": 5, "type": "u16"}], 6))
    assert reader.names == ("bit_0", "bit_1", "scaled_2", "scaled_4", "whole")
    assert reader.values(sent(0x4C49, 0b10, 0xFFFF, 99, 251, 7)) == [0, 1, -0.1, pytest.approx(25.1), 7]


@pytest.mark.parametrize("bits", [0x7FC00000, 0x7F800000, 0xFF800000])
def test_a_value_that_is_no_number_is_not_a_value(bits: int) -> None:
    reader = RegisterReader(profile([{"name": "real", "offset": 0, "type": "f32"}], 2))
    assert reader.values(sent(bits >> 16, bits & 0xFFFF)) is None


def test_an_order_that_does_not_fit_is_counted() -> None:
    writer = RegisterWriter(modbus_profile(raw_profile("virtual-brake")))
    assert writer.registers({"brake_on": 1, "brake_current_a": 2.5}) == [1, 2500]
    assert writer.clamped == 0
    assert writer.registers({"brake_on": 1, "brake_current_a": 70.0}) == [1, 0xFFFF]
    assert writer.registers({"brake_on": 1, "brake_current_a": -1.0}) == [1, 0]
    assert writer.clamped == 2


@pytest.mark.parametrize(("byte_order", "word_order"), ORDERS_OF_BYTES)
@given(
    st.fixed_dictionaries(
        {
            "torque_out_nm": st.floats(-500, 500, width=32),
            "angle_in_rad": st.floats(-100, 100, width=32),
            "sample_counter": st.integers(0, 2**32 - 1),
        }
    )
)
def test_the_virtual_device_and_the_driver_agree_on_every_order(
    byte_order: str, word_order: str, values: dict[str, float]
) -> None:
    fields = [
        {"name": "torque_out_nm", "offset": 0, "type": "f32", "scale": -1000.0, "zero": 12.5},
        {"name": "sample_counter", "offset": 2, "type": "u32"},
        {"name": "angle_in_rad", "offset": 4, "type": "i32", "scale": -1e-6, "zero": 0.25},
    ]
    model = profile(fields, 6, byte_order=byte_order, word_order=word_order)
    torque, counter, angle = RegisterReader(model).values(sent(*encode(model, values))) or []
    assert torque == pytest.approx(values["torque_out_nm"], abs=1e-4)
    assert counter == values["sample_counter"]
    assert angle == pytest.approx(values["angle_in_rad"], abs=1e-6)


IDENTITIES = [
    ({"type": "u16", "value": 0x4C41}, "big", "big", "4c41"),
    ({"type": "u16", "value": 0x4C41}, "little", "big", "414c"),
    ({"type": "u32", "value": 0x12345678}, "big", "big", "12345678"),
    ({"type": "u32", "value": 0x12345678}, "big", "little", "56781234"),
    ({"type": "text", "text": "TQ7"}, "big", "little", "54513700"),
    ({"type": "text", "text": "TQ7"}, "little", "big", "51540037"),
]


@pytest.mark.parametrize(("identity", "byte_order", "word_order", "registers"), IDENTITIES)
def test_an_identity_of_any_type(identity: dict[str, Any], byte_order: str, word_order: str, registers: str) -> None:
    fields = [{"name": "torque_out_nm", "offset": 2, "type": "f32"}]
    model = profile(fields, 4, byte_order=byte_order, word_order=word_order)
    raw = {"table": "input", "address": 0, **identity}
    model = replace(model, identity=IdentityRegister(**raw))
    assert model.identity is not None
    sent_identity = identity_registers(model.identity, byte_order, word_order)
    assert sent_identity.hex() == registers
    assert sent(*encode(model, {"torque_out_nm": 0.0})).startswith(sent_identity)
