"""The plant's physics against what is known of the reference unit and against laws that hold for any unit."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from virtual_bench.config import BenchConfig
from virtual_bench.physics.elastic import elastic_windup_arcmin
from virtual_bench.physics.plant import Plant
from virtual_bench.physics.plant_numbers import ARCMIN_RAD, CH, STEP_NS, DriveLoop, FloatArray, P, S
from virtual_bench.physics.plant_parameters import elastic_table
from virtual_bench.physics.plant_sensors import CHANNELS
from virtual_bench.physics.units import UNITS

MS = 1_000_000
P1_TORQUE_IN_PER_NM = 1.0 / 94.689


def locked(config: BenchConfig, current_a: float = 9.0) -> Plant:
    """Return a plant with its lock closed and the drive's limits wide."""
    plant = Plant(config)
    plant.set_drive_limits(6.0, 30.0, 1000.0)
    plant.set_brake_current(current_a)
    plant.advance(500 * MS)
    return plant


def ramp(plant: Plant, target_nm: float, rate_nm_s: float) -> np.ndarray:
    """Ramp the motor torque until the reducer's torque is at `target_nm`: rows of torque in, torque out, wind-up."""
    state = plant.state
    ratio = plant.params[P.DRIVEN_RATIO]
    side = 1.0 if target_nm > state[S.TORQUE_NM] else -1.0
    motor = float(state[S.MOTOR_NM])
    rows = []
    for _ in range(200_000):
        motor += side * rate_nm_s * 1e-3
        plant.set_drive(DriveLoop.TORQUE, motor, 0.0)
        plant.advance(MS)
        torque = state[S.TORQUE_NM]
        fixture = torque / plant.params[P.FIXTURE_NM_ARCMIN] + state[S.LOCKED_RAD] / ARCMIN_RAD
        windup = state[S.DRIVEN_RAD] / (ratio * ARCMIN_RAD) - fixture - state[S.DRIFT_ARCMIN]
        rows.append((state[S.LAG_TORQUE_DRIVEN_NM], torque, windup))
        if (target_nm - torque) * side <= 0.0:
            return np.array(rows)
    raise AssertionError("the torque was never reached")


@pytest.fixture(scope="module")
def loop(bench_config: BenchConfig) -> tuple[np.ndarray, np.ndarray]:
    """Rising and falling branch of P1 on a loop to ±480 N·m, after the virgin curve."""
    plant = locked(bench_config)
    ramp(plant, 480.0, 0.4)
    ramp(plant, -480.0, 0.4)
    return ramp(plant, 480.0, 0.4), ramp(plant, -480.0, 0.4)


def windup_at(branch: np.ndarray, torque_nm: float) -> float:
    order = np.argsort(branch[:, 1], kind="stable")
    return float(np.interp(torque_nm, branch[order, 1], branch[order, 2]))


def test_reference_unit_has_its_published_loop(loop: tuple[np.ndarray, np.ndarray]) -> None:
    rising, falling = loop

    def width(torque_nm: float) -> float:
        return windup_at(falling, torque_nm) - windup_at(rising, torque_nm)

    def mean(torque_nm: float) -> float:
        return (windup_at(falling, torque_nm) + windup_at(rising, torque_nm)) / 2.0

    assert width(12.36) == pytest.approx(0.9400, abs=2e-4)
    assert width(-12.36) == pytest.approx(0.9400, abs=2e-4)
    assert width(0.0) == pytest.approx(0.9494, abs=2e-4)
    assert mean(12.36) - mean(-12.36) == pytest.approx(0.3756, abs=2e-4)
    assert 206.0 / (mean(412.0) - mean(206.0)) == pytest.approx(105.80, abs=0.02)
    assert 206.0 / (windup_at(rising, 412.0) - windup_at(rising, 206.0)) == pytest.approx(104.70, abs=0.02)


def test_input_torque_follows_the_two_friction_lines(loop: tuple[np.ndarray, np.ndarray]) -> None:
    rising, falling = loop
    loading = rising[(rising[:, 1] > 50.0) & (rising[:, 1] < 450.0)]
    slope, offset = np.polyfit(loading[:, 0], loading[:, 1], 1)
    assert slope == pytest.approx(94.689, rel=0.003)
    assert offset == pytest.approx(-13.889, abs=0.2)
    unloading = falling[(falling[:, 1] > 30.0) & (falling[:, 1] < 400.0)]
    slope, offset = np.polyfit(unloading[:, 0], unloading[:, 1], 1)
    assert slope == pytest.approx(168.0, rel=0.005)
    assert offset == pytest.approx(24.8, abs=1.0)


def test_a_closed_loop_never_gives_energy_back(loop: tuple[np.ndarray, np.ndarray]) -> None:
    rising, falling = loop
    torque = np.concatenate([rising[:, 1], falling[:, 1]])
    windup = np.concatenate([rising[:, 2], falling[:, 2]])
    area = float(np.sum((torque[1:] + torque[:-1]) / 2.0 * np.diff(windup)))
    assert area * ARCMIN_RAD == pytest.approx(0.1359, rel=0.05)


@pytest.mark.parametrize("name", sorted(UNITS))
def test_the_elastic_table_is_the_inverse_of_the_windup(name: str) -> None:
    unit = UNITS[name]
    table = elastic_table(unit)
    assert np.all(np.diff(table) > 0.0)
    grid = np.linspace(-30.0, 30.0, len(table))
    assert np.max(np.abs(elastic_windup_arcmin(unit, table) - grid)) < 1e-9


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(1, 7_000_000), min_size=1, max_size=30))
def test_advancing_in_pieces_is_advancing_at_once(bench_config: BenchConfig, pieces: list[int]) -> None:
    one, many = Plant(bench_config), Plant(bench_config)
    for plant in (one, many):
        plant.set_drive_limits(6.0, 30.0, 1000.0)
        plant.set_drive(DriveLoop.TORQUE, 3.0, 0.0)
        plant.set_brake_current(6.0)
    for piece in pieces:
        many.advance(piece)
    one.advance(sum(pieces))
    assert many.state.tobytes() == one.state.tobytes()


def test_same_seed_same_bytes_other_seed_other_noise_of_the_same_sensors(bench_config: BenchConfig) -> None:
    def samples(config: BenchConfig) -> FloatArray:
        plant = locked(config)
        out = []
        for _ in range(2000):
            plant.advance(MS)
            out.append(tuple(plant.sample()))
        return np.array(out)

    one, again, other = (samples(replace(bench_config, noise_seed=seed)) for seed in (1, 1, 2))
    assert np.array_equal(one, again)
    noise_nm = bench_config.torque_out.noise_fraction * bench_config.torque_out.full_scale_nm
    assert np.std(one[:, 1] - other[:, 1]) == pytest.approx(2**0.5 * noise_nm, rel=0.1)
    assert abs(np.mean(one[:, 1] - other[:, 1])) < 4.0 * noise_nm * (2 / len(one)) ** 0.5
    sensors = Plant(bench_config).channels
    assert np.array_equal(sensors, Plant(replace(bench_config, noise_seed=2)).channels)
    assert not np.array_equal(sensors, Plant(replace(bench_config, sensor_seed=2)).channels)


def test_an_open_lock_lets_the_torque_accelerate_the_shaft(bench_config: BenchConfig) -> None:
    plant = locked(bench_config, current_a=0.0)
    plant.set_drive(DriveLoop.TORQUE, 0.5, 0.0)
    plant.advance(200 * MS)
    assert abs(plant.state[S.LOCKED_RAD]) > 5 * ARCMIN_RAD
    assert plant.state[S.DRIVEN_RAD_S] > 1.0
    assert np.all(np.isfinite(plant.state))


def test_the_locked_shaft_stays_below_the_brake_torque_and_slips_above(bench_config: BenchConfig) -> None:
    plant = locked(bench_config, current_a=2.0)
    ramp(plant, 150.0, 2.0)
    assert plant.state[S.LOCKED_RAD] == 0.0
    plant.set_drive(DriveLoop.TORQUE, 4.0, 0.0)
    plant.advance(1000 * MS)
    assert plant.state[S.LOCKED_RAD] > ARCMIN_RAD
    assert plant.state[S.BRAKE_NM] == pytest.approx(196.0, abs=1.0)
    assert plant.sample().torque_out_nm < 250.0


def test_the_loose_lock_slips_under_load_but_holds_a_tenth(bench_config: BenchConfig) -> None:
    plant = locked(replace(bench_config, unit="loose-lock"), current_a=6.0)
    ramp(plant, 41.0, 2.0)
    assert plant.state[S.LOCKED_RAD] == 0.0
    plant.set_drive(DriveLoop.TORQUE, 4.0, 0.0)
    plant.advance(1000 * MS)
    assert plant.state[S.LOCKED_RAD] > 10 * ARCMIN_RAD


def test_the_brake_is_slow_and_holds_more_when_its_current_falls(bench_config: BenchConfig) -> None:
    plant = Plant(bench_config)
    plant.set_brake_current(4.0)
    plant.advance(80 * MS)
    assert plant.state[S.BRAKE_NM] == pytest.approx(392.0 * (1.0 - np.exp(-1.0)), rel=1e-3)
    plant.set_brake_current(8.0)
    plant.advance(2000 * MS)
    plant.set_brake_current(4.0)
    plant.advance(2000 * MS)
    assert plant.state[S.BRAKE_NM] == pytest.approx(408.0, rel=1e-3)


def test_constant_speed_is_kept_while_the_reducer_winds_up(output_config: BenchConfig) -> None:
    plant = Plant(output_config)
    plant.set_drive_limits(6.0, 100.0, 1000.0)
    plant.set_brake_current(9.0)
    plant.advance(500 * MS)
    wanted = 0.05 * 2.0 * np.pi / 60.0  # 0.05 rpm at the output
    plant.set_drive(DriveLoop.VELOCITY, 0.0, wanted * 100.0)
    speeds = []
    for _ in range(400):
        plant.advance(MS)
        if 50.0 < plant.state[S.TORQUE_NM] < 400.0:
            speeds.append(plant.state[S.DRIVEN_RAD_S])
    assert len(speeds) > 100
    assert np.mean(speeds) == pytest.approx(wanted, rel=0.05)
    assert np.max(np.abs(np.array(speeds) / wanted - 1.0)) < 0.1


def test_the_output_bench_measures_the_torque_it_applies(output_config: BenchConfig) -> None:
    plant = Plant(output_config)
    plant.set_drive_limits(6.0, 100.0, 50.0)
    plant.set_brake_current(9.0)
    plant.advance(500 * MS)
    plant.set_drive(DriveLoop.TORQUE, 3.0, 0.0)
    plant.advance(3000 * MS)
    sample = plant.sample()
    assert sample.torque_out_nm == pytest.approx(300.0, abs=3.0)
    assert plant.state[S.LOCKED_RAD] == 0.0
    assert plant.state[S.TORQUE_NM] == pytest.approx(300.0, abs=1.5)


def test_a_motor_in_torque_mode_is_held_at_the_speed_limit(bench_config: BenchConfig) -> None:
    plant = Plant(bench_config)
    plant.set_drive_limits(6.0, 10.0, 1000.0)
    plant.set_drive(DriveLoop.TORQUE, 2.0, 0.0)
    plant.advance(1000 * MS)
    assert plant.state[S.DRIVEN_RAD_S] == pytest.approx(10.0, rel=0.05)
    assert plant.take_limited()
    plant.set_drive(DriveLoop.OFF, 0.0, 0.0)
    plant.advance(1000 * MS)
    plant.take_limited()
    plant.advance(MS)
    assert not plant.take_limited()


def test_sensors_saturate_quantise_and_stick(bench_config: BenchConfig) -> None:
    plant = locked(bench_config)
    row = plant.channels[CHANNELS.index("torque_out")]
    row[CH.FAULT_OFFSET] = 5000.0
    sample = plant.sample()
    assert sample.torque_out_nm == pytest.approx(1100.0, abs=0.01)
    assert sample.status == 2
    row[CH.STUCK], row[CH.STUCK_AT] = 1.0, 12.5
    assert plant.sample().torque_out_nm == 12.5
    counts = sample.angle_in_rad / (2.0 * np.pi / 2**20)
    assert counts == pytest.approx(round(counts), abs=1e-6)


def test_the_same_sample_has_the_same_noise(bench_config: BenchConfig) -> None:
    plant = locked(bench_config)
    before = plant.sample()
    plant.advance(STEP_NS)
    assert plant.sample() == before
    plant.advance(4 * STEP_NS)
    assert plant.sample().counter == before.counter + 1


def test_noise_has_its_rms(bench_config: BenchConfig) -> None:
    plant = locked(bench_config)
    values = []
    for _ in range(3000):
        plant.advance(100_000)
        values.append(plant.sample().torque_out_nm)
    assert np.std(values) == pytest.approx(0.2, rel=0.1)


def test_temperature_rises_with_the_drift(bench_config: BenchConfig) -> None:
    plant = Plant(bench_config)
    start = plant.housing_temp_c
    plant.advance(60_000 * MS)
    share = 1.0 - np.exp(-60.0 / 900.0)
    assert plant.housing_temp_c - start == pytest.approx(6.0 * share, rel=1e-6)
    assert plant.state[S.DRIFT_ARCMIN] == pytest.approx(0.01 * share, rel=1e-6)


def test_a_copy_of_a_plant_goes_on_by_itself_as_the_plant_does(bench_config: BenchConfig) -> None:
    plant = locked(bench_config)
    copied, before = copy.deepcopy(plant), plant.state.copy()
    for one in (plant, copied):
        one.set_drive(DriveLoop.TORQUE, 2.0, 0.0)
        one.params[P.BRAKE_HOLDS] = 0.5
    copied.advance(100 * MS)
    assert plant.state.tobytes() == before.tobytes()
    assert copied.reducer_torque_nm > plant.reducer_torque_nm
    plant.advance(100 * MS)
    assert plant.state.tobytes() == copied.state.tobytes()
    assert plant.sample() == copied.sample()
