"""A torque sweep as a recipe step: the frequency response that a run measures is that of the unit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lostmotion_command import here

from analysis.studies.frequency_response import frequency_response
from controller.controller import Controller
from definitions.image import Image, Orders
from definitions.program import Sweep
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import Job, load_job
from station.bench.virtual_unit import FIXED_SEED
from station.cli.studies.frequency import Swing, _swept_rows
from station.cli.studies.loop_source import trace_source
from station.errors import StationError
from station.scan.scan_loop import run_virtual, start_once
from virtual_bench.in_process import VirtualTimeBench
from virtual_bench.physics.plant_numbers import S

RECIPE = "rv-40e-121-sweep"


@pytest.fixture(scope="module")
def job(quarter: Callable[[str], str]) -> Job:
    """The job of `shipped_run(RECIPE)`."""
    return load_job(quarter(RECIPE), None)


@pytest.fixture(scope="module")
def truth(job: Job) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], torque in the reducer [N·m] and its wind-up [arcmin] while the sweep is on, without any sensor."""
    config = virtual_config(job.bench, job.profile_paths, choose_unit("P1", job.recipe, FIXED_SEED))
    bench = VirtualTimeBench(config, job.recipe.sampling.period_ns)
    swept = next(one.index for one in job.program.segments if one.sweep is not None)
    rows: list[tuple[float, float]] = []

    def append(_scan: int, _late: int, _work: int, _image: Image, orders: Orders) -> None:
        if orders.segment == swept:
            state = bench.plant.state
            rows.append((float(state[S.TORQUE_NM]), float(state[S.WINDUP_ARCMIN])))

    run_virtual(bench, Controller(job.program), append, start_once)
    torque, windup = np.array(rows).T
    return np.arange(torque.size) * job.program.period_s, torque, windup


def test_the_measured_response_is_that_of_the_unit(
    shipped_run: Callable[[str], Any], job: Job, truth: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    program = job.program
    sweep = next(one.sweep for one in program.segments if one.sweep is not None)
    kept = sweep.scans - sweep.period_scans
    period_s = sweep.period_scans * program.period_s
    band = (sweep.from_hz - 0.5 / period_s, sweep.to_hz + 0.5 / period_s)
    exact = frequency_response(*(row[:kept] for row in truth), band, period_s=period_s)
    found = here("study", "frequency", str(shipped_run(RECIPE).record), "--json").json
    assert found["lines_used"] == found["lines"] == len(found["response"]) == 9
    for line, row in enumerate(found["response"]):
        stiffness = 1.0 / abs(exact.response[line])
        assert row["frequency_hz"] == pytest.approx(float(exact.frequency_hz[line]))
        sensors = 0.001 * stiffness  # gains of the virtual bench's sensors
        assert row["stiffness_nm_per_arcmin"] == pytest.approx(
            stiffness, abs=2.0 * row["u_stiffness_nm_per_arcmin"] + sensors
        )
        assert row["phase_deg"] == pytest.approx(np.degrees(np.angle(exact.response[line])), abs=1.5)


def test_the_study_says_what_amplitude_the_torque_reached(shipped_run: Callable[[str], Any]) -> None:
    record = str(shipped_run(RECIPE).record)
    amplitude = here("study", "frequency", record, "--json").json["amplitude"]
    assert amplitude["planned_nm"] == 40.0
    assert amplitude["reached_at_from_hz_nm"] == pytest.approx(40.0, rel=0.05)
    assert amplitude["reached_at_to_hz_nm"] == pytest.approx(40.0, rel=0.05)
    assert "tune the torque loop" not in " ".join(here("study", "frequency", record).out.split())


def test_a_drive_that_does_not_follow_is_told() -> None:
    """A torque whose amplitude falls from the planned one at 1 Hz to three quarters of it at 2 Hz."""
    sweep, scan_s = Sweep(40.0, 1.0, 2.0, period_scans=4000, periods=5), 1e-3
    scans = np.arange(4 * sweep.period_scans)
    share = scans % sweep.period_scans / sweep.period_scans
    way = np.where(share > 0.5, 1.0 - share, share)
    phase = way * (4.0 + 4.0 * way) * np.where(share > 0.5, -1.0, 1.0)
    torque_nm = 206.0 + 40.0 * (1.0 - 0.5 * way) * np.sin(2.0 * np.pi * phase)
    swing = Swing.of(torque_nm, sweep, scan_s)
    assert swing.reached_at_from_hz_nm == pytest.approx(40.0, rel=0.03)
    assert swing.reached_at_to_hz_nm == pytest.approx(30.0, rel=0.03)
    assert not swing.followed
    assert Swing.of(206.0 + (torque_nm - 206.0) / (1.0 - 0.5 * way), sweep, scan_s).followed


def test_the_loop_beside_the_sweep_is_evaluated_as_ever(shipped_run: Callable[[str], Any]) -> None:
    ran = shipped_run(RECIPE).ran
    assert ran.json["verdict"] == "PASS"
    backlash = next(one for one in ran.json["metrics"] if one["id"] == "backlash_width_3pct")
    assert backlash["cycles"] == 1


def test_a_run_without_a_sweep_asks_for_the_band(quick_run: Any) -> None:
    ran = here("study", "frequency", str(quick_run.record))
    assert ran.exit_code == 2
    assert "--band" in ran.err


def test_a_sweep_that_was_held_up_is_not_evaluated(shipped_run: Callable[[str], Any]) -> None:
    record = shipped_run(RECIPE).record
    source = trace_source(str(record), None, record.parent)
    trace = source.trace
    assert trace.segment is not None
    swept = next(key for key, one in trace.segments.items() if one.role == "sweep")
    segment = trace.segment.copy()
    segment[np.flatnonzero(segment == swept)[-50:]] = swept + 1
    with pytest.raises(StationError, match="held up"):
        _swept_rows(replace(source, trace=replace(trace, segment=segment)))
