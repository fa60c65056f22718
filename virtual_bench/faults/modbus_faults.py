"""What faults make of Modbus TCP answers, one place for both: the virtual bench's own servers and the gateway.

A device's answer goes through `answer` as the bytes of one frame and comes out as pieces with their delays. Only bytes
are known here: no sockets, no clock, no library. Frames: transaction, protocol, length (2 bytes each), unit, function,
data (Modbus messaging on TCP/IP 1.0b).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from definitions.profiles.modbus import ModbusProfile, ReadField
from virtual_bench.faults.schedule import FaultSchedule

HEADER_BYTES = 7  # up to and with the unit
DATA_AT = 9  # of the registers in the answer to a read: after unit, function and byte count
REGISTER_TABLES = {3: "holding", 4: "input"}
"""Tables that are read by each function code for registers."""
BIT_READS = (1, 2)
EXCEPTION_BIT, DEVICE_FAILURE = 0x80, 4
SPLIT_S = 0.0015
WORD = 2


class Piece(NamedTuple):
    """Bytes that go out `delay_s` later."""

    delay_s: float
    data: bytes


class ModbusFaults:
    """Applies the active faults of a schedule to the answers of the bench's devices."""

    def __init__(self, schedule: FaultSchedule, registers: Mapping[str, ModbusProfile]) -> None:
        self._schedule = schedule
        self._registers = registers
        self._kept: dict[tuple[str, bytes], bytes] = {}  # answers of frozen devices and registers, by request
        self._reset: set[str] = set()

    def is_cut(self, device: str) -> bool:
        """Tell whether connections to a device are closed and stay so."""
        if self._schedule.value(f"modbus.{device}", "off") is None:
            return False
        self._schedule.seen(f"modbus.{device}")
        return True

    def takes_reset(self, device: str) -> bool:
        """Tell, once, that the connections to a device are to be reset."""
        if self._schedule.value(f"modbus.{device}", "reset") is None or device in self._reset:
            return False
        self._reset.add(device)
        self._schedule.seen(f"modbus.{device}")
        return True

    def in_place(self, device: str, request: bytes) -> list[Piece] | None:
        """Return what goes out for a request that never gets to its device; None when it does."""
        target = f"modbus.{device}"
        if not self._schedule.active:
            return None
        if self._schedule.value(target, "silence") is not None:
            self._schedule.seen(target)
            return []
        if self._schedule.value(target, "exception") is not None:
            self._schedule.seen(target)
            function = request[HEADER_BYTES] | EXCEPTION_BIT
            return [Piece(0.0, request[:4] + b"\x00\x03" + request[6:7] + bytes([function, DEVICE_FAILURE]))]
        return None

    def answer(self, device: str, request: bytes, response: bytes) -> list[Piece]:
        """Return what goes out in place of a response to a request, both complete frames; after its delays."""
        schedule, target = self._schedule, f"modbus.{device}"
        if not schedule.active:
            return [Piece(0.0, response)]
        active = {verb for on, verb in schedule.active if on == target}
        if active:
            schedule.seen(target)
        response = self._registers_changed(device, request, response, active)
        if "wrong_id" in active:
            response = ((response[0] << 8 | response[1]) + 0x1000 & 0xFFFF).to_bytes(2, "big") + response[2:]
        if "wrong_unit" in active:
            response = response[:6] + bytes([response[6] ^ 0x40]) + response[7:]
        delay_s = (schedule.value(target, "slow") or 0.0) * 1e-3
        if "jitter" in active:
            delay_s += (schedule.value(target, "jitter") or 0.0) * 1e-3 * schedule.dice.random()
        if "truncate" in active:
            return [Piece(delay_s, response[:-WORD])]
        if "split" in active:
            return [Piece(delay_s, response[:HEADER_BYTES]), Piece(delay_s + SPLIT_S, response[HEADER_BYTES:])]
        return [Piece(delay_s, response)]

    def _registers_changed(self, device: str, request: bytes, response: bytes, active: set[str]) -> bytes:
        """Return a response with its registers changed; answers that carry none stay as they are."""
        function = response[HEADER_BYTES]
        if function not in (*REGISTER_TABLES, *BIT_READS):
            return response
        key = (device, request[6:])
        if "freeze" in active:
            kept = self._kept.setdefault(key, response)
            return response[:2] + kept[2:]
        if function in BIT_READS:
            return response
        data = bytearray(response)
        if "garbage" in active:  # but for the first register: a device that is not itself is another fault
            data[DATA_AT + WORD :] = self._schedule.dice.randbytes(len(data) - DATA_AT - WORD)
        registers = self._registers.get(device)
        for block in () if registers is None else (registers.read, *registers.read_also):
            if block.table == REGISTER_TABLES[function] and request[8:10] == block.address.to_bytes(2, "big"):
                for row in block.fields:
                    self._change_register(device, row, data, swap="swap" in active)
        return bytes(data)

    def _change_register(self, device: str, row: ReadField, data: bytearray, *, swap: bool) -> None:
        first, size = DATA_AT + WORD * row.offset, WORD * (2 if row.type.endswith("32") else 1)
        if first + size > len(data):
            return
        if swap and size > WORD:
            data[first : first + size] = data[first + WORD : first + size] + data[first : first + WORD]
        name = f"modbus.{device}.{row.name}"
        if self._schedule.value(name, "freeze") is not None:
            kept = self._kept.setdefault((name, b""), bytes(data[first : first + size]))
            if kept != data[first : first + size]:
                self._schedule.seen(name)
            data[first : first + size] = kept
