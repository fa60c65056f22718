"""`lostmotion study`: the published tables, files that are wrong, and the help of the whole command line."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.trace.errors import AnalysisError
from station.cli import COMMANDS, app, command_line
from station.cli.line.stored_metric import Ask
from station.cli.studies import frequency as command_frequency
from station.cli.studies import studies as command_studies
from station.cli.studies.frequency import band_of
from station.errors import StationError

DATA = Path(__file__).parents[2] / "data"


def printed(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_every_command_has_its_place_in_the_help() -> None:
    shown = CliRunner().invoke(app, ["--help"]).stdout
    sections = {part.partition(":\n")[0]: part.partition(":\n")[2] for part in shown.split("\n\n")}
    listed = {heading: re.findall(r"^  (\S+)", sections[heading], re.MULTILINE) for heading in COMMANDS}
    assert listed == {heading: list(commands) for heading, commands in COMMANDS.items()}
    names = [name for commands in COMMANDS.values() for name in commands]
    assert sorted(names) == sorted(command_line().commands)


def test_the_published_lock_angles(capsys: pytest.CaptureFixture[str]) -> None:
    command_studies.lock_angle(DATA / "lock_angle_tests.csv", [], DATA, 0.95, as_json=True)
    found = printed(capsys)
    assert found["positions"] == 14
    assert set(found["spreads"]) == {"hysteresis_loss_arcsec", "backlash_arcsec"}
    assert found["correlations"][0]["coefficient"] == pytest.approx(0.938, abs=5e-4)
    with pytest.raises(AnalysisError, match="column nothing: found columns"):
        command_studies.lock_angle(DATA / "lock_angle_tests.csv", [Ask("nothing")], DATA, 0.95, as_json=True)
    with pytest.raises(StationError, match="--serial SN and --metric ID"):
        command_studies.lock_angle(None, [Ask("lost_motion")], DATA, 0.95, as_json=True)


def test_a_slope_over_temperature_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "t.csv"
    rows = [f"{20 + 2 * n},{1.0 + 0.02 * n + 0.001 * (-1) ** n}" for n in range(6)]
    path.write_text("\n".join(["temperature_c,value", *rows]))
    command_studies.temperature(path, "value", None, tmp_path, (20.0, 0.95), as_json=True)
    found = printed(capsys)
    assert found["slope_per_c"] == pytest.approx(0.01, abs=3e-4)
    assert found["at_reference"] == pytest.approx(1.0, abs=2e-3)
    command_studies.temperature(path, "value", None, tmp_path, (20.0, 0.95), as_json=False)
    assert "The metric depends on temperature" in capsys.readouterr().out


def test_the_help_says_what_is_taken_without_a_file() -> None:
    for name, taken in (("eccentricity", "a published table"), ("temperature", "the stored runs")):
        shown = CliRunner().invoke(app, ["study", name, "--help"]).stdout
        assert f"Default: {taken}" in " ".join(shown.split())


def test_the_published_eccentricities(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command_studies.eccentricity(None, None, [1.2], free=False, as_json=True)
    found = printed(capsys)
    assert (found["exponent"], len(found["rows"])) == (2.0, 3)
    assert found["at"][0]["stiffness_nm_per_rad"] == pytest.approx(100 / 1.153e-3, rel=1e-3)
    with pytest.raises(StationError, match="cannot be combined"):
        command_studies.eccentricity(None, 2.0, [], free=True, as_json=True)
    with pytest.raises(StationError, match="--at: found 0"):
        command_studies.eccentricity(None, None, [0.0], free=False, as_json=True)
    path = tmp_path / "e.csv"
    path.write_text("eccentricity_mm,torque_nm,deflection_rad\n1,100,0.001\n1.1,100,-1\n")
    with pytest.raises(AnalysisError, match="row 2"):
        command_studies.eccentricity(path, None, [], free=False, as_json=True)


def chirp(path: Path, *, samples: int = 4000) -> Path:
    """A resonance at 40 Hz with 5 % damping, two periods of a chirp at 1 kHz as a bench would record it."""
    step, period = 1e-3, samples / 1000
    time_s = np.arange(4 * samples) * step
    phase = time_s % period
    torque = 10 * np.sin(2 * math.pi * (5 * phase + (95 / (2 * period)) * phase**2))
    frequency = np.fft.rfftfreq(samples, step)
    ratio = frequency / 40.0
    response = 0.01 / (1 - ratio**2 + 2j * 0.05 * ratio)
    one = np.fft.irfft(np.fft.rfft(torque[:samples]) * response, samples)
    angle = np.tile(one, 4) + np.random.default_rng(1).normal(0, 1e-4, time_s.size)
    rows = [f"{t:.3f},{x:.6f},{y:.8f}" for t, x, y in zip(time_s, torque, angle, strict=True)]
    path.write_text("\n".join(["t_s,torque_out_nm,angle_out_arcmin", *rows]))
    return path


def test_a_resonance_is_found_in_a_chirp(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = chirp(tmp_path / "chirp.csv")
    asked = command_frequency.Asked(str(path), "6:90", 4.0, 0.9, None, tmp_path, tmp_path / "lines.csv")
    command_frequency.frequency(asked, as_json=True)
    found = printed(capsys)["resonance"]
    assert found["natural_frequency_hz"] == pytest.approx(40.0, rel=1e-3)
    assert found["damping_ratio"] == pytest.approx(0.05, rel=0.02)
    assert found["stiffness_nm_per_arcmin"] == pytest.approx(100.0, rel=0.01)
    assert (tmp_path / "lines.csv").read_text().startswith("frequency_hz,")
    command_frequency.frequency(
        command_frequency.Asked(str(path), "60:90", 4.0, 0.9, None, tmp_path, None), as_json=True
    )
    without = printed(capsys)
    assert without["resonance"] is None
    assert "none between" in without["reason"]


@pytest.mark.parametrize("text", ["", "5", "5:", "9:3", "0:3", "a:b", "1:inf", "nan:3"])
def test_a_band_is_two_frequencies(text: str) -> None:
    with pytest.raises(StationError, match="--band: found"):
        band_of(text)
