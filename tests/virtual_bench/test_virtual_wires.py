"""The virtual bench over real sockets, with the clients that a controller uses: python-can, canopen, pymodbus."""

from __future__ import annotations

import asyncio
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import canopen
import pytest
from pymodbus.client import ModbusTcpClient

from station.bench.assemble import modbus_profile
from station.bench.files import FileAt
from virtual_bench.config import ModbusPort, ServerConfig
from virtual_bench.errors import VirtualBenchError
from virtual_bench.faults.scenario import Scenario
from virtual_bench.server import run

pytestmark = [pytest.mark.wires, pytest.mark.wall_clock]
CONTROLLER = 126
ON, OFF = True, False


class Served:
    """The server in a thread of its own, with its ports and what it logged."""

    def __init__(self, config: ServerConfig, scenario: Scenario | None = None) -> None:
        self.events: list[dict[str, Any]] = []
        self.ready: dict[str, Any] = {}
        self._announced = threading.Event()
        self._config, self._scenario = config, scenario
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)
        self._thread.start()
        assert self._announced.wait(30)

    async def _serve(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()

        def announce(ready: dict[str, Any]) -> None:
            self.ready = ready
            self._announced.set()

        def log(kind: str, text: str, **more: Any) -> None:
            self.events.append({"event": kind, "text": text, **more})

        await run(self._config, self._scenario, announce=announce, stop=self._stop, log=log)

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(10)
        assert not self._thread.is_alive()

    def bus(self) -> can.BusABC:
        where = self.ready["can"]
        return can.Bus(
            interface="socketcand", host=where["host"], port=where["port"], channel=where["channel"], tcp_tune=True
        )

    def modbus(self, name: str) -> ModbusTcpClient:
        client = ModbusTcpClient(self.ready[name]["host"], port=self.ready[name]["port"], timeout=5, retries=0)
        assert client.connect()
        return client

    def wait_for(self, kind: str, within_s: float = 10.0) -> dict[str, Any]:
        return wait(lambda: next((event for event in self.events if event["event"] == kind), None), within_s)


def wait(what: Callable[[], Any], within_s: float = 10.0) -> Any:
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        found = what()
        if found:
            return found
        time.sleep(0.005)
    raise AssertionError("did not happen in time")


@pytest.fixture
def served(server_config: ServerConfig) -> Iterator[Served]:
    server = Served(server_config)
    yield server
    server.close()


@pytest.fixture
def network(served: Served) -> Iterator[canopen.Network]:
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.05  # how long its reader may wait for a frame when it is to end
    network.connect(
        interface="socketcand",
        host=served.ready["can"]["host"],
        port=served.ready["can"]["port"],
        channel=served.ready["can"]["channel"],
    )
    yield network
    network.disconnect()


def send(bus: can.BusABC, cob_id: int, data: bytes) -> None:
    bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))


def receive(bus: can.BusABC, cob_id: int, within_s: float = 5.0) -> bytes:
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        message = bus.recv(0.1)
        if message is not None and message.arbitration_id == cob_id:
            return bytes(message.data)
    raise AssertionError(f"no frame {cob_id:03X}")


def setpoint(bus: can.BusABC, controlword: int, mode: int = 10, torque: int = 0) -> bytes:
    send(bus, 0x205, struct.pack("<Hbh", controlword, mode, torque))
    send(bus, 0x080, b"")
    return receive(bus, 0x185)


def enable(bus: can.BusABC) -> None:
    for word in (0x06, 0x07, 0x0F):
        status = setpoint(bus, word)
    assert struct.unpack("<HbhB", status)[0] & 0x6F == 0x27


def test_two_clients_see_each_other_and_the_drive_answers_sync(served: Served) -> None:
    with served.bus() as one, served.bus() as two:
        send(one, 0x123, b"\x01\x02")
        assert receive(two, 0x123) == b"\x01\x02"
        send(one, 0x000, b"\x01\x05")
        send(one, 0x080, b"")
        assert struct.unpack("<HbhB", receive(two, 0x185))[1] == 0
        assert len(receive(one, 0x285)) == 8


def test_an_identifier_of_29_bits_is_none_of_11(served: Served) -> None:
    with served.bus() as one, served.bus() as two:
        send(one, 0x000, b"\x01\x05")
        one.send(can.Message(arbitration_id=0x080, is_extended_id=True))
        message = two.recv(5.0)
        while message is not None and message.arbitration_id == 0x000:
            message = two.recv(5.0)
        assert message is not None
        assert (message.arbitration_id, message.is_extended_id) == (0x080, True)
        with pytest.raises(AssertionError):
            receive(two, 0x185, 0.1)


def test_no_process_data_before_the_node_is_operational(served: Served) -> None:
    with served.bus() as bus:
        send(bus, 0x080, b"")
        with pytest.raises(AssertionError):
            receive(bus, 0x185, 0.1)


def test_objects_over_sdo(network: canopen.Network) -> None:
    sdo = network.add_node(5, canopen.ObjectDictionary()).sdo
    assert struct.unpack("<I", sdo.upload(0x1018, 1)) == (0x4C4D0001,)
    assert struct.unpack("<I", sdo.upload(0x1018, 2)) == (0x0402,)
    assert struct.unpack("<I", sdo.upload(0x6076, 0)) == (5000,)
    assert struct.unpack("<I", sdo.upload(0x6502, 0))[0] == 1 << 5 | 1 << 8 | 1 << 9
    for index, sub, code, value in (
        (0x6072, 0, "<H", 1100),
        (0x6080, 0, "<I", 120),
        (0x6087, 0, "<I", 10000),
        (0x6007, 0, "<h", 2),
        (0x605A, 0, "<h", 2),
        (0x605E, 0, "<h", 2),
        (0x1016, 1, "<I", CONTROLLER << 16 | 100),
        (0x1400, 5, "<H", 50),
        (0x1006, 0, "<I", 1000),
    ):
        sdo.download(index, sub, struct.pack(code, value))
        assert struct.unpack(code, sdo.upload(index, sub)) == (value,)


@pytest.mark.parametrize(
    ("index", "subindex", "data", "abort"),
    [
        (0x5FFF, 0, b"\x00", 0x06020000),  # no such object
        (0x6041, 0, b"\x00\x00", 0x06010002),  # read only
        (0x605A, 0, b"\x09\x00", 0x06090030),  # no such option
        (0x1A00, 1, b"\x10\x00\x41\x60", 0x08000022),  # mapping of a PDO at work
    ],
)
def test_objects_refuse_what_a_drive_refuses(
    network: canopen.Network, index: int, subindex: int, data: bytes, abort: int
) -> None:
    sdo = network.add_node(5, canopen.ObjectDictionary()).sdo
    with pytest.raises(canopen.SdoAbortedError) as caught:
        sdo.download(index, subindex, data)
    assert caught.value.code == abort


def test_remapping_and_divided_sync(network: canopen.Network) -> None:
    sdo = network.add_node(5, canopen.ObjectDictionary()).sdo
    cob_id = struct.unpack("<I", sdo.upload(0x1800, 1))[0]
    sdo.download(0x1800, 1, struct.pack("<I", cob_id | 1 << 31))
    sdo.download(0x1A00, 0, b"\x00")
    sdo.download(0x1A00, 1, struct.pack("<I", 0x60410010))
    sdo.download(0x1A00, 2, struct.pack("<I", 0x60770010))
    sdo.download(0x1A00, 3, struct.pack("<I", 0x60720010))
    with pytest.raises(canopen.SdoAbortedError, match="0x06040041"):  # 0x6072 cannot be mapped
        sdo.download(0x1A00, 0, b"\x03")
    sdo.download(0x1A00, 0, b"\x02")
    sdo.download(0x1800, 2, b"\x03")  # every third SYNC
    sdo.download(0x1800, 1, struct.pack("<I", cob_id))
    seen: list[bytes] = []
    network.subscribe(0x185, lambda _id, data, _time: seen.append(bytes(data)))
    network.send_message(0x000, b"\x01\x05")
    for _ in range(9):
        network.send_message(0x080, b"")
    wait(lambda: len(seen) >= 3)
    time.sleep(0.05)
    assert [len(data) for data in seen] == [4, 4, 4]


def test_a_vanished_controller_stops_the_drive(served: Served, network: canopen.Network) -> None:
    sdo = network.add_node(5, canopen.ObjectDictionary()).sdo
    sdo.download(0x1016, 1, struct.pack("<I", CONTROLLER << 16 | 500))  # long enough to enable the drive in between
    sdo.download(0x6007, 0, struct.pack("<h", 2))
    with served.bus() as bus:
        send(bus, 0x000, b"\x01\x05")
        send(bus, 0x700 + CONTROLLER, b"\x05")
        enable(bus)
        emcy = receive(bus, 0x085)
        assert struct.unpack("<HB", emcy[:3]) == (0x8130, 0x11)
        assert "0x6007 = 2" in served.wait_for("controller_lost")["text"]
        send(bus, 0x080, b"")
        assert struct.unpack_from("<H", receive(bus, 0x185))[0] & 0x4F == 0x40
    assert served.wait_for("controller_vanished")


def test_modbus_devices(served: Served) -> None:
    with served.modbus("amplifier") as amplifier:
        first = amplifier.read_input_registers(0, count=14, device_id=1).registers
        time.sleep(0.01)
        second = amplifier.read_input_registers(0, count=14, device_id=1).registers
        assert first[0] == second[0] == 0x4C41
        counters = [words[2] << 16 | words[3] for words in (first, second)]
        stamps = [words[4] << 16 | words[5] for words in (first, second)]
        assert counters[1] > counters[0]
        assert stamps[1] - stamps[0] == 100 * (counters[1] - counters[0])
        assert amplifier.read_input_registers(0, count=1, device_id=9).exception_code == 11
        assert amplifier.read_input_registers(10, count=14, device_id=1).exception_code == 2
        assert amplifier.read_holding_registers(0, count=1, device_id=1).isError()
    with served.modbus("brake") as brake:
        brake.write_registers(0, [1, 6000], device_id=2)
        assert brake.read_input_registers(0, count=3, device_id=2).registers == [0x4C42, 1, 6000]
        brake.write_registers(0, [0, 6000], device_id=2)
        assert brake.read_input_registers(0, count=3, device_id=2).registers == [0x4C42, 0, 0]
    with served.modbus("remote_io") as remote_io:
        words = remote_io.read_input_registers(0, count=5, device_id=3).registers
        assert words[:4] == [0x4C49, 0b11, 220, 220]
        time.sleep(0.01)
        assert remote_io.read_input_registers(4, count=1, device_id=3).registers[0] > words[4]


RELAYS = """
profile: {name: relays, kind: modbus}
read:
  table: input
  address: 1
  count: 1
  fields: [{name: brake_on, offset: 0, type: u16, bit: 7}]
write:
  table: coil
  address: 16
  single: true
  fields: [{name: brake_on, offset: 0, type: bit}]
"""
"""The brake at a coil of the remote I/O, read back in the word of its contacts."""


def test_a_brake_at_an_output_of_the_device_that_reads_the_contacts(
    server_config: ServerConfig, tmp_path: Path
) -> None:
    file = tmp_path / "relays.yaml"
    file.write_text(RELAYS, encoding="utf-8")
    ports = dict(server_config.devices)
    ports["brake"] = ModbusPort(modbus_profile(FileAt(file)), unit_id=3, connection="relays and contacts")
    ports["remote_io"] = replace(ports["remote_io"], connection="relays and contacts")
    served = Served(replace(server_config, devices=ports))
    try:
        assert served.ready["brake"] == served.ready["remote_io"]
        assert served.ready["amplifier"]["port"] != served.ready["brake"]["port"]
        with served.modbus("remote_io") as both:
            assert both.read_input_registers(0, count=5, device_id=3).registers[:2] == [0x4C49, 0b11]
            assert not both.write_coil(16, ON, device_id=3).isError()
            assert both.read_coils(16, count=1, device_id=3).bits[0]
            assert both.read_input_registers(1, count=1, device_id=3).registers == [0b1000_0011]
            assert both.read_input_registers(0, count=5, device_id=3).registers[:2] == [0x4C49, 0b1000_0011]
            assert not both.write_coil(16, OFF, device_id=3).isError()
            assert both.read_input_registers(1, count=1, device_id=3).registers == [0b11]
            assert both.write_coil(17, ON, device_id=3).exception_code == 2
            assert both.read_input_registers(0, count=6, device_id=3).exception_code == 2
            assert both.read_input_registers(0, count=1, device_id=2).exception_code == 11
    finally:
        served.close()


def test_requests_in_one_packet_are_all_answered(served: Served) -> None:
    with served.modbus("amplifier") as amplifier:
        request = b"".join(struct.pack(">HHHBBHH", tid, 0, 6, 1, 4, 0, 1) for tid in (7, 8, 9))
        amplifier.socket.sendall(request)
        answer = b""
        while len(answer) < 33:
            answer += amplifier.socket.recv(100)
        assert [struct.unpack_from(">H", answer, 11 * place)[0] for place in range(3)] == [7, 8, 9]


def test_torque_arrives_at_the_sensor(served: Served, network: canopen.Network) -> None:
    with served.modbus("brake") as brake, served.modbus("amplifier") as amplifier, served.bus() as bus:
        sdo = network.add_node(5, canopen.ObjectDictionary()).sdo
        sdo.download(0x6087, 0, struct.pack("<I", 500))  # 2.5 N·m/s: a step would overshoot and be held by friction
        network.send_message(0x000, b"\x01\x05")
        brake.write_registers(0, [1, 6000], device_id=2)
        time.sleep(0.4)
        enable(bus)
        setpoint(bus, 0x0F, torque=200)  # 1 N·m
        time.sleep(0.6)
        words = amplifier.read_input_registers(0, count=14, device_id=1).registers
        torque_in, torque_out = struct.unpack(">ii", struct.pack(">4H", *words[6:10]))
        assert torque_in * 1e-6 == pytest.approx(1.0, abs=0.02)
        assert torque_out * 1e-4 == pytest.approx(-13.9 + 94.7, abs=3.0)


@pytest.mark.parametrize("target", ["modbus.amplifier", "can.drive.tpdo1"])
def test_a_fault_acts_on_the_wire_and_says_so(server_config: ServerConfig, target: str) -> None:
    fault = {"target": target, "verb": "off", "when": {"time_s": 0.0}}
    served = Served(server_config, Scenario.model_validate({"scenario": {"name": "cut"}, "faults": [fault]}))
    try:
        with served.bus() as bus:
            send(bus, 0x000, b"\x01\x05")
            send(bus, 0x080, b"")
            assert receive(bus, 0x285)
        client = ModbusTcpClient("127.0.0.1", port=served.ready["amplifier"]["port"], timeout=0.3, retries=0)
        client.connect()
        client.close()
        assert target in served.wait_for("fault_acted")["text"]
    finally:
        served.close()


def test_a_taken_port_is_refused_with_a_reason(served: Served, server_config: ServerConfig) -> None:
    taken = served.ready["amplifier"]["port"]
    devices = {name: replace(one, port=taken) for name, one in server_config.devices.items()}
    config = replace(server_config, devices=devices)
    with pytest.raises(VirtualBenchError, match=f"{taken}.*Choose another port"):
        asyncio.run(run(config, announce=lambda _ready: None, log=lambda *_args, **_more: None))
