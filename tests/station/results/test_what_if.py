"""What another recipe would have changed: where the two controllers part, and what is exact of the answer."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from run_samples import recorded

from controller.controller import Controller
from definitions.program import Program
from station.bench.request import Job, load_job
from station.records.samples.scan_record import RECORD_BYTES, unpack
from station.records.samples.table import table_of
from station.results.divergence import Beside, Divergence
from station.results.replay import replay
from station.results.what_if import ShadowWatch, interlock_changes


@pytest.fixture(scope="module")
def content(golden_run) -> bytes:
    return recorded(golden_run.record)


@pytest.fixture(scope="module")
def job(golden_run) -> Job:
    return load_job(str(golden_run.record / "recipe.yaml"), str(golden_run.record / "bench.yaml"))


def with_limits(program: Program, **limits: float) -> Program:
    return replace(program, limits=replace(program.limits, **limits))


def parted(content: bytes, own: Program, other: Program) -> Divergence | None:
    beside = Beside(Controller(own), Controller(other))
    assert replay(content, beside).same, "the other controller only looks on"
    return beside.divergence


def test_the_same_program_never_parts(content, job) -> None:
    assert parted(content, job.program, job.program) is None


def test_limits_that_nothing_reaches_do_not_part(content, job) -> None:
    other = with_limits(job.program, torque_out_trip_nm=1000.0, speed_rad_s=100.0, housing_temperature_c=90.0)
    assert parted(content, job.program, other) is None


@pytest.mark.parametrize(
    ("limits", "fault", "state"),
    [
        ({"torque_out_alarm_nm": 80.0}, "torque_out_alarm", "calibrate"),
        ({"torque_out_trip_nm": 80.0}, "torque_out_trip", "calibrate"),
        ({"housing_temperature_c": 5.0}, "housing_temperature", "home"),
        ({"lock_proof_motion_rad": 0.0}, "lock_slip", "lock"),
    ],
)
def test_an_interlock_of_the_other_recipe_parts_them_at_the_scan_that_raises_it(
    content, job, limits, fault, state
) -> None:
    other = with_limits(job.program, **limits)
    found = parted(content, job.program, other)
    assert found is not None
    assert (found.fault, found.state) == (fault, state)
    shadow = ShadowWatch(job.program, other)
    assert replay(content, Controller(job.program, shadow)).same
    first = interlock_changes(table_of(content), shadow, found)[0]
    assert (first.id, first.other_scan, first.exact) == (fault, found.scan, True)


def test_a_zero_that_the_other_recipe_refuses_is_named_with_its_figures(content, job) -> None:
    other = replace(job.program, tare=replace(job.program.tare, torque_out_zero_nm=1e-9))
    found = parted(content, job.program, other)
    assert found is not None
    assert found.fault == "tare_out_of_range"
    assert "zero of output torque" in found.cause


def test_another_load_and_another_release_part_them_without_any_alarm(content, job) -> None:
    segments = tuple(replace(one, rate_nm_s=one.rate_nm_s * 0.9) for one in job.program.segments)
    slower = parted(content, job.program, replace(job.program, segments=segments))
    assert slower is not None
    assert slower.fault == ""
    assert re.search(r"drive_target_torque_nm \S+ instead of \S+", slower.cause)
    later = parted(content, job.program, replace(job.program, release_torque_nm=1e-6))
    assert later is not None
    assert later.scan > slower.scan
    assert later.state in ("unload", "release")


def test_an_alarm_that_only_the_run_raised_parts_them_too(content, job) -> None:
    # a run that was held: the golden images, stepped by a program with a low alarm
    low = with_limits(job.program, torque_out_alarm_nm=80.0)
    beside = Beside(Controller(low), Controller(job.program))
    for at in range(0, len(content), RECORD_BYTES):
        scan, image, _ = unpack(content[at : at + RECORD_BYTES])
        beside.step(image, scan)
    assert beside.divergence is not None
    assert beside.divergence.cause == "torque_out_alarm (hold) would not have been raised"


def test_the_limits_of_the_lock_are_told_apart_where_the_run_has_the_same_for_both(content, job) -> None:
    own = with_limits(job.program, lock_slip_rad=job.program.limits.lock_proof_motion_rad)
    for limits, state in (({"lock_slip_rad": 0.0}, "calibrate"), ({"lock_proof_motion_rad": 0.0}, "lock")):
        shadow = ShadowWatch(own, with_limits(own, **limits))
        assert replay(content, Controller(own, shadow)).same
        (slip,) = interlock_changes(table_of(content), shadow, None)
        assert (slip.id, slip.change, slip.state) == ("lock_slip", "new", state)
