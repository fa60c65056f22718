"""Another controller on the bus of a run: a client of its own sends our drive a set-point while the unit is loaded."""

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


def disturb(address: dict[str, object], sent: threading.Event) -> None:
    """Wait on the bus until our controller loads the unit, then send its drive one set-point: no power."""
    with can.Bus(interface="socketcand", channel="vcan0", host=address["host"], port=address["port"]) as bus:
        while (message := bus.recv(60.0)) is not None:
            if message.arbitration_id == SETPOINT and abs(struct.unpack("<Hbh", message.data)[2]) > LOADED_PERMILLE:
                bus.send(can.Message(arbitration_id=SETPOINT, data=bytes(5), is_extended_id=False))
                sent.set()
                return


def test_a_set_point_of_another_controller_takes_the_power_away(lostmotion, tmp_path: Path) -> None:
    here = write_changed(VIRTUAL_BENCH, tmp_path / "apart.yaml", {"bench": {"name": "apart", "embedded": False}})
    with served(here) as ready:
        at = {part: {key: ready[part][key] for key in ("host", "port")} for part in ("can", "brake", "remote_io")}
        at["amplifier"] = {key: ready["amplifier"][key] for key in ("host", "port")}
        write_changed(here, here, at, {"pace": ready["pace"]})
        sent = threading.Event()
        other = threading.Thread(target=disturb, args=(ready["can"], sent))
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
    assert result["timing"]["wires"]["can.frames_foreign"] == 1
