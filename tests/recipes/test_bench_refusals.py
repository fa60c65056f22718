"""Wrong bench files: what is out of range, missing or contradicts itself is refused in words."""

from __future__ import annotations

import pytest
from refusal_support import problems

from recipes import RecipeError, load_bench, parse_bench, shipped_benches

BENCH = shipped_benches()["virtual"].read_text(encoding="utf-8")

CURVE = """  curve:
    {id: a, made: 2026-01-01, due: 2027-01-01, angles: loaded,
     points: [{torque: -480 N·m, deflection: -0.5 arcmin}, {torque: 480 N·m, deflection: 0.5 arcmin}]}
"""

BENCH_CASES = {
    "rtu without a port": ("transport: tcp", "transport: rtu", "rtu and no serial port"),
    "one node for two": ("node_id: 126 ", "node_id: 5 ", "found 5 for the drive and the controller"),
    "time-out below heartbeat": ("timeout: 100 ms ", "timeout: 30 ms ", "at least twice controller_heartbeat, 40 ms"),
    "bits": ("20 bit", "20.5 bit", "Write a whole number of this unit."),
    "unknown sensor": ("torque_out:", "torque_uot:", "Did you mean 'torque_out'?"),
    "torque sensor without error": ("accuracy: 0.1 %", "accuracy: 0 %", "allowed: a fraction such as '0.1 %', above 0"),
    "torque sensor of any error": ("accuracy: 0.1 %", "accuracy: 100 %", "above 0 and up to 10 %. This is too large"),
    "no hysteresis": ("noise: 0.02 %", "noise: 0.02 %, reversibility: 0 %", "reversibility: found '0 %'"),
    "nothing left by the tare": ("noise: 0.02 %", "noise: 0.02 %, tared_zero: 0 %", "tared_zero: found '0 %'"),
    "all noise": ("noise: 0.02 %", "noise: 100 %", "noise: found '100 %'"),
    "encoder without error": ("noise: 0 arcsec", "noise: 0 arcsec, accuracy: 0 arcsec", "accuracy: found '0 arcsec'"),
    "encoder of perfect lines": ("noise: 0 arcsec", "noise: 0 arcsec, interpolation: 0 arcsec", "interpolation: found"),
    "fixture without error": (
        "10000 N·m/arcmin ",
        "10000 N·m/arcmin\n  accuracy: 0 % ",
        "fixture.accuracy: found '0 %'",
    ),
    "fixture that nobody knows": (
        "  stiffness: 10000 N·m/arcmin ",
        "  accuracy: 5 % ",
        "found neither stiffness nor parts; allowed: stiffness, with or without a curve; or parts with",
    ),
    "fixture stated twice": (
        "10000 N·m/arcmin ",
        "10000 N·m/arcmin\n  parts: {output: 5000 N·m/arcmin, input: 0.5 N·m/arcmin} ",
        "fixture.parts: found both parts and stiffness",
    ),
    "parts of a blank test": (
        "  stiffness: 10000 N·m/arcmin ",
        f"  parts: {{output: 5000 N·m/arcmin, input: 0.5 N·m/arcmin}}\n{CURVE}#",
        "fixture.parts: found both parts and curve",
    ),
    "one part": (
        "stiffness: 10000 N·m/arcmin ",
        "parts: {output: 5000 N·m/arcmin} ",
        "fixture.parts.input",
    ),
    "part of the input at the output": (
        "stiffness: 10000 N·m/arcmin ",
        "parts: {output: 5000 N·m/arcmin, input: 7320 N·m/arcmin} ",
        "above 0 and up to 1000 N·m/arcmin",
    ),
    "curve of another fixture": (
        "calibrations: []",
        CURVE + "calibrations: []",
        "a curve of 960 N·m/arcmin and a stiffness of 10000 N·m/arcmin; allowed: a curve of 5000 N·m/arcmin to",
    ),
    "curve of two encoders that is softer than the whole fixture": (
        "calibrations: []",
        CURVE.replace("angles: loaded", "angles: both") + "calibrations: []",
        "a curve of 960 N·m/arcmin and a stiffness of 10000 N·m/arcmin; allowed: a curve of 5000 N·m/arcmin or more",
    ),
    "bitrate": ("bitrate: 1000000", "bitrate: 1000", "found 1000"),
    "host": ("host: 127.0.0.1\n  port: 1502", "host: 3\n  port: 1502", "amplifier.host: found 3; allowed: a text. Put"),
    "date": (
        "calibrations: []",
        "calibrations: [{id: a, model: b, made: 2026-02-30, due: soon, load_positive: {slope: 1, offset: 0 N·m}}]",
        "a date such as 2025-03-31",
    ),
    "device path": ("profile: virtual-drive", "profile: virtual drive", "a short name without spaces"),
}


def calibrations(*entries: tuple[str, str, str]) -> str:
    lines = ", ".join(
        f"{name}: {{slope: 94.7, offset: -13.9 N·m}}"
        for name in ("load_positive", "unload_positive", "load_negative", "unload_negative")
    )
    rows = (
        f"  - {{id: {one}, model: {model}, made: {made}, due: 2027-01-01, {lines}}}\n" for one, model, made in entries
    )
    return BENCH.replace("calibrations: []", "calibrations:\n" + "".join(rows))


def test_calibrations_that_cannot_be_told_apart_are_refused_by_their_names() -> None:
    apart = calibrations(("a", "M", "2026-01-01"), ("b", "M", "2026-01-02"), ("c", "N", "2026-01-01"))
    assert parse_bench(apart.encode(), "b.yaml").newest_calibration("M").id == "b"
    (day,) = problems(calibrations(("a", "M", "2026-01-01"), ("b", "M", "2026-01-01")), parse_bench)
    assert "calibrations[1].made: found 'a' and 'b' of M, both made 2026-01-01" in day
    (name,) = problems(calibrations(("a", "M", "2026-01-01"), ("a", "N", "2026-02-01")), parse_bench)
    assert "calibrations[1].id: found 'a' of N, made 2026-02-01, and of M, made 2026-01-01" in name


SPREADS = {
    "u_offset": ("-1 N·m", "0 N·m", "from 0 up to 20000 N·m"),
    "u_slope": ("-0.1", "0", "a number from 0"),
    "residual_sd": ("-3 N·m", "0 N·m", "from 0 up to 20000 N·m"),
}


@pytest.mark.parametrize("option", SPREADS)
def test_a_standard_deviation_or_uncertainty_below_zero_is_refused(option: str) -> None:
    """Squared it made a line as sure as its size says."""
    wrong, least, words = SPREADS[option]
    text, line = calibrations(("a", "M", "2026-01-01")), "unload_negative: {slope: 94.7, "
    (found,) = problems(text.replace(line, f"{line}{option}: {wrong}, "), parse_bench)
    assert f"calibrations[0].unload_negative.{option}: found" in found
    assert words in found
    assert parse_bench(text.replace(line, f"{line}{option}: {least}, ").encode(), "b.yaml").calibrations


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("noise: 0.02 %", "noise: -0.02 %"),
        ("noise: 0 arcsec", "noise: -1 arcsec"),
        ("10000 N·m/arcmin ", "10000 N·m/arcmin\n  drift: -1 arcmin/min "),
        ("10000 N·m/arcmin ", "10000 N·m/arcmin\n  lock_width: -1 arcsec "),
        ("10000 N·m/arcmin ", "10000 N·m/arcmin\n  lock_windup: -1 % "),
    ],
)
def test_no_noise_and_no_limit_of_an_error_is_below_zero(old: str, new: str) -> None:
    assert old in BENCH
    (found,) = problems(BENCH.replace(old, new, 1), parse_bench)
    assert "from 0" in found


@pytest.mark.parametrize("name", BENCH_CASES)
def test_wrong_bench_files(name):
    old, new, words = BENCH_CASES[name]
    assert old in BENCH
    found = problems(BENCH.replace(old, new, 1), parse_bench)
    assert words in "\n".join(found)
    assert not [message for message in found if message.endswith("allowed: ")]


def test_a_mistyped_shipped_name():
    with pytest.raises(RecipeError, match="Did you mean 'virtual-static'"):
        load_bench("virtual-statik")


def test_devices_on_one_serial_line_talk_alike() -> None:
    rtu = BENCH
    for port, settings in (("1503", "parity: even"), ("1504", "parity: none")):
        rtu = rtu.replace(
            f"transport: tcp\n  host: 127.0.0.1\n  port: {port}\n",
            f"transport: rtu\n  serial_port: /dev/ttyUSB0\n  {settings}\n",
        )
    (problem,) = problems(rtu, parse_bench)
    assert "115200 baud, parity none, 1 stop bit on /dev/ttyUSB0, where brake has 115200 baud, parity even" in problem
    assert "remote_io" in problem
    alike = parse_bench(rtu.replace("parity: none", "parity: even").encode(), "b.yaml")
    assert alike.remote_io.parity == "even"
