"""Recipes that a bench cannot run: each is refused at its option, with the limit and what to do."""

from __future__ import annotations

import re
from datetime import date

import pytest

from recipes import (
    check,
    default_bench,
    load_bench,
    parse_bench,
    parse_recipe,
    shipped_benches,
    shipped_recipes,
    warnings,
)
from recipes.checks import bus_load
from recipes.checks import limits as check_limits
from recipes.checks import measurement as check_measurement
from recipes.checks import ratings as check_ratings
from recipes.checks import sweep as check_sweeps
from recipes.checks.cross_check import CHECKS, DATED_CHECKS
from recipes.compiler.compiler import compile_program

TODAY = date(2026, 6, 1)
CALIBRATION = (
    "calibrations:\n  - {id: c1, model: RV-40E-121, made: 2026-01-01, due: 2027-01-01,"
    + ",".join(
        f"{name}: {{slope: 94.7, offset: -13.9 N·m}}"
        for name in ("load_positive", "unload_positive", "load_negative", "unload_negative")
    )
    + "}"
)
STEPS = re.compile(r"  - calibrate.*\n|.*torque_ratio_(?:slope|offset).*\n")
FATIGUE = "  - fatigue_cycles: {count: 3, peak_torque: 110 %, torque_rate: 60 N·m/s}\n"


def shipped(name: str) -> tuple[str, str]:
    text = shipped_recipes()[name].read_text(encoding="utf-8")
    bench = default_bench(parse_recipe(text.encode(), name))[0]
    return text, bench.read_text(encoding="utf-8")


def replaced(text: str, changes: dict[str, str]) -> str:
    for old, new in changes.items():
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


INVERSE, STATIC, OUTPUT, MEASUREMENT, SWEEP = (
    "rv-40e-121-inverse",
    "static-50nm",
    "rv-40e-121-output",
    "rv-40e-121-measurement",
    "rv-40e-121-sweep",
)

# recipe, changes of the recipe, changes of its bench, option of the problem, words
CASES = {
    "other side": (INVERSE, {"loading: input": "loading: output"}, {}, "loading", "drives the input shaft"),
    "other model": (STATIC, {"model: RV-50": "model: RV-60"}, {}, "unit_under_test.model", "allowed: RV-50"),
    "above the unit": (
        INVERSE, {"3, peak_torque: 110 %": "3, peak_torque: 201 %"}, {}, "torque_cycles.peak_torque",
        "828.12 N·m, 201% of the rated torque; allowed: up to 200 %",
    ),
    "above the output sensor": (
        INVERSE, {}, {"full_scale: 1000": "full_scale: 450"}, "torque_cycles.peak_torque", "up to 450 N·m, full scale",
    ),
    "above the input sensor": (
        INVERSE, {"3, peak_torque: 110 %": "3, peak_torque: 113 %"}, {}, "torque_cycles.peak_torque",
        "which is 5.063 N·m at the input; allowed: up to 459.6 N·m",
    ),
    "above the brake": (
        INVERSE, {"600 N·m": "1001 N·m"}, {}, "lock.holding_torque", "up to 1000 N·m, the brake's torque at 10 A",
    ),
    "lock too weak": (INVERSE, {"600 N·m": "480 N·m"}, {}, "lock.holding_torque", "at least 498.5 N·m, 1.1 times"),
    "lock too weak at the input": (OUTPUT, {"6 N·m": "2.5 N·m"}, {}, "lock.holding_torque", "at least 2.727 N·m"),
    "drive and angle sensor hardly compared": (
        OUTPUT, {}, {"angle_agreement: 0.5 arcmin": "angle_agreement: 6 arcmin"}, "speed_cycles.peak_torque",
        "too little to show that its angle sensor stands still; allowed: a turn of 4 times the bench's angle_agreement",
    ),
    "proof above holding": (
        INVERSE, {"proof_torque: 10 %": "proof_torque: 150 %"}, {}, "lock.proof_torque",
        "below holding_torque, 600 N·m",
    ),
    "slip below the fixture": (
        INVERSE, {"lock_slip: 0.5 arcmin": "lock_slip: 0.04 arcmin"}, {}, "interlocks.lock_slip", "above 0.0453 arcmin",
    ),
    "above the drive": (
        INVERSE, {}, {"max_torque: 5.5 N·m": "max_torque: 4.9 N·m"}, "torque_cycles.peak_torque",
        "takes 4.932 N·m of the drive; allowed: up to 4.9 N·m at the input shaft",
    ),
    "above the drive's gearbox": (
        OUTPUT, {}, {"gear_ratio: 100": "gear_ratio: 50"}, "speed_cycles.peak_torque", "up to 275 N·m at the output",
    ),
    "faster than the motor": (
        STATIC, {"speed: 0.5 rpm": "speed: 130 rpm"}, {}, "speed_cycles.speed", "up to 120 rpm, the drive's max_speed",
    ),
    "faster than the interlock": (
        STATIC, {"speed: 30 rpm": "speed: 0.4 rpm"}, {}, "speed_cycles.speed", "below 0.4 rpm of the loaded shaft",
    ),
    "alarm below the peak": (
        INVERSE, {"alarm: 114 %": "alarm: 110 %"}, {}, "torque_cycles.peak_torque",
        "453.2 N·m, which is never reached; allowed: below torque_out_alarm, 453.2 N·m",
    ),
    "input trip below the peak": (
        INVERSE, {"torque_in_trip: 5.4 N·m": "torque_in_trip: 4.9 N·m"}, {}, "torque_cycles.peak_torque",
        "its 4.932 N·m at the input trip first",
    ),
    "travel below the peak": (
        INVERSE, {"travel: 60 deg": "travel: 9 deg"}, {}, "torque_cycles.peak_torque", "the input shaft turns 9.14 deg",
    ),
    "time limit too short": (
        OUTPUT, {"time_limit: 120 s": "time_limit: 40 s"}, {}, "speed_cycles.time_limit",
        "40 s for a ramp that takes about 35.2 s; allowed: at least 42.2 s",
    ),
    "endless ramp": (
        INVERSE, {"60 N·m/s, dwell: 500": "0.1 N·m/s, dwell: 500"}, {}, "torque_cycles.torque_rate",
        "at least 0.504 N·m/s",
    ),
    "ramp faster than the shaft": (
        INVERSE, {"speed: 60 rpm": "speed: 0.1 rpm"}, {}, "torque_cycles.torque_rate", "turns at 0.202 rpm",
    ),
    "implausible rate": (
        INVERSE, {"travel: 60 deg": "torque_rate: 50 N·m/s\n  travel: 60 deg"}, {}, "torque_cycles.torque_rate",
        "below 50 N·m/s, interlocks.torque_rate",
    ),
    "sweep faster than the drive": (
        SWEEP, {"to_frequency: 0.5 Hz": "to_frequency: 0.9 Hz"}, {}, "torque_sweep.to_frequency", "up to 0.744 Hz",
    ),
    "sweep through too much friction": (
        SWEEP, {"amplitude: 40 N·m": "amplitude: 16 N·m", "to_frequency: 0.5": "to_frequency: 2"}, {},
        "torque_sweep.to_frequency", "the friction of 13.9 N·m turns twice in a cycle",
    ),
    "sweep that falls": (
        SWEEP, {"to_frequency: 0.5": "to_frequency: 0.25"}, {}, "torque_sweep.to_frequency", "above 0.25 Hz",
    ),
    "sweep of few lines": (
        SWEEP, {"to_frequency: 0.5": "to_frequency: 0.3"}, {}, "torque_sweep.to_frequency", "at least 0.375 Hz",
    ),
    "sweep that moves nothing": (
        SWEEP, {"amplitude: 40 N·m": "amplitude: 10 N·m"}, {}, "torque_sweep.amplitude", "above 13.9 N·m",
    ),
    "sweep of few cycles": (SWEEP, {"period: 32 s": "period: 12 s"}, {}, "torque_sweep.period", "at least 16 s"),
    "sweep through zero": (
        SWEEP, {"amplitude: 40 N·m": "amplitude: 120 N·m"}, {}, "torque_sweep.amplitude", "up to half of peak_torque",
    ),
    "sweep faster than the interlock": (
        SWEEP, {"travel: 60 deg": "torque_rate: 120 N·m/s\n  travel: 60 deg"}, {}, "torque_sweep.to_frequency",
        "below 120 N·m/s, interlocks.torque_rate",
    ),
    "sweep beyond the shaft's speed": (
        SWEEP, {"speed: 60 rpm": "speed: 0.34 rpm"}, {}, "torque_sweep.to_frequency", "interlocks.speed",
    ),
    "serial line slower than the period": (
        INVERSE, {},
        {"transport: tcp": "transport: rtu", "port: 1502": "serial_port: /dev/ttyUSB0\n  baudrate: 19200"},
        "sampling.period", "one sample over /dev/ttyUSB0 takes at least 15.62 ms at 19200 baud",
    ),
    "steps too small": (MEASUREMENT, {"steps: 11": "steps: 300"}, {}, "step_cycles.steps", "300 steps of 1.51 N·m"),
    "trip beyond the output sensor": (
        INVERSE, {"torque_out_trip: 120 %": "torque_out_trip: 1101 N·m"}, {}, "interlocks.torque_out_trip",
        "up to 1100 N·m",
    ),
    "trip beyond the input sensor": (
        INVERSE, {"torque_in_trip: 5.4 N·m": "torque_in_trip: 5.6 N·m"}, {}, "interlocks.torque_in_trip",
        "up to 5.5 N·m",
    ),
    "tare too large": (
        INVERSE, {"torque_in_tare: 0.05 N·m": "torque_in_tare: 0.6 N·m"}, {}, "home.torque_in_tare",
        "up to 0.5 N·m, 10%",
    ),
    "release under load": (
        INVERSE, {"max_torque: 2 %": "max_torque: 20 %"}, {}, "release.max_torque", "up to 10% of the rated torque",
    ),
    "release below the sensor": (
        INVERSE, {"max_torque: 2 %": "max_torque: 0.5 N·m"}, {}, "release.max_torque", "cannot tell from zero",
    ),
    "reaction without sensor": (
        INVERSE, {}, {"  torque_out: ": "  # "}, "measurement.output_torque", "has no output torque sensor",
    ),
    "calibrated without sensor": (
        MEASUREMENT, {}, {"  torque_in: ": "  # "}, "measurement.output_torque", "has no input torque sensor",
    ),
    "calibrated at the output": (
        OUTPUT, {"reaction": "calibrated"}, {}, "measurement.output_torque", "with the load at the output",
    ),
    "never calibrated": (
        MEASUREMENT, {"  - calibrate": "  # "}, {}, "measurement.calibration", "without a step calibrate",
    ),
    "calibrated twice": (
        INVERSE, {"calibration: measured": "calibration: stored"}, {"calibrations: []": CALIBRATION}, "calibrate",
        "with 'calibration: stored'",
    ),
    "nothing stored": (
        INVERSE, {"calibration: measured": "calibration: stored"}, {}, "measurement.calibration",
        "bench 'virtual' has no calibration for RV-40E-121",
    ),
    "stored too long ago": (
        INVERSE, {"calibration: measured": "calibration: stored"},
        {"calibrations: []": CALIBRATION.replace("2027", "2026").replace("due: 2026-01", "due: 2026-05")},
        "measurement.calibration", "calibration 'c1' of bench 'virtual' was due on 2026-05-01",
    ),
    "metric without calibrate": (
        INVERSE, {re.search(r"  - calibrate.*\n", shipped(INVERSE)[0])[0]: ""}, {}, "metrics[12].id", "calibrate only",
    ),
    "metric beyond the cycles": (
        OUTPUT, {"  reference_torque: 300 N·m": "  # "}, {}, "metrics[7].id", "'windup', which is read at 412 N·m",
    ),
    "metric asked twice": (
        INVERSE, {"- {id: windup}": "- {id: stiffness_lsq}"}, {}, "metrics[11].id", "'stiffness_lsq' a second time",
    ),
    "nothing measured": (
        INVERSE, {re.search(r"  - torque_cycles.*\n", shipped(INVERSE)[0])[0]: FATIGUE}, {}, "metrics",
        "metrics, but no measured cycles",
    ),
    "period below the poll": (
        INVERSE, {"period: 1 ms": "period: 0.5 ms"}, {"poll_every: 500 µs": "poll_every: 1 ms"}, "sampling.period",
        "from 1 ms",
    ),
    "sample age below the poll": (
        INVERSE, {"sample_age: 20 ms": "sample_age: 1 ms"}, {}, "sampling.sample_age", "at least 2 ms",
    ),
    "samples older than the drive waits": (
        INVERSE, {"  speed: 60 rpm": "  sample_age: 51 ms\n  speed: 60 rpm"}, {}, "interlocks.sample_age",
        "found 51 ms; allowed: up to 50 ms: the drive waits 50 ms for a set-point (drive.setpoint_timeout of the",
    ),
    "a drive that waits less than the default": (
        INVERSE, {}, {"setpoint_timeout: 50 ms": "setpoint_timeout: 15 ms"}, "interlocks.drive_age",
        "found 20 ms; allowed: up to 15 ms",
    ),
    "brake age below the poll": (
        INVERSE, {}, {"poll_every: 10 ms": "poll_every: 60 ms"}, "interlocks.brake_age", "at least 120 ms",
    ),
    "ratio that does not fit the torques": (
        INVERSE, {"  ratio: 121": "  ratio: 141"}, {}, "loading_torque_ratio.slope",
        "a slope of 94.7 with a ratio of 141, which is an efficiency of 67.2 %; allowed: one from 70 % to 86 %",
    ),
    "set-points too rare": (
        INVERSE, {"period: 1 ms": "period: 10 ms"},
        {"setpoint_timeout: 50 ms": "setpoint_timeout: 15 ms"}, "sampling.period",
        "up to 7.5 ms: the drive waits 15 ms",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_refused_at_its_option(name):
    base, in_recipe, in_bench, option, words = CASES[name]
    text, bench_text = shipped(base)
    recipe = parse_recipe(replaced(text, in_recipe).encode(), "r.yaml")
    bench = parse_bench(replaced(bench_text, in_bench).encode(), "b.yaml")
    problems = check(recipe, bench, today=TODAY)
    matching = [one for one in problems if one.option.endswith(option) and words in str(one)]
    assert matching, [str(one) for one in problems]
    assert all(one.line > 1 and one.column >= 1 and one.hint for one in matching)
    assert [(one.line, one.column) for one in problems] == sorted((one.line, one.column) for one in problems)


def test_the_place_is_that_of_the_value():
    text, bench_text = shipped(INVERSE)
    text = text.replace("3, peak_torque: 110 %", "3, peak_torque: 113 %")
    (problem,) = check(parse_recipe(text.encode(), "r.yaml"), parse_bench(bench_text.encode(), "b.yaml"))
    line = text.split("\n")[problem.line - 1]
    assert line[problem.column - 1 :].startswith("113 %")
    assert str(problem).startswith(f"r.yaml:{problem.line}:{problem.column}: sequence[3].torque_cycles.peak_torque: ")


def test_a_stored_calibration_in_date_is_accepted():
    text, bench_text = shipped(MEASUREMENT)
    text = STEPS.sub("", text).replace("calibration: measured", "calibration: stored")
    bench = parse_bench(bench_text.replace("calibrations: []", CALIBRATION).encode(), "b.yaml")
    assert check(parse_recipe(text.encode(), "r.yaml"), bench, today=TODAY) == []


def test_recipe_made_without_a_file_has_its_problems_too():
    text, _ = shipped(INVERSE)
    loaded = parse_recipe(text.encode(), "r.yaml")
    made = type(loaded).model_validate_json(loaded.model_dump_json())
    assert made.model_dump() == loaded.model_dump()
    (problem,) = check(made, load_bench("virtual-output"))
    assert (problem.path, problem.line) == (INVERSE, 1)


@pytest.mark.parametrize(("count", "names"), [(0, ""), (1, "for torque_in"), (2, "for torque_in and torque_out")])
def test_a_torque_sensor_that_is_declared_without_noise_is_told(count, names):
    text, bench_text = shipped(INVERSE)
    bench = parse_bench(bench_text.replace("noise: 0.02 %", "noise: 0 %", count).encode(), "b.yaml")
    said = warnings(parse_recipe(text.encode(), "r.yaml"), bench)
    assert [one.option for one in said] == ["measurement.output_torque"] * bool(count)
    assert [one for one in said if not one.found.endswith(names)] == []


def test_every_check_is_in_the_table():
    written = {
        value
        for module in (bus_load, check_limits, check_measurement, check_ratings, check_sweeps)
        for name, value in vars(module).items()
        if name.startswith("check_")
    }
    assert written == {*CHECKS, *DATED_CHECKS}
    assert len(set(CHECKS)) == len(CHECKS)


@pytest.mark.parametrize("name", shipped_recipes())
def test_shipped_recipes_run_on_their_default_bench(name):
    recipe = parse_recipe(shipped_recipes()[name].read_bytes(), name)
    assert check(recipe, default_bench(recipe)[1], today=TODAY) == []


@pytest.mark.parametrize("name", shipped_benches())
def test_no_shipped_bench_makes_a_check_crash(name):
    for path in shipped_recipes().values():
        check(parse_recipe(path.read_bytes(), path.name), load_bench(name), today=TODAY)


@pytest.mark.parametrize("highest_hz", [0.75, 0.77, 0.8])
def test_a_sweep_is_never_faster_than_what_was_checked(highest_hz: float) -> None:
    text, bench = shipped(SWEEP)
    text = replaced(text, {"to_frequency: 0.5 Hz": f"to_frequency: {highest_hz} Hz"})
    program = compile_program(parse_recipe(text.encode(), SWEEP), parse_bench(bench.encode(), "bench"))
    sweep = next(one.sweep for one in program.segments if one.sweep is not None)
    assert sweep.from_hz < sweep.to_hz <= highest_hz + 1e-6
    cycles = (sweep.from_hz + sweep.to_hz) / 2.0 * sweep.period_scans * program.period_s
    assert cycles == pytest.approx(round(cycles), abs=1e-9)
