from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import ROOT, here
from shipped_copies import simple_acceptance

from station.cli import COMMANDS, command_line

RECIPE = "recipes/rv-40e-121-inverse.yaml"


def command(*args: str, encoding: str = "utf-8") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "station", *args],
        cwd=ROOT,
        encoding=encoding,
        capture_output=True,
        check=False,
        env=os.environ | {"PYTHONIOENCODING": encoding},
    )


HEAVY = ("numpy", "scipy", "pydantic", "pyarrow", "sqlalchemy", "structlog", "can", "canopen", "nicegui", "matplotlib",
         "httpx", "asyncua", "duckdb", "analysis", "recipes")  # fmt: skip
HELP = f"""
import sys
sys.argv = ["lostmotion", "--help"]
from station import cli
try:
    cli.main()
finally:
    sys.stderr.write(" ".join(sorted(set(sys.modules) & set({HEAVY!r}))))
"""


def test_help_loads_nothing_that_takes_long() -> None:
    """So it answers at once; by the clock, or by processor time, a busy machine would be what is tested."""
    done = subprocess.run([sys.executable, "-c", HELP], cwd=ROOT, capture_output=True, text=True, check=True)
    assert "Usage" in done.stdout
    assert done.stderr == ""


@pytest.mark.parametrize("name", ["run", "check", "analyze", "show", "list", "virtual-bench", "recover"])
def test_every_command_has_help(name: str) -> None:
    done = here(name, "--help")
    assert done.exit_code == 0
    assert name in done.out


def test_a_recovery_is_not_said_to_default_to_the_virtual_bench() -> None:
    told = " ".join(here("recover", "--help").out.split())
    assert "--bench FILE" in told
    assert "virtual bench" not in told


BAD = (
    (("run", "nothing.yaml"), "nothing.yaml"),
    (("run", RECIPE, "--serial", ""), "--serial"),
    (("run", RECIPE, "--unit", "P2"), "P1"),
    (("run", RECIPE, "--unit", ""), "--unit: found '', allowed P1"),
    (("run", RECIPE, "--unit", "P1:x"), "seed"),
    (("run", "static-50nm", "--unit", "P1", "--virtual-time"), "S50, catalogue"),
    (("run", RECIPE, "--unit", "S50:3"), "'S50:3', which is of model RV-50"),
    (("run", RECIPE, "--bench", "nothing"), "virtual"),
    (("run", RECIPE, "--scenario", "nothing.yaml"), "nothing.yaml"),
    (("run", RECIPE, "--data", "/proc/runs"), "/proc/runs"),
    (("run", RECIPE, "--bench", "example-socketcan", "--unit", "P1"), "virtual bench"),
    (("run", RECIPE, "--bench", "example-socketcan"), "--serial is missing: scan the unit's label"),
    (("check", "nothing.yaml"), "nothing.yaml"),
    (("analyze", "nothing.csv", "--recipe", RECIPE), "nothing.csv"),
    (("analyze", "nothing.tdms", "--recipe", RECIPE), "nothing.tdms: there is no such file"),
    (("blank", "nothing.tdms", "--recipe", RECIPE), "nothing.tdms: there is no such file"),
    (("model", "nothing.tdms"), "nothing.tdms: there is no such file"),
    (("analyze", "tests/data/loop_published_curve.csv"), "--recipe"),
    (("show", "nothing"), "this data folder has no runs"),
    (("virtual-bench", "--can", "here"), "HOST:PORT"),
    (("virtual-bench", "--modbus", "127.0.0.1:99999"), "HOST:PORT"),
    (("virtual-bench", "--unit", "P2"), "P1"),
    (("virtual-bench", "--unit", ""), "--unit: found '', allowed P1"),
)


@pytest.mark.parametrize(("args", "named"), BAD)
def test_bad_input_is_named_without_a_traceback(args: tuple[str, ...], named: str, tmp_path: Path) -> None:
    data = ["--data", str(tmp_path)] if args[0] in ("run", "show") and "--data" not in args else []
    done = here(*args, *data)
    assert done.exit_code == 2
    assert named in done.err
    assert "Traceback" not in done.err
    assert done.out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("zone", ["XXX-99", "XXX+24", "AAA-10BBB-30,M1.1.0,M2.1.0", "AAA-10BBB-30,M6.1.0,M8.1.0"])
def test_a_time_zone_that_tells_no_time_is_bad_input(
    zone: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TZ", zone)
    for since in ("2026-01-15", "2026-07-15"):
        done = command("runs", "--since", since, "--data", str(tmp_path))
        assert (done.returncode, zone in done.stderr) == (2, True), done.stderr


def test_a_crash_is_no_verdict(tmp_path: Path) -> None:
    crash = (
        "import sys, station.cli as cli, station.cli.runs.list_runs as runs\n"
        "def broken(*_, **__): raise ZeroDivisionError('by\\nnought')\n"
        "runs.list_runs = broken\n"
        "sys.argv = ['lostmotion', 'list']\n"
        "cli.main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", crash],
        cwd=ROOT,
        env=os.environ | {"TMPDIR": str(tmp_path)},
        text=True,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 70
    assert done.stderr.count("\n") == 1
    assert "ZeroDivisionError: by nought" in done.stderr
    (told,) = tmp_path.iterdir()
    assert str(told) in done.stderr
    assert "Traceback" in told.read_text()


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_goes_away_is_no_pass(unbuffered: str, tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "station", "check", RECIPE, "--json"],
        cwd=ROOT,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        stdout=writer,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(writer)
    assert done.returncode == 141
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("damage", ["{}", '{"serial": "S", "state": "complete"}', "null"])
@pytest.mark.parametrize("asked", [("list",), ("show", "last"), ("show", "S"), ("analyze", "last")])
def test_a_damaged_run_is_told_not_thrown(asked: tuple[str, ...], damage: str, tmp_path: Path) -> None:
    folder = tmp_path / "20990101T000000.000Z-S"
    folder.mkdir()
    (folder / "run.json").write_text(damage)
    done = here(*asked, "--data", str(tmp_path))
    assert done.exit_code == (0 if asked == ("list",) else 2)
    assert "damaged" in done.out + done.err


def test_check_tells_duration_and_peak_torque() -> None:
    found = here("check", RECIPE, "--json").json
    assert found["peak_torque_nm"] == pytest.approx(453.2)
    assert 120 < found["duration_s"] < 220
    assert found["load_profile"][0] == {"t_s": 0.0, "torque_nm": 0.0}
    assert max(point["torque_nm"] for point in found["load_profile"]) == pytest.approx(453.2)
    steps = found["steps"]
    assert [row["step"] for row in steps][:4] == ["home", "lock", "calibrate", "first rise"]
    assert [row["step"] for row in steps][-2:] == ["unload", "release"]
    assert all(a["start_s"] + a["duration_s"] == pytest.approx(b["start_s"], abs=0.01) for a, b in pairwise(steps))
    assert steps[-1]["start_s"] + steps[-1]["duration_s"] == pytest.approx(found["duration_s"], abs=0.01)
    shown = here("check", RECIPE).out
    assert "≥ 108 N·m/arcmin" in shown
    assert "w = 0.8225 U" in shown
    assert "453.2 N·m (110% of rated)" in shown
    assert "┤" in shown


def test_the_steps_of_a_check_stand_in_columns_and_its_lines_are_not_too_long() -> None:
    lines = here("check", "rv-40e-121-measurement").out.splitlines()
    assert max(map(len, lines[1:])) <= 110
    head = next(number for number, line in enumerate(lines) if line.split()[:2] == ["step", "start"])
    steps = lines[head : lines.index("", head)]
    assert any("fatigue cycle" in line for line in steps)
    assert {len(line) for line in steps} == {len(lines[head])}


def test_all_problems_of_a_recipe_come_at_once(tmp_path: Path) -> None:
    text = (ROOT / RECIPE).read_text().replace("loading: input", "loading: inputt", 1).replace("count: 3", "count: 0")
    recipe = tmp_path / "bad.yaml"
    recipe.write_text(text)
    done = here("check", str(recipe))
    assert done.exit_code == 2
    assert len(done.err.strip().splitlines()) == 2
    assert all(line.startswith(f"{recipe}:") for line in done.err.strip().splitlines())


def test_a_loop_measured_elsewhere_is_analysed(tmp_path: Path) -> None:
    trace, simple = "tests/data/loop_published_curve.csv", simple_acceptance(tmp_path, "rv-40e-121-inverse")
    done = here("analyze", trace, "--recipe", simple, "--json")
    metrics = {metric["id"]: metric for metric in done.json["metrics"]}
    assert metrics["backlash_width_3pct"]["value"] == pytest.approx(0.94, abs=2e-4)
    assert metrics["backlash_width_zero"]["value"] == pytest.approx(0.9408, abs=2e-4)
    assert metrics["lost_motion"]["value"] == pytest.approx(0.9591, abs=2e-4)
    assert done.exit_code == 1  # its negative side is soft
    guarded = here("analyze", trace, "--recipe", RECIPE, "--json")
    assert (guarded.exit_code, guarded.json["verdict"]) == (3, "NOT DECIDABLE"), "nobody knows its sensors"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_terminals_without_our_signs_get_plain_ones(encoding: str) -> None:
    done = command("check", RECIPE, encoding=encoding)
    assert (done.returncode, done.stderr) == (0, "")
    assert "453.2 N.m" in done.stdout.replace("·", ".")
    assert "?" not in done.stdout
    refused = command("check", "nothing·′.yaml", encoding=encoding)
    assert refused.returncode == 2
    assert "Traceback" not in refused.stderr


def test_version_and_short_help() -> None:
    assert here("--version").out.startswith("lostmotion ")
    assert here("-h").out == here("--help").out
    assert here("run", "-h").exit_code == 0


def test_bad_input_is_one_json_object_for_programs(tmp_path: Path) -> None:
    text = (ROOT / RECIPE).read_text().replace("loading: input", "loading: inputt", 1)
    recipe = tmp_path / "bad.yaml"
    recipe.write_text(text)
    for args in (("check", str(recipe)), ("run", str(recipe), "--data", str(tmp_path / "runs"))):
        done = here(*args, "--json")
        assert done.exit_code == 2
        (error,) = done.json["errors"]
        assert set(error) == {"file", "line", "row", "column", "option", "found", "allowed", "hint"}
        assert (error["file"], error["option"], error["found"]) == (str(recipe), "loading", "'inputt'")
        assert error["line"] > 1
        assert str(recipe) in done.err


@pytest.mark.parametrize(
    ("args", "found"),
    [
        (("analyze", "nothing.csv", "--recipe", RECIPE), "nothing.csv: there is no such file"),
        (("run", RECIPE, "--serial", ""), "''"),
        (("check",), "Missing argument"),
        (("run", RECIPE, "--nonsense"), "No such option"),
        (("replay", "nothing", "--data", "tests/data"), "this data folder has no runs"),
        (("show", "nothing", "--data", "tests/data"), "this data folder has no runs"),
        (("resume", "nothing", "--data", "tests/data"), "this data folder has no runs"),
        (("list", "--data", "/nowhere"), "there is no such folder"),
    ],
)
def test_refusals_without_a_place_are_json_too(args: tuple[str, ...], found: str) -> None:
    done = here(*args, "--json")
    assert done.exit_code == 2
    assert found in done.json["errors"][0]["found"]
    assert done.err


@pytest.mark.parametrize("word", ["run", "quality", "faults"])
def test_a_command_alone_is_what_it_is_among_all(word: str) -> None:
    alone, whole = command_line(word), command_line()
    assert list(alone.commands) == [word]
    assert [option.opts for option in alone.params] == [option.opts for option in whole.params]
    one, same = (group.commands[word] for group in (alone, whole))
    assert [(option.opts, option.help) for option in one.params] == [
        (option.opts, option.help) for option in same.params
    ]
    assert list(getattr(one, "commands", ())) == list(getattr(same, "commands", ()))


@pytest.mark.parametrize("word", ["", "--help", "--store", "runn"])
def test_another_first_word_has_all_commands_to_choose_from(word: str) -> None:
    assert len(command_line(word).commands) == sum(map(len, COMMANDS.values()))


def commands_with(option: str, group: Any, *before: str) -> Iterator[tuple[str, ...]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands_with(option, command, *before, name)
        elif any(option in one.opts for one in command.params):
            yield (*before, name)


@pytest.mark.parametrize("words", list(commands_with("--json", command_line())), ids=" ".join)
def test_every_command_with_json_refuses_in_json(words: tuple[str, ...]) -> None:
    done = here(*words, "--nonsense", "--json")
    assert done.exit_code == 2
    (error,) = done.json["errors"]
    assert "--nonsense" in error["found"]


@pytest.mark.parametrize("words", list(commands_with("--data", command_line())), ids=" ".join)
@pytest.mark.parametrize("folder", ["", " "])
def test_every_command_with_data_refuses_an_empty_one(
    words: tuple[str, ...], folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a path it is the working folder, and a run began a chain of its own there."""
    monkeypatch.chdir(tmp_path)
    done = here(*words, "--data", folder)
    assert (done.exit_code, done.out) == (2, "")
    assert "--data is empty" in done.err
    assert "name a folder" in done.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("args", [("check", "nothing.yaml"), ("show", "nothing")])
def test_a_process_of_its_own_says_the_same(args: tuple[str, ...], tmp_path: Path) -> None:
    words = (*args, *(("--data", str(tmp_path)) if args[0] == "show" else ()))
    done, same = command(*words), here(*words)
    assert (done.returncode, done.stdout, done.stderr) == (same.exit_code, same.out, same.err)


STUTTERED = "1234567890" * 30
"""What a scanner gives that repeats itself; no file can have this name."""


@pytest.mark.parametrize(
    "words",
    [
        *((command, STUTTERED) for command in ("show", "report", "export", "replay", "analyze", "resume", "conclude")),
        ("show", "x/" * 2500),
        ("check", STUTTERED),
        ("run", STUTTERED, "--serial", "N"),
        ("run", "rv-40e-121-quick", "--serial", "N", "--seed", "1", "--bench", STUTTERED),
        ("analyze", f"{STUTTERED}.csv"),
        ("list", "--data", STUTTERED),
        ("verify", "--data", STUTTERED),
        ("run", "rv-40e-121-quick", "--serial", "N", "--virtual-time", "--data", STUTTERED),
    ],
    ids=lambda words: " ".join(words)[:40],
)
def test_an_argument_that_is_too_long_is_refused_and_no_failure_of_the_program(
    words: tuple[str, ...], golden_run: Any
) -> None:
    of_a_run = () if "--data" in words or words[0] == "check" else ("--data", str(golden_run.data))
    told = here(*words, *of_a_run)
    assert told.exit_code == 2, told
    assert "Traceback" not in told.err
    assert told.err.count("\n") <= 4, told.err
