"""A drive compared with its profile: what the set-up would make of each object, and that nothing is written."""

from __future__ import annotations

from pathlib import Path

import pytest
from drivers_support import PERIOD_NS, drive_config
from eds_drives import DRIVES
from table_drive import Personality
from test_second_slave import on_the_bus

from drivers.can.bus import open_can
from drivers.config import CanConfig, DriveConfig
from drivers.servo_drive.comparison import compare_drive, rows_of
from drivers.servo_drive.setup import set_up_drive
from station.run.supervisor import ARM_TIMEOUT_S


def test_every_object_is_compared_and_nothing_is_written(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "nanotec-like", Personality(read_only=((0x6076, 0, 4000),))) as (slave, link, config):
        compared = {one.place: one for one in compare_drive(link, config, PERIOD_NS)}
        assert not slave.written
        assert compared["1018:01"].outcome == "holds"
        assert (compared["6076:00"].outcome, compared["6076:00"].found) == ("refused", "4000")
        assert compared["6072:00"].outcome == "will be written"
        assert compared["1402:01"].outcome == "will be written"
        assert len(compared) == len(rows_of(config, PERIOD_NS))


def test_what_was_set_up_holds(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "epos4-like") as (_, link, config):
        set_up_drive(link, config, PERIOD_NS)
        outcomes = {one.outcome for one in compare_drive(link, config, PERIOD_NS)}
        assert outcomes == {"holds", "not there"}


def test_a_silent_drive_ends_it_early() -> None:
    link = open_can(CanConfig("virtual", "nobody-there"))
    compared = compare_drive(link, drive_config(sdo_reply_timeout_s=0.02), PERIOD_NS)
    link.close()
    assert [one.outcome for one in compared] == ["no answer", "no answer"]


@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_that_answers_after_300_ms_can_be_set_up_in_time(tmp_path: Path, name: str) -> None:
    with on_the_bus(tmp_path, name) as (slave, link, config):
        asked = slave.count_transfers()
        set_up_drive(link, config, PERIOD_NS)
        usual_s = DriveConfig.__dataclass_fields__["setup_timeout_s"].default
        assert len(asked) > 50
        assert len(asked) * 0.3 < usual_s < ARM_TIMEOUT_S
