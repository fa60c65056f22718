"""One fuzz target per input: each takes any bytes and raises only when the code behind it did what it must not.

`TARGETS` is the table that the tests, the corpus and the coverage-guided fuzzer share.
"""

from __future__ import annotations

import socket
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import can
from fuzz_bench import SCANS, all_of, no_orders, the_config, the_job
from socketcand_targets import socketcand_client, socketcand_server
from wire_rig import MemoryBus

from analysis.trace.errors import AnalysisError
from analysis.trace.trace_files import read_trace
from definitions.image import Command, Image
from drivers.can.bus import CanLink
from drivers.config import ModbusConfig
from drivers.modbus.device import ModbusDevice
from drivers.modbus.frames import Outcome
from drivers.modbus.line import ModbusLine
from drivers.servo_drive.drive import CanDrive
from recipes import RecipeError, check, parse_bench, parse_recipe
from recipes.compiler.compiler import compile_program
from station.records.ring.reader import RingReader
from station.records.ring.ring import MAILBOX_SLOTS, W_COMMANDS_WRITTEN, W_READ, W_SLOTS, create
from station.records.ring.writer import RingWriter
from station.records.samples.scan_record import BODY_STRUCT

MOST_FRAMES = 200


def can_frames(data: bytes) -> None:
    """Frames of a flag byte, an identifier of two bytes and up to eight data bytes, eight or so to a scan."""
    bus = MemoryBus()
    link = CanLink(bus, the_config().can)
    drive = CanDrive(link, the_config().drive, 20)
    at = scan = count = 0
    while at + 3 <= len(data) and count < MOST_FRAMES:
        flags, cob_id = data[at], int.from_bytes(data[at + 1 : at + 3], "little")
        size = flags & 0x0F
        frame = can.Message(
            arbitration_id=cob_id & 0x7FF if not flags & 0x10 else cob_id,
            is_extended_id=bool(flags & 0x10),
            is_remote_frame=bool(flags & 0x20),
            is_error_frame=bool(flags & 0x40),
            data=b"" if flags & 0x20 else data[at + 3 : at + 3 + size],
            dlc=size,
        )
        bus.incoming.append(frame)
        at += 3 + size
        count += 1
        if flags & 0x80 or not count % 8:
            scan += 1
            drive.poll(scan)
            drive.send(no_orders(), scan)
            all_of(drive, scan)
    drive.poll(scan + 1)
    all_of(drive, scan + 1)
    bus.shutdown()


def _modbus(config: ModbusConfig, data: bytes) -> None:
    """The first byte of each piece is its length; the device is asked whenever it may be."""
    line = ModbusLine(config, timeout_scans=3, drain_scans=4)
    device = ModbusDevice(config, line, 1, 5)
    ours, theirs = socket.socketpair()
    try:
        ours.setblocking(False)  # noqa: FBT003 - the name is the standard library's
        line.attach(ours)
        if data[:1] == b"\x01":  # half of the inputs meet a device that has been identified
            device._trusted_epoch = line.epoch
        at = 1
        for scan in range(SCANS):
            if line.ready(scan):
                device.order({"brake_on": scan % 2, "brake_current_a": 2.5})
                device.send(scan)
            size = data[at] if at < len(data) else 0
            theirs.send(data[at + 1 : at + 1 + size])
            at += 1 + size
            device.poll(scan)
            assert len(device.values) == len(device.reader.names) + 1
            assert all(value == value for value in device.values)  # noqa: PLR0124 - not a number is not itself
            assert 0 <= device.age_scans(scan) <= 0xFFFF
        assert not line.lost or line.lost_because
    finally:
        ours.close()
        theirs.close()


def modbus_tcp(data: bytes) -> None:
    """Bytes that an amplifier sends over TCP."""
    _modbus(the_config().amplifier, data)


def modbus_rtu(data: bytes) -> None:
    """Bytes that a brake supply sends over a serial line."""
    import dataclasses  # noqa: PLC0415

    _modbus(dataclasses.replace(the_config().brake, transport="rtu", serial_port="pair"), data)


def modbus_reply(data: bytes) -> None:
    """A reply to one read request: the header is right, what follows is not."""
    config = the_config().amplifier
    line = ModbusLine(config, timeout_scans=3, drain_scans=4)
    ours, theirs = socket.socketpair()
    try:
        ours.setblocking(False)  # noqa: FBT003
        line.attach(ours)
        assert line.send(line.frames.read_request(config.unit_id, "input", 0, 14), 0)
        asked = theirs.recv(64)
        theirs.send(asked[:2] + b"\0\0" + (len(data) + 1).to_bytes(2, "big") + asked[6:7] + data)
        reply = line.poll(0)
        assert reply is None or (reply.outcome is not Outcome.DATA or len(reply.data) == 2 * 14)
    finally:
        ours.close()
        theirs.close()


def _told(error: RecipeError) -> None:
    assert error.problems
    assert str(error)


def recipe_file(data: bytes) -> None:
    """A recipe: refused with its problems, or checked against the bench and, if that holds, compiled."""
    try:
        recipe = parse_recipe(data, "fuzz.yaml")
    except RecipeError as error:
        _told(error)
        return
    if not check(recipe, the_job().bench, Path("fuzz.yaml")):
        compile_program(recipe, the_job().bench)


def bench_file(data: bytes) -> None:
    """A bench: refused with its problems, or checked against the recipe and, if that holds, compiled."""
    try:
        bench = parse_bench(data, "fuzz.yaml")
    except RecipeError as error:
        _told(error)
        return
    if not check(the_job().recipe, bench, Path("fuzz.yaml")):
        compile_program(the_job().recipe, bench)


def _trace(data: bytes) -> None:
    with tempfile.NamedTemporaryFile(dir=_memory(), suffix=".trace") as file:
        file.write(data)
        file.flush()
        try:
            trace = read_trace(file.name)
        except AnalysisError:
            return
        assert trace.source == file.name


@cache
def _memory() -> str | None:
    return "/dev/shm" if Path("/dev/shm").is_dir() else None  # noqa: S108 - the kernel's shared memory


def trace_csv(data: bytes) -> None:
    """A CSV trace."""
    _trace(data)


def trace_parquet(data: bytes) -> None:
    """A Parquet trace, its magic number in place."""
    _trace(b"PAR1" + data[4:])


def trace_tdms(data: bytes) -> None:
    """A TDMS trace, its magic number in place."""
    _trace(b"TDSm" + data[4:])


@cache
def _ring() -> tuple[RingWriter, RingReader, tempfile.TemporaryDirectory[str]]:
    folder = tempfile.TemporaryDirectory()
    path = create(Path(folder.name), 16)
    both = RingWriter(path), RingReader(path)
    path.unlink()
    return *both, folder


def mailbox(data: bytes) -> None:
    """Whatever stands in the words that the supervisor writes: only commands come out, and each fits the record."""
    writer, reader, _ = _ring()
    first, last = 8 * W_COMMANDS_WRITTEN, 8 * (W_SLOTS + MAILBOX_SLOTS)
    words = data[: last - first].ljust(last - first, b"\0")
    beside = data[last - first :][:8].ljust(8, b"\0")
    reader._bytes[first:last] = words
    reader._bytes[8 * W_READ : 8 * W_READ + 8] = beside
    writer._taken = 0
    known = set(Command)
    image, orders = Image(*[0] * len(Image._fields)), no_orders()
    for _ in range(MAILBOX_SLOTS + 4):
        command = writer.take_command()
        assert command in known, f"command {command}"
        writer.append(1, 0, 0, image._replace(command=command), orders)
    assert writer.take_command() == Command.NONE, "there is no end of commands"
    BODY_STRUCT.pack(1, 1, 0, 0, *image, *orders)


TARGETS: dict[str, Callable[[bytes], None]] = {
    "can_frames": can_frames,
    "modbus_tcp": modbus_tcp,
    "modbus_rtu": modbus_rtu,
    "modbus_reply": modbus_reply,
    "recipe_file": recipe_file,
    "bench_file": bench_file,
    "trace_csv": trace_csv,
    "trace_parquet": trace_parquet,
    "trace_tdms": trace_tdms,
    "mailbox": mailbox,
    "socketcand_client": socketcand_client,
    "socketcand_server": socketcand_server,
}
