"""What was checked is what is run and what is recorded: every file is read once."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

import recipes.text.yaml_source
from definitions.protections import BY_NAME, NOT_TRIED, UNPROVEN, missing_text
from recipes import RecipeError, find_bench, load_bench, load_recipe
from recipes.text.problems import NO_VALUE
from station.atomic_file import as_json
from station.bench.request import DRIVER_PROFILES, Source, load_job
from station.commissioning.on_wires import on_wires
from station.records.program_file import plain_program, program_differences
from station.run.process_specs import compiled
from station.scan.scan_spec import SpecError, read_program

ROOT = Path(__file__).parents[3]
RECIPE = ROOT / "recipes" / "rv-40e-121-quick.yaml"


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_bytes(RECIPE.read_bytes())
    return path


def test_a_recipe_edited_between_two_reads_cannot_be_half_old_half_new(
    recipe: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The editor saves while the file is being read: whatever is read afterwards is another recipe."""
    honest = recipes.text.yaml_source.read_bytes
    reads: list[str] = []

    def edited_after(path: str | Path) -> bytes:
        content = honest(path)
        reads.append(str(path))
        if Path(path) == recipe:
            recipe.write_text(recipe.read_text().replace("peak_torque: 110 %", "peak_torque: 90 %"))
        return content

    for module in ("recipes.text.yaml_source", "station.bench.request"):
        monkeypatch.setattr(f"{module}.read_bytes", edited_after)
    job = load_job(str(recipe), "virtual")
    _ = job.program
    assert len(reads) == len(set(reads))
    assert job.recipe_source.content == RECIPE.read_bytes()
    assert job.recipe.sequence == load_recipe(RECIPE).sequence


def test_an_option_of_a_bench_with_nothing_behind_it_is_refused_and_a_record_that_has_one_opens(tmp_path: Path) -> None:
    bench, text = tmp_path / "bench.yaml", find_bench("virtual").read_text(encoding="utf-8")
    bench.write_text(text.replace("bench:\n", "bench:\n  public_key:\n", 1), encoding="utf-8")
    with pytest.raises(RecipeError) as refused:
        load_job(str(RECIPE), str(bench))
    (problem,) = refused.value.problems
    assert (problem.path, problem.line, problem.option) == (str(bench), 4, "bench.public_key")
    assert (problem.found, problem.allowed, problem.hint) == NO_VALUE
    for named in (load_bench, on_wires):
        with pytest.raises(RecipeError, match=r"bench\.public_key"):
            named(str(bench))
    assert Source.read(bench).bench().bench.public_key is None
    recipe = tmp_path / "recipe.yaml"
    text = RECIPE.read_text(encoding="utf-8")
    recipe.write_text(re.sub("max: [^},]*", "max: ", text, count=1), encoding="utf-8")
    with pytest.raises(RecipeError, match=r"max: found nothing"):
        load_recipe(recipe)
    assert Source.read(recipe).recipe().sequence == load_recipe(RECIPE).sequence


def test_profiles_are_checked_before_anything_starts(tmp_path: Path) -> None:
    job = load_job(str(RECIPE), "virtual")
    bench = tmp_path / "bench.yaml"
    bench.write_bytes(job.bench_source.content)
    name = job.bench.drive.profile
    (tmp_path / f"{name}.yaml").write_bytes(job.profile_sources[name].content + b"unknown_option: 1\n")
    with pytest.raises(RecipeError, match="unknown_option"):
        load_job(str(RECIPE), str(bench))


def test_profiles_that_are_nowhere_are_named_all_at_once(tmp_path: Path) -> None:
    job = load_job(str(RECIPE), "virtual")
    text, named = job.bench_source.content.decode(), job.bench.profile_names
    for number, name in enumerate(named):
        text = text.replace(f"profile: {name}", f"profile: nowhere-{number}")
    bench = tmp_path / "bench.yaml"
    bench.write_text(text, encoding="utf-8")
    with pytest.raises(RecipeError) as refused:
        load_job(str(RECIPE), str(bench))
    found = {one.found for one in refused.value.problems}
    assert len(named) > 1
    assert all(any(f"nowhere-{number}" in one for one in found) for number in range(len(named)))


def test_the_scan_refuses_a_program_that_was_not_checked(tmp_path: Path, recipe: Path) -> None:
    job = load_job(str(recipe), None)
    recorded = tmp_path / "program.json"
    recorded.write_bytes(as_json(plain_program(job.program)))
    told = compiled(job, recorded, None)
    assert read_program(told) == job.program
    recipe.write_text(recipe.read_text().replace("peak_torque: 110 %", "peak_torque: 105 %"))
    other = load_job(str(recipe), None).program
    assert program_differences(json.loads(recorded.read_bytes()), other)
    recorded.write_bytes(as_json(plain_program(other)))
    with pytest.raises(SpecError, match="was changed after it was checked"):
        read_program(told)
    recorded.unlink()
    with pytest.raises(SpecError, match="cannot be read"):
        read_program(told)


@pytest.mark.parametrize(
    ("part", "good", "bad", "said"),
    [
        ("amplifier", "name: sample_counter,", "name: counts,", "does not deliver sample_counter"),
        ("amplifier", "name: torque_in_nm,", "name: torque_inn_nm,", "does not deliver torque_in_nm"),
        ("amplifier", "name: sample_time_us,", "name: sample_tim_us,", "did you mean sample_time_us|Did you mean"),
        ("remote_io", "name: estop_released,", "name: e_stop,", "does not deliver estop_released"),
        ("remote_io", "name: housing_temp_c,", "name: housing_temp,", "Did you mean housing_temp_c"),
        ("brake", "name: brake_on, offset: 0,", "name: on, offset: 0,", "cannot be given the brake's orders"),
    ],
)
def test_a_profile_that_lacks_or_misspells_a_field_is_refused_before_a_run(
    tmp_path: Path, part: str, good: str, bad: str, said: str
) -> None:
    """`check` passed it once, and the run that followed left a record behind before it was refused."""
    job = load_job(str(RECIPE), "virtual")
    bench = tmp_path / "bench.yaml"
    bench.write_bytes(job.bench_source.content)
    name = getattr(job.bench, part).profile
    text = job.profile_sources[name].content.decode()
    assert text.count(good) == 1
    (tmp_path / f"{name}.yaml").write_text(text.replace(good, bad), encoding="utf-8")
    with pytest.raises(RecipeError, match=said):
        load_job(str(RECIPE), str(bench))


def test_a_result_says_what_the_drive_lacks_and_what_nobody_has_tried_or_measured(tmp_path: Path) -> None:
    profile = raw_text("virtual-drive").replace("name: virtual-drive", "name: lacking")
    tried = next(line for line in profile.splitlines() if line.startswith("tried_on_hardware"))
    profile = profile.replace(tried, "protections: {torque_slope: none}")  # who states nothing has not tried it
    (tmp_path / "lacking.yaml").write_text(profile, encoding="utf-8")
    bench = find_bench("virtual").read_text(encoding="utf-8").replace("profile: virtual-drive", "profile: lacking")
    path = tmp_path / "bench.yaml"
    path.write_text(bench, encoding="utf-8")
    notes = load_job("rv-40e-121-quick", str(path)).drive_notes
    assert NOT_TRIED in notes[0]
    assert notes[1:] == (missing_text(BY_NAME["torque_slope"]),)
    path.write_text(bench.replace("embedded: true", "embedded: false"), encoding="utf-8")
    assert load_job("rv-40e-121-quick", str(path)).drive_notes == (*notes, UNPROVEN)
    assert load_job("rv-40e-121-quick", None).drive_notes == ()


@pytest.mark.parametrize(
    ("good", "bad", "said"),
    [
        (
            "field: channel_2",
            "field: chanel_2",
            "torque_out_nm of device torques.*Did you mean channel_2",
        ),
        ("alive_field: output_stamp", "alive_field: input_stamp", "input_stamp in channel angle_out_rad"),
    ],
    ids=["a field that is not there", "a proof in another block"],
)
def test_channels_that_no_device_delivers_are_refused_before_a_run(
    tmp_path: Path, good: str, bad: str, said: str
) -> None:
    folder = shutil.copytree(ROOT / "tests" / "data" / "benches", tmp_path / "benches")
    bench = folder / "two-amplifiers.yaml"
    bench.write_text(bench.read_text(encoding="utf-8").replace(good, bad), encoding="utf-8")
    with pytest.raises(RecipeError, match=said):
        load_job(str(RECIPE), str(bench))


@pytest.mark.parametrize(
    ("good", "bad", "option", "fitting"),
    [
        ("profile: virtual-drive", "profile: virtual-driv", "drive.profile", "virtual-drive"),
        ("profile: virtual-brake", "profile: virtual-brak", "brake.profile", "virtual-brake"),
        ("profile: virtual-drive", "profile: my-driv", "drive.profile", "my-drive"),
    ],
)
def test_a_profile_that_is_nowhere_is_refused_where_it_is_named_with_those_that_fit(
    tmp_path: Path, good: str, bad: str, option: str, fitting: str
) -> None:
    text = find_bench("virtual").read_text(encoding="utf-8")
    bench = tmp_path / "bench.yaml"
    bench.write_text(text.replace(good, bad, 1), encoding="utf-8")
    (tmp_path / "profiles").mkdir()
    (tmp_path / "profiles" / "my-drive.yaml").write_text(raw_text("virtual-drive"), encoding="utf-8")
    with pytest.raises(RecipeError) as refused:
        _ = load_job(str(RECIPE), str(bench)).program
    (problem,) = refused.value.problems
    assert text.splitlines()[problem.line - 1][problem.column - 1 :].startswith(good.partition(" ")[2])
    assert problem.option == option
    assert problem.hint == f"Did you mean '{fitting}'?"
    kinds = {"drive.profile": ("virtual-drive", "virtual-amplifier"), "brake.profile": ("virtual-brake", "nanotec-pd4")}
    fits, fits_not = kinds[option]
    assert fits in problem.allowed
    assert fits_not not in problem.allowed


def raw_text(profile: str) -> str:
    return (DRIVER_PROFILES / f"{profile}.yaml").read_text(encoding="utf-8")
