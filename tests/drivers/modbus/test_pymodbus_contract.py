"""What this project relies on in the pinned pymodbus: names, signatures, frames. Minor versions break these."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pymodbus
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse
from pymodbus.pdu.register_message import ReadInputRegistersRequest, WriteMultipleRegistersRequest

from drivers.modbus.frames import ModbusFrames, Outcome, Reply, Request, check_sum_fits, reply_to

DRIVERS = Path(__file__).parents[3] / "drivers"


def test_minor_version() -> None:
    assert pymodbus.__version__.startswith("3.16.")


def test_signatures() -> None:
    assert list(inspect.signature(FramerSocket.handleFrame).parameters) == ["self", "data", "exp_devid", "exp_tid"]
    assert list(inspect.signature(FramerSocket.buildFrame).parameters) == ["self", "message"]
    for request in (ReadInputRegistersRequest, WriteMultipleRegistersRequest):
        assert {"dev_id", "transaction_id", "address", "count", "registers"} <= set(
            inspect.signature(request).parameters
        )


@pytest.mark.parametrize(("framer", "cut"), [(FramerSocket, 6), (FramerRTU, 0)])
def test_frames(framer: type[FramerSocket | FramerRTU], cut: int) -> None:
    pdu = ReadInputRegistersRequest(dev_id=1, transaction_id=0, address=0x102, count=14)
    frame = framer(DecodePDU(is_server=False)).buildFrame(pdu)
    assert frame[cut : cut + 6] == bytes.fromhex("01 04 0102 000e")
    assert framer is FramerRTU or frame[:6] == bytes.fromhex("0000 0000 0006")


def test_decoded_reply() -> None:
    framer = FramerSocket(DecodePDU(is_server=False))
    used, pdu = framer.handleFrame(bytes.fromhex("0007 0000 0005 01 04 02 1234"), 0, 0)
    assert pdu is not None
    assert (used, pdu.dev_id, pdu.transaction_id, pdu.function_code, list(pdu.registers)) == (11, 1, 7, 4, [0x1234])
    _, pdu = framer.handleFrame(bytes.fromhex("0007 0000 0003 01 84 02"), 0, 0)
    assert isinstance(pdu, ExceptionResponse)
    assert (pdu.function_code, pdu.exception_code) == (0x84, 2)
    with pytest.raises(ModbusException):
        framer.handleFrame(bytes.fromhex("0007 0000 0003 01 63 02"), 0, 0)


def test_one_module_uses_it() -> None:
    users = set()
    for path in DRIVERS.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if any(name.split(".")[0] == "pymodbus" for name in names):
                users.add(str(path.relative_to(DRIVERS)))
    assert users == {"modbus/frames.py"}


FRAMES = ModbusFrames(rtu=False)
READ, WRITE = FRAMES.read_request(1, "input", 0x102, 3), FRAMES.write_request(1, "holding", 0x10, [1, 2500])
RIGHT = {READ: bytes.fromhex("01 04 06 1234 0000 ffff"), WRITE: bytes.fromhex("01 10 0010 0002")}


def by_pymodbus(request: Request, body: bytes) -> Reply:
    """The reply as pymodbus' framer and PDUs understand it."""
    frame = b"\0\1\0\0" + len(body).to_bytes(2, "big") + body
    try:
        used, pdu = FramerSocket(DecodePDU(is_server=False)).handleFrame(frame, 0, 0)
    except (ModbusException, ValueError, IndexError, KeyError, TypeError):
        return Reply(Outcome.GARBAGE)
    if pdu is None or used != len(frame) or pdu.dev_id != request.unit_id:
        return Reply(Outcome.GARBAGE)
    if pdu.function_code == request.function | 0x80:
        return Reply(Outcome.EXCEPTION, b"", pdu.exception_code)
    if pdu.function_code != request.function or len(body) != request.reply_bytes:
        return Reply(Outcome.GARBAGE)
    if request is READ:
        words = list(pdu.registers)
        data = b"".join(word.to_bytes(2, "big") for word in words)
        return Reply(Outcome.DATA, data) if len(words) == 3 else Reply(Outcome.GARBAGE)
    return Reply(Outcome.DATA if (pdu.address, pdu.count) == (0x10, 2) else Outcome.GARBAGE)


@given(st.data())
def test_a_reply_compared_by_its_bytes_is_what_pymodbus_decodes(data: st.DataObject) -> None:
    request = data.draw(st.sampled_from([READ, WRITE]))
    body = bytearray(RIGHT[request])
    for _ in range(data.draw(st.integers(0, 2))):
        at = data.draw(st.integers(0, len(body) - 1))
        body[at] = data.draw(st.sampled_from([0, 1, 2, 3, 4, 5, 6, 7, 8, 0x10, 0x83, 0x84, 0x90]))
    cut = data.draw(st.integers(3, len(body)))
    whole = bytes(body[:cut]) + data.draw(st.binary(max_size=2))
    assert reply_to(request, whole) == by_pymodbus(request, whole)


def test_the_right_replies_are_data_and_exceptions_tell_their_code() -> None:
    assert reply_to(READ, RIGHT[READ]) == Reply(Outcome.DATA, bytes.fromhex("1234 0000 ffff"))
    assert reply_to(WRITE, RIGHT[WRITE]) == Reply(Outcome.DATA)
    assert reply_to(WRITE, bytes.fromhex("01 90 06")) == Reply(Outcome.EXCEPTION, b"", 6)


def test_the_check_sum_is_pymodbus_own() -> None:
    frame = ModbusFrames(rtu=True).read_request(1, "input", 0, 14).frame
    assert check_sum_fits(frame)
    assert not check_sum_fits(frame[:-1] + bytes((frame[-1] ^ 1,)))
