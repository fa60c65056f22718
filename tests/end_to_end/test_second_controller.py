"""Another controller on the bus of a run: a client of its own sends our drive a frame while the unit is loaded."""

from __future__ import annotations

import struct
import threading
from pathlib import Path

import can
import pytest
from lostmotion_command import served
from patient import ONE_RAMP, OPEN_GATES, VIRTUAL_BENCH, brisk_recipe, write_changed

pytestmark = pytest.mark.wires
SETPOINT = 0x205
LOADED_PERMILLE = 200
"""Torque set-point of the drive by which the unit is loaded: a tenth of it is friction."""


LARGEST_TORQUE = b"\x2b\x72\x60\x00\x88\x13\x00\x00"
"""SDO: 0x6072, the drive's own limit of the torque, which was read back before the run, to 500 %."""


def disturb(address: dict[str, object], cob_id: int, data: bytes, sent: threading.Event) -> None:
    """Wait on the bus until our controller loads the unit, then send its drive one frame."""
    with can.Bus(interface="socketcand", channel="vcan0", host=address["host"], port=address["port"]) as bus:
        while (message := bus.recv(60.0)) is not None:
            if message.arbitration_id == SETPOINT and abs(struct.unpack("<Hbh", message.data)[2]) > LOADED_PERMILLE:
                bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
                sent.set()
                return


@pytest.mark.parametrize(
    ("cob_id", "data", "foreign"), [(SETPOINT, bytes(5), 1), (0x605, LARGEST_TORQUE, 2)], ids=["set-point", "SDO"]
)
def test_a_frame_of_another_controller_takes_the_power_away(
    lostmotion, tmp_path: Path, cob_id: int, data: bytes, foreign: int
) -> None:
    """The drive answers an SDO request, and that answer is foreign too."""
    here = write_changed(VIRTUAL_BENCH, tmp_path / "apart.yaml", {"bench": {"name": "apart", "embedded": False}})
    with served(here) as ready:
        at = {part: {key: ready[part][key] for key in ("host", "port")} for part in ("can", "brake", "remote_io")}
        at["amplifier"] = {key: ready["amplifier"][key] for key in ("host", "port")}
        write_changed(here, here, at, {"pace": ready["pace"]})
        sent = threading.Event()
        other = threading.Thread(target=disturb, args=(ready["can"], cob_id, data, sent))
        other.start()
        recipe = str(brisk_recipe(tmp_path, ONE_RAMP, OPEN_GATES))
        ran = lostmotion(
            "run", recipe, "--bench", str(here), "--serial", "S", "--json", "--pace", "fast", "--no-report"
        )
        other.join()
    assert sent.is_set()
    result = ran.json
    assert (result["alarms"][0]["id"], result["alarms"][0]["reaction"]) == ("other_controller", "power_off")
    assert (result["state"], result["verdict"]) == ("fault", "NOT DECIDABLE")
    assert result["timing"]["wires"]["can.frames_foreign"] == foreign
