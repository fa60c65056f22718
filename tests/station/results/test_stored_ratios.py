"""Torque ratios of several units in one entry of a bench file: their mean, and how they differ."""

import contextlib
import io
import json
import re
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stored_runs import metric, store_run

from analysis.torque_ratio.quadrants import QUADRANTS
from recipes import RecipeError, check, load_recipe, parse_bench, shipped_benches, warnings
from station.bench.figures import figures_of
from station.bench.virtual_unit import NOT_NAMED
from station.cli import command_line
from station.errors import StationError

VALUES = [metric(0.4)]
OFFSETS = (-13.0, -14.0, -15.6)
U_OFFSET_NM, U_SLOPE = 0.12, 0.06
RECIPE = Path(__file__).parents[3] / "recipes" / "rv-40e-121-inverse.yaml"


def ratio(offset_nm: float, *, bench: str = "virtual", model: str = "RV-40E-121") -> dict[str, Any]:
    """What a run keeps of the torque ratio that it measured."""
    fit = {"u_slope": U_SLOPE, "u_offset_nm": U_OFFSET_NM, "correlation": -0.8, "residual_sd_nm": 0.3, "r_squared": 1.0}
    lines = {
        name: fit | {"slope": 94.0 + number + offset_nm / 100.0, "offset_nm": offset_nm + number}
        for number, name in enumerate(QUADRANTS)
    }
    return {
        "bench": {"name": bench, "revision": 1},
        "model": model,
        "made": "2026-03-01T08:00:00+00:00",
        "transition_rad": 0.001 - offset_nm * 1e-5,
        "quadrants": lines,
    }


def command(data: Path, *args: str) -> str:
    printed = io.StringIO()
    words = ["calibration", *args, "--data", str(data)]
    with contextlib.redirect_stdout(printed):
        assert command_line("calibration")(words, standalone_mode=False) in (0, None)
    return printed.getvalue()


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for number, offset in enumerate(OFFSETS):
        store_run(tmp_path, f"U{number}", VALUES, calibration=ratio(offset), day=number)
    return tmp_path


def bench_of(block: str) -> bytes:
    text = shipped_benches()["virtual"].read_text(encoding="utf-8")
    assert text.count("calibrations: []") == 1
    return text.replace("calibrations: []", block).encode()


def test_the_entry_has_the_mean_and_every_unit(data: Path) -> None:
    bench = parse_bench(bench_of(command(data, "U0", "U1", "U2")), "b.yaml")
    (stored,) = bench.calibrations
    assert stored.load_positive.offset_nm == pytest.approx(np.mean(OFFSETS), abs=1e-4)
    assert stored.load_positive.u_offset_nm == pytest.approx(0.12 / np.sqrt(3.0), rel=1e-4)
    assert stored.load_positive.correlation == pytest.approx(-0.8, rel=1e-4)
    assert stored.made == date(2026, 3, 1)
    found = figures_of(bench, stored).calibrated_units
    assert len(found) == len(OFFSETS)
    for name in QUADRANTS:
        shown = [unit.lines[name][0] for unit in found]
        assert shown == pytest.approx(np.array(OFFSETS) - np.mean(OFFSETS), abs=1e-3)
    assert sum(unit.transition_rad for unit in found) == pytest.approx(0.0, abs=1e-8)


def test_as_json(data: Path) -> None:
    (entry,) = json.loads(command(data, "U0", "U2", "U1", "--json"))["calibrations"]
    assert [unit["serial"] for unit in entry["units"]] == ["U0", "U2", "U1"]
    assert entry["id"].endswith("-3-units")


def test_theil_sen_and_flagged_points_stand_beside_the_lines(data: Path, tmp_path: Path) -> None:
    for number, offset in enumerate(OFFSETS):
        stored = ratio(offset)
        for line in stored["quadrants"].values():
            line |= {"points": 200, "flagged": number, "theil_sen_slope": line["slope"], "theil_sen_offset_nm": offset}
        store_run(tmp_path / "new", f"U{number}", VALUES, calibration=stored, day=number)
    block = command(tmp_path / "new", "U0", "U1", "U2")
    assert (
        "    # load_positive: line that outliers do not affect (Theil–Sen): slope 93.858, offset -14.2 N·m; "
        "3 of 600 points marked as outliers\n" in block
    )
    (entry,), (plain,) = (
        parse_bench(bench_of(text), "b.yaml").calibrations for text in (block, command(data, "U0", "U1", "U2"))
    )
    assert entry.model_copy(update={"id": plain.id}) == plain
    checks = json.loads(command(tmp_path / "new", "U2", "--json"))["checks"]
    assert list(checks) == list(QUADRANTS)
    assert checks["unload_negative"] == {
        "points": 200, "flagged": 2, "theil_sen": {"slope": 96.844, "offset_nm": -15.6}
    }  # fmt: skip


def test_records_of_an_earlier_version_have_no_theil_sen(data: Path) -> None:
    assert "Theil" not in command(data, "U1")
    checks = json.loads(command(data, "U1", "--json"))["checks"]
    assert checks["load_positive"] == {"points": None, "flagged": None, "theil_sen": None}


def test_one_unit_says_that_it_is_one_and_its_use_is_warned_of(data: Path) -> None:
    block = command(data, "U1")
    assert "# Measured on one unit only" in block
    text = RECIPE.read_text(encoding="utf-8").replace("output_torque: reaction", "output_torque: calibrated")
    text = text.replace("calibration: measured", "calibration: stored  ")
    for asked, told in ((block, ["no units"]), (command(data, "U0", "U1", "U2"), [])):
        bench = parse_bench(bench_of(asked), "b.yaml")
        path = data / "r.yaml"
        path.write_text(text, encoding="utf-8")
        said = warnings(load_recipe(path), bench)
        assert len(said) == len(told)
        assert all(word in str(one) for word, one in zip(told, said, strict=True))
        refused = check(load_recipe(path), bench, today=date(2026, 4, 1))
        assert not [one for one in refused if one.option == "measurement.calibration"]


def test_runs_that_have_no_mean_are_refused(data: Path) -> None:
    store_run(data, "U0", VALUES, calibration=ratio(-13.2), day=9)
    store_run(data, "U7", VALUES, calibration=ratio(-13.2, bench="other"), day=10)
    store_run(data, "U8", VALUES, calibration=ratio(-13.2, model="RV-50"), day=11)
    store_run(data, "U9", VALUES, day=12)
    again = sorted(path.parent.name for path in data.glob("*/run.json") if "U0" in path.parent.name)
    for runs, told in (
        (again, "unit U0 was measured in 2 of the runs"),
        (["U1", "U7"], "differ in bench .*other"),
        (["U1", "U8"], "differ in model .*RV-50"),
        (["U1", "U9"], "measured no torque ratio"),
        (["U1", "U2"], "found runs of 2 units; expected 3 or more"),
    ):
        with pytest.raises(StationError, match=told):
            command(data, *runs)


def test_one_unit_under_two_serial_numbers_is_no_second_unit(data: Path) -> None:
    """Its lines differ from its own by nothing: the spread between units would be zero, and U of another one small."""
    store_run(data, "V0", VALUES, calibration=ratio(OFFSETS[0]), day=9)
    with pytest.raises(StationError, match=r"U0 and .*to the last digit.*Name runs of different units"):
        command(data, "U0", "U1", "V0")
    block = command(data, "U0", "U1", "U2")
    twins = block[block.index("      - serial: U0") :].replace("serial: U", "serial: W")
    with pytest.raises(RecipeError, match="found the same lines for unit U0 and unit W0"):
        parse_bench(bench_of(block + twins), "b.yaml")


@pytest.mark.parametrize(
    ("offset_nm", "slope", "told"),
    [
        (0.0, 0.0, "to the last digit"),
        (1e-9, 0.0, "in every quadrant .* within 5 standard uncertainties"),
        (0.84, 0.0, "in every quadrant .* within 5 standard uncertainties"),
        (-0.84, 0.42, "in every quadrant .* within 5 standard uncertainties"),
        (0.86, 0.0, None),
        (0.0, 0.43, None),
    ],
)
def test_lines_as_a_repeat_has_them_are_those_of_one_unit(
    data: Path, offset_nm: float, slope: float, told: str | None
) -> None:
    """Five standard uncertainties of the difference are 0.849 N·m and 0.4243; one coefficient beyond is enough."""
    again = ratio(OFFSETS[0])
    again["quadrants"]["unload_negative"]["offset_nm"] += offset_nm
    again["quadrants"]["load_positive"]["slope"] += slope
    run = store_run(data, "V0", VALUES, calibration=again, day=9)
    if told is None:
        assert command(data, "U0", "U1", "V0")
        return
    with pytest.raises(
        StationError,
        match=f"U0 and {run.id} .*{told}.*Name runs of different units",
    ):
        command(data, "U0", "U1", "V0")


def test_a_virtual_unit_is_one_whatever_its_serial_numbers_are(tmp_path: Path) -> None:
    for number, unit in enumerate(("P1:1", "P1:2", "P1:1", "P1:3")):
        store_run(tmp_path, f"U{number}", VALUES, calibration=ratio(-13.0 - number), day=number, virtual=unit)
    with pytest.raises(StationError, match=r"U0 and .*U2 measured the same virtual unit, P1:1. Name .*different units"):
        command(tmp_path, "U0", "U1", "U2")
    assert command(tmp_path, "U0", "U1", "U3")
    for number in range(4, 6):
        store_run(tmp_path, f"U{number}", VALUES, calibration=ratio(-2.0 - number), day=number, virtual=NOT_NAMED)
    assert command(tmp_path, "U0", "U4", "U5"), "nobody knows which units these were"


def test_runs_of_several_recipes_or_revisions_have_no_mean(data: Path) -> None:
    store_run(data, "U5", VALUES, calibration=ratio(-12.0), day=9, recipe="quick")
    store_run(data, "U6", VALUES, calibration=ratio(-12.0), day=10, revision=2)
    for serial, told in (("U5", "quick revision 1"), ("U6", "inverse revision 2")):
        with pytest.raises(StationError, match=rf"U0 and .*{serial} .*differ in recipe \(inverse revision 1, {told}\)"):
            command(data, "U0", "U1", serial)


def test_nothing_is_taken_from_a_unit_that_failed(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its lines are good, but its friction may be the defect: as that of a good unit it would hide another's play."""
    why = "torque_ratio_offset, side +: -28 N·m is below the limit of -25 N·m"
    run = store_run(data, "U5", VALUES, calibration=ratio(-28.0), failed=why)
    for runs in (["U0", "U1", "U5"], ["U5"]):
        told = re.escape(f"{run.id} was not used: its unit failed ({why}), and the defect may change the friction")
        with pytest.raises(StationError, match=told):
            command(data, *runs)
    assert not capsys.readouterr().err


@pytest.mark.parametrize("serial", ["4711", "0123", "1e3", "true", "A B/7 #2", "LOT: 3", "ß-0", "9" * 128])
def test_whatever_the_serial_number_the_entry_is_read_back(tmp_path: Path, serial: str) -> None:
    for number, offset in enumerate(OFFSETS[1:]):
        store_run(tmp_path, f"U{number}", VALUES, calibration=ratio(offset))
    run = store_run(tmp_path, serial, VALUES, calibration=ratio(-13.0), day=1)
    (stored,) = parse_bench(bench_of(command(tmp_path, "U0", "U1", str(run.folder))), "b.yaml").calibrations
    assert stored.units is not None
    assert [unit.serial for unit in stored.units] == ["U0", "U1", serial]
    assert parse_bench(bench_of(command(tmp_path, str(run.folder))), "b.yaml").calibrations


def test_nothing_is_taken_from_a_run_whose_ramp_was_interrupted(data: Path) -> None:
    held = [{**one, "coverage_factor": 3.0} for one in VALUES]
    run = store_run(data, "U5", held, calibration=ratio(-12.0))
    for runs in (["U0", "U1", "U5"], ["U5"]):
        with pytest.raises(StationError, match=f"run {run.id} was not used: a ramp was interrupted"):
            command(data, *runs)


def test_nothing_is_taken_from_an_invalid_measurement(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drifted = store_run(data, "U3", VALUES, calibration=ratio(-12.0), reasons=["measurement invalid: drift: 2 %"])
    faulted = store_run(data, "U4", VALUES, calibration=ratio(-12.0), scenario="torque_offset")
    for run, told in (
        (drifted, "measurement invalid: drift: 2 %"),
        (faulted, r"faults were injected on purpose \(torque_offset\)"),
    ):
        with pytest.raises(StationError, match=f"run {run.id} was not used: {told}. "):
            command(data, "U0", "U1", str(run.folder))
    assert not capsys.readouterr().err
    near = store_run(data, "U5", VALUES, calibration=ratio(-12.0), reasons=["lost_motion is within its guard band"])
    assert command(data, "U0", "U1", str(near.folder))
    assert capsys.readouterr().err == (
        f"WARNING  {near.id}: its unit is NOT DECIDABLE, and its friction counts as that of a good one\n"
    )


def test_nothing_is_taken_from_an_altered_record(data: Path) -> None:
    (path,) = data.glob("*U1*/calibration.json")
    path.write_text(path.read_text(encoding="utf-8").replace("-14.0", "-11.0"), encoding="utf-8")
    with pytest.raises(StationError, match=r"its record was altered \(calibration\.json"):
        command(data, "U0", "U1")


def test_lines_that_are_not_the_mean_of_their_units_are_refused(data: Path) -> None:
    block = command(data, "U0", "U1", "U2")
    mean = f"{np.mean(OFFSETS):.6g} N·m"
    assert block.count(mean) == 1
    for changed, told in (
        (block.replace(mean, "-13.2 N·m"), "offset -13.2 where the mean of the 3 units is -14.2"),
        (block.replace("serial: U1", "serial: U0"), "unit U0 twice"),
        (block.replace("transition: 0.001142", "transition: 0.0013", 1), "transition 0.0013 where the mean"),
        (block.replace("        transition: 0.00114 rad\n", ""), "found unit U1 without a transition"),
    ):
        with pytest.raises(RecipeError, match=told):
            parse_bench(bench_of(changed), "b.yaml")
