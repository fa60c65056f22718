"""What a drive does when its controller falls silent, measured on a second CANopen stack that can be made to fail."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from drivers_support import PERIOD_NS
from table_drive import Personality
from table_drive_bus import on_the_bus

from drivers.errors import DriverError
from station.commissioning.watchdogs import TRIALS, Reaction, figures, judged, measure

SETPOINTS_S, HEARTBEAT_S = 0.15, 0.3
"""So long that a computer which does other things does not end a trial before it has begun."""


def quiet() -> str:
    return ""


def trials(folder: Path, personality: Personality) -> dict[str, Reaction]:
    with on_the_bus(folder, "nanotec-like", personality) as (_, link, config):
        patient = replace(config, setpoint_timeout_s=SETPOINTS_S, controller_heartbeat_timeout_s=HEARTBEAT_S)
        return {trial.id: measure(link, patient, PERIOD_NS, trial, quiet) for trial in TRIALS}


@pytest.mark.wall_clock
def test_a_drive_that_watches_both_is_timed_in_every_trial(tmp_path: Path) -> None:
    seen = trials(tmp_path, Personality())
    assert [one.acted for one in seen.values()] == [True] * 3
    assert seen["setpoints"].after_s > SETPOINTS_S * 0.9
    assert seen["heartbeat"].after_s > HEARTBEAT_S * 0.9
    assert (seen["setpoints"].emcy_code, seen["heartbeat"].emcy_code) == (0x8250, 0x8130)
    assert judged(list(seen.values())) == ()


@pytest.mark.wall_clock
def test_set_points_that_are_watched_after_sync_only_are_found_and_the_heartbeat_is_what_is_left(
    tmp_path: Path,
) -> None:
    seen = trials(tmp_path, Personality(setpoints_watched="with SYNC"))
    assert [one.acted for one in seen.values()] == [False, True, True]
    (finding,) = judged(list(seen.values()))
    assert finding.refuses
    assert "transmission_type: 255" in finding.cure


@pytest.mark.wall_clock
def test_a_drive_that_holds_both_time_outs_and_acts_on_neither_is_refused(tmp_path: Path) -> None:
    seen = trials(tmp_path, Personality(setpoints_watched="never", heartbeat_watched=False))
    assert not any(one.acted for one in seen.values())
    assert [finding.refuses for finding in judged(list(seen.values()))] == [True] * 4
    assert {figure.value for figure in figures(list(seen.values()))} == {0}


def test_a_pressed_emergency_stop_ends_a_trial(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "nanotec-like") as (slave, link, config):
        with pytest.raises(DriverError, match="guard_closed reads 0"):
            measure(link, config, PERIOD_NS, TRIALS[0], lambda: "guard_closed reads 0")
        assert slave.state == "disabled"
