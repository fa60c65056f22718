"""Writes the seeds of the corpus: small, valid inputs of every target, from which the fuzzer starts."""

from __future__ import annotations

import io
import struct
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[2])]

import numpy as np  # noqa: E402 - after the path of a script run by hand
import pyarrow as pa  # noqa: E402
import pyarrow.parquet as pq  # noqa: E402
from device_end import crc16  # noqa: E402
from nptdms import ChannelObject, TdmsWriter  # noqa: E402

from recipes import shipped_benches, shipped_recipes  # noqa: E402

NODE = 5
CSV = b"t_s,torque_in_nm,torque_out_nm,angle_in_arcmin,segment\n0,0.1,9,1,measure 1 1\n0.001,0.2,19,2,measure -1 1\n"


def _pieces(*pieces: bytes) -> bytes:
    return b"".join(bytes((len(piece),)) + piece for piece in pieces)


def _frame(flags: int, cob_id: int, data: bytes) -> bytes:
    return bytes((flags | len(data),)) + cob_id.to_bytes(2, "little") + data


def _reply(transaction: int, unit: int, pdu: bytes) -> bytes:
    return transaction.to_bytes(2, "big") + b"\0\0" + (len(pdu) + 1).to_bytes(2, "big") + bytes((unit,)) + pdu


def _rtu(unit: int, pdu: bytes) -> bytes:
    return bytes((unit,)) + pdu + crc16(bytes((unit,)) + pdu)


def _tables() -> dict[str, bytes]:
    t = np.array([0.0, 0.001, 0.002])
    buffer = io.BytesIO()
    pq.write_table(pa.table({"t_s": t, "torque_in_nm": t, "angle_in_rad": t}), buffer, compression="none")
    texts = io.BytesIO()
    written = {"t_s": t, "torque_in_nm": ["0.1", "0.2", "0.3"], "angle_in_rad": t, "segment": ["measure 1 1"] * 3}
    pq.write_table(pa.table(written), texts, compression="none")
    tdms = io.BytesIO()
    with TdmsWriter(tdms) as writer:
        writer.write_segment([ChannelObject("g", name, t) for name in ("t_s", "torque_in_nm", "angle_in_rad")])
    return {
        "trace_parquet/plain": buffer.getvalue(),
        "trace_parquet/texts": texts.getvalue(),
        "trace_tdms/plain": tdms.getvalue(),
    }


def seeds() -> dict[str, bytes]:
    """Return every seed by its place in the corpus."""
    status = struct.pack("<HbhB", 0x1637, 10, 123, 0)
    motion = struct.pack("<ii", -1000, 4000)
    words = struct.pack(">14H", 0x4C41, 0, 0, 7, 0, 1000, 0, 1, 0, 2, 0, 3, 0, 4)
    read = bytes((4, 28)) + words
    recipes = {name: path.read_bytes() for name, path in shipped_recipes().items()}
    benches = {name: path.read_bytes() for name, path in shipped_benches().items()}
    word = struct.Struct("<Q").pack
    return {
        "can_frames/status": _frame(0x80, 0x180 + NODE, status) + _frame(0x80, 0x280 + NODE, motion),
        "can_frames/heartbeat": _frame(0, 0x700 + NODE, b"\x05")
        + _frame(0x80, 0x080 + NODE, b"\x10\x23\x01" + bytes(5)),
        "can_frames/flags": _frame(0x10, 0x185, status) + _frame(0x20, 0x185, b"") + _frame(0x40, 0x1, b"\0"),
        "modbus_tcp/identity": b"\0" + _pieces(_reply(1, 1, b"\x04\x02\x4c\x41"), _reply(2, 1, read)),
        "modbus_tcp/values": b"\x01" + _pieces(b"", _reply(1, 1, bytes((16, 0, 0, 0, 2))), _reply(2, 1, read)),
        "modbus_tcp/exception": b"\x01" + _pieces(_reply(1, 1, b"\x84\x04"), _reply(2, 1, b"\x90\x01")),
        "modbus_rtu/identity": b"\0" + _pieces(_rtu(2, b"\x04\x02\x4c\x42")),
        "modbus_rtu/values": b"\x01"
        + _pieces(_rtu(2, bytes((16, 0, 0, 0, 2))), _rtu(2, b"\x04\x06\x4c\x42\0\1\x09\xc4")),
        "modbus_reply/values": read,
        "modbus_reply/exception": b"\x84\x02",
        **{f"recipe_file/{name}": recipes[name] for name in ("rv-40e-121-faults", "static-50nm")},
        **{f"bench_file/{name}": benches[name] for name in ("virtual", "example-socketcan")},
        "trace_csv/segments": CSV,
        "trace_csv/two_signs": CSV.replace(b"measure -1 1", b"measure --1 1"),
        "trace_csv/branches": CSV.replace(b"measure 1 1", b"forward").replace(b"measure -1 1", b"return"),
        **_tables(),
        "mailbox/start": word(1) + bytes(56) + word(0) + bytes(56) + word(1),
        "mailbox/full": word(16) + bytes(120) + b"".join(map(word, range(16))),
        "socketcand_client/frame": _pieces(b"< frame 185 1.5 37160A7B0000 >", b"< frame 705 2.0 05 >< error 1 2.0 >"),
        "socketcand_client/cut": _pieces(b"< frame 185 1.5 3716", b"0A7B0000 >", b"> <", b"< >"),
        "socketcand_server/negative": _pieces(b"< send -80 0 >", b"< send 80 -0 >", b"< send 205 1 -1 >"),
        "socketcand_server/send": _pieces(b"< send 205 4 f 0 a 0 >", b"< echo >", b"< send 80 0 >"),
    }


def main() -> None:
    """Write them; what a fuzzer has found beside them stays."""
    for place, data in seeds().items():
        path = HERE / "corpus" / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


if __name__ == "__main__":
    main()
