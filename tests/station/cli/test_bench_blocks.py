"""What was measured of the bench becomes a block that a bench file takes; limits of gates come from the recipe."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import re
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lostmotion_command import here
from run_copies import copy_of, from_before

from analysis.torque_ratio.quadrants import QUADRANTS
from analysis.uncertainty.figures import LineCovariance
from definitions.checks import CHECKS
from recipes import (
    RecipeError,
    check,
    load_bench,
    load_recipe,
    parse_bench,
    parse_recipe,
    shipped_benches,
    shipped_recipes,
)
from recipes.schema.calibration_schema import QuadrantLine
from station.cli import command_line
from station.errors import StationError
from station.records.run_record import RunRecord
from station.results.evaluation import figures_for, method_of

ROOT = Path(__file__).parents[3]
RECIPE = ROOT / "recipes" / "rv-40e-121-quick.yaml"
ARC = np.pi / 10_800
STIFFNESS = 4000.0


def command(*args: str) -> str:
    """Run a command in this process; return what it prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert command_line(args[0])(list(args), standalone_mode=False) in (0, None)
    return printed.getvalue()


def bench_with(block: str, name: str) -> str:
    """Return the shipped virtual bench with one top-level block replaced."""
    text = shipped_benches()["virtual"].read_text(encoding="utf-8")
    return re.sub(rf"(?ms)^{name}:.*?(?=^\w|\Z)", block.rstrip() + "\n", text)


@pytest.fixture(scope="module")
def dummy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A loop on a rigid dummy, measured at the input alone."""
    path = tmp_path_factory.mktemp("blank") / "dummy.csv"
    torque = np.concatenate((np.linspace(-450, 450, 2000), np.linspace(450, -450, 2000)))
    branch = ["forward"] * 2000 + ["return"] * 2000
    rows = (f"{t:.6f},{t / STIFFNESS * 121 * ARC:.9f},{b}" for t, b in zip(torque, branch, strict=True))
    path.write_text("torque_out_nm,angle_in_rad,branch\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_a_blank_test_becomes_the_fixture_of_a_bench_file(dummy: Path) -> None:
    block = command("blank", str(dummy), "--recipe", str(RECIPE), "--id", "blank-7", "--due", "2999-01-01")
    bench = parse_bench(bench_with(block, "fixture").encode(), "b.yaml")
    curve = bench.fixture.curve
    assert curve is not None
    assert (curve.id, curve.angles, curve.due) == ("blank-7", "loaded", date(2999, 1, 1))
    assert bench.fixture.stiffness_nm_per_arcmin == pytest.approx(STIFFNESS, rel=1e-4)
    method = method_of(load_recipe(RECIPE), bench)
    assert method.fixture_curve is not None
    assert method.fixture_curve.stiffness_at(300.0) == pytest.approx(STIFFNESS, rel=1e-3)
    plain = json.loads(command("blank", str(dummy), "--recipe", str(RECIPE), "--json"))
    assert set(plain["fixture"]["curve"]) == {"id", "made", "due", "angles", "points"}


def test_a_blank_test_that_is_due_is_refused(dummy: Path) -> None:
    block = command("blank", str(dummy), "--recipe", str(RECIPE), "--id", "old")
    recipe = load_recipe(RECIPE)
    block = re.sub(r"made: .*", "made: 2020-01-01", re.sub(r"due: .*", "due: 2021-01-01", block))
    bench = parse_bench(bench_with(block, "fixture").encode(), "b.yaml")
    (problem,) = check(recipe, bench, today=date(2022, 1, 1))
    assert "blank test 'old'" in problem.found
    assert "2021-01-01" in problem.found
    assert check(recipe, bench, today=date(2020, 6, 1)) == []
    (problem,) = check(recipe, bench, today=date(2019, 6, 1))
    assert "a date in the future" in problem.found


def test_a_blank_test_that_ends_below_the_peak_of_the_recipe_is_refused(dummy: Path) -> None:
    """A curve continued straight from 50 to 453 N·m says nothing of the fixture there."""
    block = command("blank", str(dummy), "--recipe", str(RECIPE), "--id", "short", "--due", "2999-01-01")
    short = re.sub(r"(?m)^.*torque: -?(?:[1-4]\d\d|9\d|6\d)(?:\.\d+)? N·m.*\n", "", block)
    bench = parse_bench(bench_with(short, "fixture").encode(), "b.yaml")
    assert bench.fixture.curve is not None
    assert bench.fixture.curve.points[-1].torque_nm < 100.0
    (problem,) = check(load_recipe(RECIPE), bench)
    assert "blank test 'short'" in problem.found
    assert "where the cycles turn" in problem.allowed


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (("angles: loaded", "angles: some"), "both"),
        (("{torque: -450 N·m", "{torque: 450 N·m"), "torques that rise"),
        (("due: 2999-01-01", "due: 1999-01-01"), "a day after"),
    ],
)
def test_a_curve_that_is_none_is_refused_with_its_place(dummy: Path, edit: tuple[str, str], told: str) -> None:
    block = command("blank", str(dummy), "--recipe", str(RECIPE), "--due", "2999-01-01")
    assert edit[0] in block
    with pytest.raises(RecipeError) as refused:
        parse_bench(bench_with(block.replace(*edit), "fixture").encode(), "b.yaml")
    (problem,) = refused.value.problems
    assert told in problem.allowed
    assert problem.line > 1


def test_a_blank_test_needs_a_file_and_a_recipe(dummy: Path, tmp_path: Path) -> None:
    for args, told in (
        (("blank", str(dummy)), "--recipe is missing"),
        (("blank", str(tmp_path / "no.csv"), "--recipe", str(RECIPE)), "there is no such file"),
        (("blank", str(dummy), "--recipe", str(RECIPE), "--due", "soon"), "expected a date"),
        (("blank", str(dummy), "--recipe", str(RECIPE), "--due", "1999-01-01"), "expected a day after"),
    ):
        with pytest.raises(StationError, match=told):
            command(*args)


def changed(run: RunRecord, name: str, **changes: Any) -> None:
    """Change entries of a file of a run, and of its checksum: no chain knows the run."""
    run.write_json(name, run.read_json(name) | changes)
    if name != "run.json":
        files = run.read_json("run.json")["files"]
        content = (run.folder / name).read_bytes()
        files[name] = {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}
        run.update(files=files)


def altered(run: RunRecord) -> None:
    with (run.folder / "recipe.yaml").open("ab") as file:
        file.write(b"\n")


def only_simulated(run: RunRecord) -> None:
    changed(run, "run.json", bench=run.read_json("run.json")["bench"] | {"embedded": False})


def with_faults(run: RunRecord) -> None:
    changed(run, "run.json", scenario="scenarios/late.yaml")


def badly_recorded(run: RunRecord) -> None:
    why = "measurement invalid: missed_periods: 7 of 9 scan periods were missed"
    changed(run, "result.json", verdict="NOT DECIDABLE", reasons=[why], metrics=[])
    changed(run, "run.json", verdict="NOT DECIDABLE")


@pytest.mark.usefixtures("place")  # this computer does not know the run from its own chain
@pytest.mark.parametrize("export", [False, True])
@pytest.mark.parametrize("change", [altered, only_simulated, with_faults, badly_recorded])
def test_a_run_that_says_nothing_of_its_bench_is_no_block_of_a_bench_file(
    quick_run: Any, tmp_path: Path, change: Callable[[RunRecord], None], *, export: bool
) -> None:
    run = from_before(copy_of(quick_run.record, tmp_path))
    data = ("--data", str(tmp_path))
    change(run)
    blank = ("blank", "last", *data)
    if export:
        file = tmp_path / "dummy.parquet"
        here("export", "last", "--format", "parquet", "--out", str(file), *data)
        blank = ("blank", str(file), "--recipe", str(RECIPE))
    commands = [blank] if export else [blank, ("calibration", "last", *data)]
    for one in commands:
        with pytest.raises(StationError, match="was not used"):
            command(*one)


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize("export", [False, True])
def test_a_blank_test_takes_the_bench_file_of_its_own_bench_only(
    quick_run: Any, tmp_path: Path, *, export: bool
) -> None:
    from_before(copy_of(quick_run.record, tmp_path))
    data, text = ("--data", str(tmp_path)), shipped_benches()["virtual"].read_text(encoding="utf-8")
    own, other = tmp_path / "own.yaml", tmp_path / "other.yaml"
    own.write_text(text, encoding="utf-8")
    other.write_text(re.sub(r"(?m)^  name: .*$", "  name: another", text, count=1), encoding="utf-8")
    assert load_bench(other).bench.name == "another"
    source = "last"
    if export:
        source = str(tmp_path / "dummy.parquet")
        here("export", "last", "--format", "parquet", "--out", source, *data)
    asked = ("blank", source, "--recipe", str(RECIPE), *data)
    assert "curve:" in command(*asked, "--bench", str(own))
    with pytest.raises(StationError, match="measured on bench"):
        command(*asked, "--bench", str(other))
    own.write_text(text.replace("\nbench:\n", "\nbench:\n  public_key:\n", 1), encoding="utf-8")
    assert parse_bench(own.read_bytes(), str(own)).bench.public_key is None  # in a record it opens as ever
    with pytest.raises(RecipeError, match="public_key"):
        command(*asked, "--bench", str(own))


@pytest.mark.usefixtures("place")
def test_a_blank_test_that_is_no_reducer_is_used_and_told_of(
    quick_run: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, blank = from_before(copy_of(quick_run.record, tmp_path)), ("blank", "last", "--data", str(tmp_path))
    quiet = command(*blank)
    assert "curve:" in quiet
    assert "WARNING" not in capsys.readouterr().err
    why = "measurement invalid: loss: the hysteresis loss is too small for a reducer"
    changed(run, "result.json", verdict="NOT DECIDABLE", reasons=[why], metrics=[])
    changed(run, "run.json", verdict="NOT DECIDABLE")
    assert command(*blank) == quiet
    assert why in capsys.readouterr().err


def test_a_measured_torque_ratio_becomes_a_stored_one(quick_run: Any, tmp_path: Path) -> None:
    result: dict[str, Any] = quick_run.ran.json
    data = quick_run.copy(tmp_path / "data").parent
    assert [gate["id"] for gate in result["gates"]] == list(CHECKS)
    assert all(gate["passed"] is not False for gate in result["gates"])
    assert {stage["stage"] for stage in result["stages"]} >= {"drift", "fixture", "time alignment"}
    block = command("calibration", "last", "--data", str(data))
    bench = parse_bench(bench_with(block, "calibrations").encode(), "b.yaml")
    (stored,) = bench.calibrations
    slope = next(metric for metric in result["metrics"] if metric["id"] == "torque_ratio_slope")
    assert stored.load_positive.slope == pytest.approx(slope["value"], rel=1e-5)
    (measured,) = (json.loads(path.read_text(encoding="utf-8")) for path in data.rglob("calibration.json"))
    assert stored.load_positive.u_slope == pytest.approx(measured["quadrants"]["load_positive"]["u_slope"], rel=1e-4)
    assert -1 < stored.load_positive.correlation < 0
    assert stored.load_positive.residual_sd_nm > 0
    assert stored.due > stored.made
    text = RECIPE.read_text(encoding="utf-8")
    text = re.sub(r"(?m)^  - calibrate:.*\n", "", text).replace(
        "output_torque: reaction", "output_torque: calibrated\n  calibration: stored"
    )
    # Stored lines mask what comes after a reversal: there is no torque ratio, and the loop has no area.
    text = re.sub(r"(?m)^  - \{id: (torque_ratio|hysteresis_energy).*\n", "", text)
    recipe = parse_recipe(text.encode(), "r.yaml")
    assert check(recipe, bench, today=stored.made) == []
    assert method_of(recipe, bench).quadrants.load_positive.slope == stored.load_positive.slope
    found = figures_for(recipe, bench).calibration
    for name in QUADRANTS:
        line = getattr(stored, name)
        assert found[name] == LineCovariance(line.u_offset_nm, line.u_slope, line.correlation)
    assert u_of_lines(data, text, block) == {
        f"calibration_{name}": pytest.approx(u_torque(getattr(stored, name), name), rel=1e-6) for name in QUADRANTS
    }


def u_of_lines(data: Path, recipe: str, block: str) -> dict[str, float]:
    """Evaluate the last run by stored lines; return the uncertainty of each line in the budget of the wind-up."""
    files = {data / "stored.yaml": recipe, data / "bench.yaml": bench_with(block, "calibrations")}
    for path, text in files.items():
        path.write_text(text, encoding="utf-8")
    own, bench = (str(path) for path in files)
    result = json.loads(command("analyze", "last", "--recipe", own, "--bench", bench, "--json", "--data", str(data)))
    (windup,) = (metric for metric in result["metrics"] if metric["id"] == "windup")
    rows = [row for row in windup["budget"] if row["quantity"].startswith("calibration_")]
    assert all(row["contribution"] > 0 for row in rows if "_load" in row["quantity"])
    return {row["quantity"]: row["u"] for row in rows}


def u_torque(line: QuadrantLine, name: str) -> float:
    """u² = u_C² + T_in² u_m² + 2 T_in cov(C, m), at the rated torque."""
    torque_in = ((412.0 if name.endswith("positive") else -412.0) - line.offset_nm) / line.slope
    covariance = line.correlation * line.u_offset_nm * line.u_slope
    return float(np.sqrt(line.u_offset_nm**2 + (torque_in * line.u_slope) ** 2 + 2 * torque_in * covariance))


def with_validity(*options: str) -> str:
    """The recipe with so many options more in its section of gates."""
    text = RECIPE.read_text(encoding="utf-8")
    assert text.count("validity:") == 1
    head, tail = text.split("validity:", 1)
    first, rest = tail.split("\n", 1)
    return head + "validity:" + "\n".join((first, *(f"  {option}" for option in options), rest))


def test_the_recipe_sets_limits_of_gates() -> None:
    text = with_validity("drift: 3 %", "points_per_bin: 9", "temperature_change: 2 K")
    recipe = parse_recipe(text.encode(), "r.yaml")
    limits = recipe.validity.limits()
    assert (limits["drift"], limits["points_per_bin"], limits["temperature_change"]) == pytest.approx((3.0, 9, 2.0))
    assert method_of(recipe, load_bench("virtual")).check_limits == limits
    assert load_recipe(RECIPE).validity.limits()["repeat"] == pytest.approx(CHECKS["repeat"].limit)


@pytest.mark.parametrize(
    ("section", "told"),
    [
        ("drifft: 1 %", "Did you mean 'drift'?"),
        ("drift: 1 N·m", "a fraction"),
        ("temperature_low: 60 degC", "temperature_high"),
        ("points_per_bin: 0", "from 1"),
    ],
)
def test_a_validity_section_is_strict(section: str, told: str) -> None:
    text = with_validity(section)
    with pytest.raises(RecipeError) as refused:
        parse_recipe(text.encode(), "r.yaml")
    assert told in str(refused.value)


def test_every_shipped_recipe_uses_limits_that_exist() -> None:
    for path in shipped_recipes().values():
        assert set(load_recipe(path).validity.limits()) == {name for name, check in CHECKS.items() if check.settable}
