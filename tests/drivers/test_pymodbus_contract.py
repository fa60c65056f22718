"""What this project relies on in the pinned pymodbus: names, signatures, frames. Minor versions break these."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pymodbus
import pytest
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse
from pymodbus.pdu.register_message import ReadInputRegistersRequest, WriteMultipleRegistersRequest

DRIVERS = Path(__file__).parents[2] / "drivers"


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
    for path in DRIVERS.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if any(name.split(".")[0] == "pymodbus" for name in names):
                users.add(path.name)
    assert users == {"modbus_frames.py"}
