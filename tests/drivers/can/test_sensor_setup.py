"""Sensors on CAN before and in the scan, against a node of the `canopen` package: identity, objects, heartbeat."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace

import can
import canopen
import pytest
from canopen.objectdictionary import ODRecord, ODVariable, datatypes

from definitions.image import NmtState
from definitions.profiles.can import CanField, CanFrame, CanIdentity
from definitions.profiles.drive import StartupObject
from drivers.can.bus import CanLink, open_can
from drivers.can.sensor_setup import compare_sensor, start_sensors
from drivers.can.sensors import SensorFrame, SensorNode
from drivers.config import CanConfig, CanSensorConfig

CHANNEL, NODE_ID = "sensor-setup", 11
FRAME = CanFrame(0x180 + NODE_ID, 4, (CanField("torque_out", 0, 32, "signed", "little", 0.001),))
FILTER = StartupObject(0x6125, 1, "u16", 50, "cut-off frequency of the filter (Hz)")
SENSOR = CanSensorConfig(
    name="flange",
    node_id=NODE_ID,
    frames=(FRAME,),
    identity=CanIdentity(0xF1A7, 0x404),
    startup=(FILTER,),
    heartbeat_s=0.05,
    first_frame_timeout_s=1.0,
    sdo_reply_timeout_s=0.3,
)


class Transducer:
    """A CANopen node that answers SYNC with its torque while it is operational."""

    def __init__(self) -> None:
        self.bus = can.Bus(interface="virtual", channel=CHANNEL)
        self.network = canopen.Network(self.bus)
        self.network.NOTIFIER_SHUTDOWN_TIMEOUT = 0.5
        self.network.notifier = can.Notifier(self.bus, self.network.listeners, 0.01)
        self.node = canopen.LocalNode(NODE_ID, self._dictionary())
        self.network.add_node(self.node)
        self.written: list[tuple[int, int]] = []
        self.node.add_write_callback(lambda **to: self.written.append((to["index"], to["subindex"])))
        self.network.subscribe(0x080, self._sync)
        self._sending = threading.Lock()

    def _dictionary(self) -> canopen.ObjectDictionary:
        dictionary = canopen.ObjectDictionary()
        for index, values in ((0x1018, (0xF1A7, 0x404)), (0x6125, (10,))):
            record = ODRecord(f"object {index:04X}", index)
            for subindex, value in enumerate(values, start=1):
                member = ODVariable(f"sub {subindex}", index, subindex)
                member.data_type = datatypes.UNSIGNED32 if index == 0x1018 else datatypes.UNSIGNED16
                member.access_type, member.default = "ro" if index == 0x1018 else "rw", value
                record.add_member(member)
            dictionary.add_object(record)
        heartbeat = ODVariable("heartbeat", 0x1017, 0)
        heartbeat.data_type, heartbeat.default = datatypes.UNSIGNED16, 0
        dictionary.add_object(heartbeat)
        return dictionary

    def _sync(self, _cob_id: int, _data: bytearray, _time: float) -> None:
        if self.node.nmt.state == "OPERATIONAL":
            with self._sending:
                self.network.send_message(FRAME.identifier, (125_000).to_bytes(4, "little"))

    def close(self) -> None:
        self.node.nmt.stop_heartbeat()
        self.network.notifier.stop()
        self.bus.shutdown()


@pytest.fixture
def transducer() -> Iterator[Transducer]:
    one = Transducer()
    yield one
    one.close()


@pytest.fixture
def link() -> Iterator[CanLink]:
    one = open_can(CanConfig("virtual", CHANNEL))
    yield one
    one.close()


def test_an_emergency_of_another_node_waits_for_the_scan_while_a_sensor_is_set_up(
    transducer: Transducer, link: CanLink
) -> None:
    emcy, warning = 0x085, b"\x10\x42\x09" + bytes(5)
    transducer.network.send_message(emcy, warning)
    assert start_sensors(link, [SENSOR], []) == []
    assert list(link.early[emcy]) == [warning]


def test_a_sensor_is_compared_set_up_started_and_each_object_is_told(transducer: Transducer, link: CanLink) -> None:
    outcomes = {one.place: one.outcome for one in compare_sensor(link, SENSOR)}
    assert outcomes == {
        "1018:01": "holds", "1018:02": "holds", "6125:01": "will be written", "1017:00": "will be written",
    }  # fmt: skip
    assert (transducer.written, transducer.node.nmt.state) == ([], "INITIALISING"), "a comparison changes nothing"
    log: list[str] = []
    assert start_sensors(link, [SENSOR], log) == []
    told = "\n".join(log)
    assert transducer.written == [(0x6125, 1), (0x1017, 0)]
    for object_, how in (("1018:01", "checked"), ("6125:01", "read back"), ("1017:00", "read back")):
        assert any(object_ in line and line.endswith(how) for line in log), told
    assert "heartbeat says operational" in told
    assert f"0x{FRAME.identifier:03X}: 4 bytes come" in told
    log.clear()
    assert start_sensors(link, [SENSOR], log) == []
    assert transducer.written == [(0x6125, 1), (0x1017, 0)], "what is held already is not written again"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"identity": CanIdentity(0xF1A7, 0x405)}, "product code is not what it must be"),
        ({"startup": (replace(FILTER, index=0x6126),)}, "the object does not exist"),
        ({"startup": (replace(FILTER, type="u32"),)}, "2 bytes instead of 4"),
        ({"node_id": 12, "identity": None, "startup": ()}, "no answer"),
        ({"frames": (replace(FRAME, size=8),)}, "sends frames of another length"),
        ({"frames": (replace(FRAME, identifier=0x28B),)}, "sends nothing"),
    ],
)
def test_another_sensor_is_refused_and_gets_nothing(
    transducer: Transducer, link: CanLink, change: dict[str, object], said: str
) -> None:
    problems = start_sensors(link, [replace(SENSOR, setup_timeout_s=2.0, **change)], [])
    assert said in "\n".join(map(str, problems))
    if "identity" in change:
        assert transducer.written == [], "nothing is written into another device"


UP, FRESH, WAITS = (NmtState.OPERATIONAL,), (NmtState.BOOT_UP, NmtState.OPERATIONAL), (NmtState.PRE_OPERATIONAL,)


@pytest.mark.parametrize(
    ("beats", "lost_at"),
    [
        (dict.fromkeys(range(0, 500, 50), UP), None),
        (dict.fromkeys((*range(0, 150, 50), *range(200, 500, 50)), UP), None),
        (dict.fromkeys(range(0, 150, 50), UP), 226),
        (dict.fromkeys(range(0, 500, 50), UP) | {50: FRESH}, 50),
        (dict.fromkeys(range(0, 500, 50), UP) | {50: WAITS}, 50),
        ({}, 126),
    ],
    ids=["in time", "one missing", "silence", "started anew", "not operational", "never heard"],
)
def test_a_node_that_is_silent_or_started_anew_is_lost_and_stays_so(
    beats: dict[int, tuple[NmtState, ...]], lost_at: int | None
) -> None:
    frame = SensorFrame(FRAME, synchronous=False)
    node = SensorNode([frame], heartbeat_scans=50)
    lost = []
    for scan in range(400):
        for state in beats.get(scan, ()):
            node.take(bytes([state]), scan)
        node.look(scan)
        lost.append(frame.lost)
    assert (lost.index(True) if True in lost else None) == lost_at
    assert lost == sorted(lost)
