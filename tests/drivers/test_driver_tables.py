"""Number formats, PDO codec, emergency and abort texts, drive units."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from drivers_support import drive_config
from hypothesis import given
from hypothesis import strategies as st

from definitions.number_formats import LETTERS, RANGES, SIZES
from definitions.profiles.drive import ReceivePdo, TransmitPdo
from drivers.servo_drive.data_types import to_integer
from drivers.servo_drive.emcy import EMCY_CLASSES, EMCY_TEXTS, explain_emcy
from drivers.servo_drive.pdo import PdoCodec, rpdo_cob_id, tpdo_cob_id
from drivers.servo_drive.sdo import SDO_ABORTS, explain_abort
from drivers.servo_drive.units import drive_units

KNOWN_EMCY = (
    *(0x8110, 0x8120, 0x8130, 0x8140, 0x8210, 0x8220, 0x8250, 0x8611, 0x84F0, 0x84FF, 0x8311, 0x8331),
    *(0x7121, 0x7300, 0x4310, 0x3210, 0x3220, 0x5410, 0x2310, 0x2320),
)


def test_number_formats_are_total() -> None:
    assert set(LETTERS) == set(SIZES) == set(RANGES) | {"f32"}
    for name, (low, high) in RANGES.items():
        assert high - low == 2 ** (8 * SIZES[name]) - 1


@given(st.sampled_from(sorted(RANGES)), st.floats(allow_nan=True, allow_infinity=True))
def test_to_integer_always_fits_and_tells_when_it_had_to(name: str, value: float) -> None:
    low, high = RANGES[name]
    number, clamped = to_integer(value, name)
    assert low <= number <= high
    if clamped:
        assert not low <= value <= high
    else:
        assert abs(number - value) <= 0.5


@given(st.integers(0, 0xFFFF), st.integers(-128, 127), st.integers(-0x8000, 0x7FFF))
def test_set_point_pdo_round_trip(word: int, mode: int, torque: int) -> None:
    codec = PdoCodec(drive_config().profile.receive_pdos[0].objects)
    assert codec.unpack(codec.pack(word, mode, torque)) == (word, mode, torque)


def test_set_point_pdo_on_the_wire() -> None:
    codec = PdoCodec(drive_config().profile.receive_pdos[0].objects)
    assert codec.pack(0x000F, 10, -300) == bytes.fromhex("0f 00 0a d4 fe")


def test_cob_ids_of_the_predefined_connection_set() -> None:
    receive = ReceivePdo(number=1, transmission_type=1, objects=(), timeout=False)
    transmit = TransmitPdo(number=1, transmission_type=1, objects=())
    assert [rpdo_cob_id(replace(receive, number=n), 5) for n in range(1, 5)] == [0x205, 0x305, 0x405, 0x505]
    assert [tpdo_cob_id(replace(transmit, number=n), 5) for n in range(1, 5)] == [0x185, 0x285, 0x385, 0x485]
    assert rpdo_cob_id(replace(receive, number=5, cob_id=0x225), 5) == 0x225
    assert tpdo_cob_id(replace(transmit, number=5, cob_id=0x1A5), 5) == 0x1A5


def test_units_at_the_loaded_shaft() -> None:
    units = drive_units(drive_config(gear_ratio=2.0))
    # 1000 counts are rated torque at the motor, twice that behind a gear of 2
    assert 1000 * units.torque_nm_per_count == pytest.approx(10.0)
    assert 1_048_576 * units.angle_rad_per_count == pytest.approx(math.pi)
    assert 166_886.0536 * units.velocity_rad_s_per_count == pytest.approx(0.5)


def test_units_conserve_power() -> None:
    direct, geared = drive_units(drive_config(gear_ratio=1.0)), drive_units(drive_config(gear_ratio=7.0))
    assert direct.torque_nm_per_count * direct.velocity_rad_s_per_count == pytest.approx(
        geared.torque_nm_per_count * geared.velocity_rad_s_per_count
    )


@pytest.mark.parametrize("code", KNOWN_EMCY)
def test_known_emergencies_have_their_own_text(code: int) -> None:
    assert explain_emcy(code) is EMCY_TEXTS[code]


def test_every_emergency_code_is_explained() -> None:
    for code in range(0x10000):
        text = explain_emcy(code)
        assert text.cause
        assert text.next_action
    assert explain_emcy(0x84AA) is EMCY_CLASSES[0x8400]
    assert explain_emcy(0x8AAA) is EMCY_CLASSES[0x8000]
    assert explain_emcy(0xFF13) is EMCY_CLASSES[0xFF00]
    assert explain_emcy(0xB000).cause == "unknown emergency code"
    assert explain_emcy(0x0000).next_action == "none"


def test_texts_fit_a_screen_and_end_without_full_stop() -> None:
    for text in (*EMCY_TEXTS.values(), *EMCY_CLASSES.values(), *SDO_ABORTS.values()):
        for part in text:
            assert 0 < len(part) <= 90
            assert not part.endswith(".")


def test_abort_codes() -> None:
    assert explain_abort(0x0609_0031).next_action == "lower the value in the bench file"
    assert "manual" in explain_abort(0x1234_5678).next_action
