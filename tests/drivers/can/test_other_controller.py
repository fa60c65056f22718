"""Another controller on the bus is noticed before anything is sent."""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Iterator

import can
import pytest
from drivers_support import PERIOD_NS, drive_config, modbus_config

from drivers.can.bus import CanLink, open_can
from drivers.can.other_controller import refuse_other_controller
from drivers.config import CanConfig, DriveConfig, WireBenchConfig
from drivers.errors import DriverError, DriveSetupError
from drivers.wire_bench import WireBench

CHANNEL = "other-controller"
OUR_HEARTBEAT, TPDO1 = 0x77E, 0x185
ENABLED = struct.pack("<HbhB", 0x1637, 10, 0, 0)
QUIET = (
    (0x77D, b"\x05"),  # the heartbeat of another node
    (0x705, b"\x05"),  # the drive's own
    (TPDO1, struct.pack("<HbhB", 0x0250, 10, 0, 0)),  # switch on disabled
    (TPDO1, struct.pack("<HbhB", 0x0233, 10, 0, 0)),  # switched on
    (TPDO1, ENABLED[:5]),  # not a status frame of this profile
    (0x285, ENABLED),  # no status word in this one
    (0x186, ENABLED),  # another drive
    (0x080, b""),  # a drive may send SYNC until it is set up
    (0x605, b"\x40\x72\x60\x00\x00\x00\x00\x00"),  # somebody reads from the drive
    (0x606, b"\x2b\x72\x60\x00\x88\x13\x00\x00"),  # somebody writes to another one
)


@pytest.fixture
def other() -> Iterator[can.BusABC]:
    one = can.Bus(interface="virtual", channel=CHANNEL)
    yield one
    one.shutdown()


@pytest.fixture
def link() -> Iterator[CanLink]:
    one = open_can(CanConfig("virtual", CHANNEL))
    yield one
    one.close()


def put(bus: can.BusABC, cob_id: int, data: bytes, **kind: bool) -> None:
    bus.send(can.Message(arbitration_id=cob_id, data=data, **({"is_extended_id": False} | kind)))


@pytest.mark.parametrize(
    ("cob_id", "data", "told"),
    [
        (OUR_HEARTBEAT, b"\x05", "another controller is active on this bus: found a heartbeat 0x77E"),
        (0x000, b"\x01\x05", "another controller is active on this bus: found an NMT command 0x000"),
        (0x205, b"\x0f\x00\x0a\x00\x00", "another controller is active on this bus: found a set-point 0x205"),
        (0x605, b"\x2b\x72\x60\x00\x88\x13\x00\x00", "found an SDO request that writes 0x605"),
        (TPDO1, ENABLED, "node 5: another controller is active on this bus: found a drive that is enabled"),
    ],
)
def test_another_controller_is_refused(other: can.BusABC, link: CanLink, cob_id: int, data: bytes, told: str) -> None:
    for quiet in QUIET:
        put(other, *quiet)
    put(other, cob_id, data)
    with pytest.raises(DriveSetupError) as caught:
        refuse_other_controller(link, drive_config(listen_before_reset_s=0.5))
    assert told in str(caught.value)
    assert other.recv(0) is None, "nothing is sent to a bus that is not ours"


def test_a_bus_without_another_controller_is_taken(other: can.BusABC, link: CanLink) -> None:
    for quiet in QUIET:
        put(other, *quiet)
    put(other, OUR_HEARTBEAT, b"\x05", is_extended_id=True)
    put(other, OUR_HEARTBEAT, b"", is_remote_frame=True)
    refuse_other_controller(link, drive_config(listen_before_reset_s=0.2))
    assert link.receive() is None, "everything was listened to"


def test_several_heartbeats_fit_into_the_time_of_listening() -> None:
    (field,) = [field for field in dataclasses.fields(DriveConfig) if field.name == "listen_before_reset_s"]
    assert isinstance(field.default, float)
    assert field.default >= 5 * drive_config().controller_heartbeat_s


def test_a_bus_that_fails_is_told(link: CanLink, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_timeout: float) -> None:
        raise OSError(100, "Network is down")

    monkeypatch.setattr(link.bus, "recv", fail)
    with pytest.raises(DriveSetupError, match=r"listening failed: found.*Network is down"):
        refuse_other_controller(link, drive_config())


def test_opening_the_bench_leaves_the_others_drive_alone(other: can.BusABC, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = {"host": "127.0.0.1", "port": 1, "connect_timeout_s": 0.3}
    bench = WireBench(
        WireBenchConfig(
            period_ns=PERIOD_NS,
            can=CanConfig("virtual", CHANNEL),
            drive=drive_config(listen_before_reset_s=0.5),
            amplifier=modbus_config("virtual-amplifier", 1, **missing),
            brake=modbus_config("virtual-brake", 2, **missing),
            remote_io=modbus_config("virtual-remote-io", 3, **missing),
        )
    )

    def open_while_another_is_there(config: CanConfig) -> CanLink:
        opened = open_can(config)
        put(other, OUR_HEARTBEAT, b"\x05")
        return opened

    monkeypatch.setattr("drivers.wire_bench.open_can", open_while_another_is_there)
    with pytest.raises(DriverError, match="another controller is active on this bus"):
        bench.open()
    assert other.recv(0) is None, "neither a reset nor any other command"
