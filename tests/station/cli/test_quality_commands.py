"""The quality commands: tables and JSON of a lot, and the codes by which they end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lostmotion_command import here
from stored_runs import metric, store_run

VALUES = tuple(0.5 + 0.02 * float(one) for one in np.random.default_rng(8).standard_normal(26))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("quality") / "runs"
    for number, value in enumerate(VALUES):
        store_run(data, f"U{number}", [metric(value)], day=number / 3, operator="AB"[number % 2])
    for number in range(26):
        store_run(data, "MASTER", [metric(0.5 + 0.001 * (number % 5))], day=number, master="PASS")
    store_run(data, "BAD", [metric(0.8)], day=9, failed="lost_motion")
    return data


LOST_MOTION = ("--metric", "lost_motion")
COMMANDS: dict[str, tuple[tuple[str, ...], int]] = {
    "yield": (("--by", "operator"), 0),
    "pareto": ((), 0),
    "capability": ((), 0),
    "chart": ((*LOST_MOTION, "--subgroup", "1", "--rules", "western-electric", "--rules", "six-rising"), 1),
    "trend": ((*LOST_MOTION, "--by", "operator"), 0),
    "type1": ((*LOST_MOTION, "--serial", "MASTER", "--reference", "0.502", "--tolerance", "0.2"), 0),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_says_the_same_to_people_and_programs(folder: Path, command: str) -> None:
    options, code = COMMANDS[command]
    text = here("quality", command, "--data", str(folder), *options)
    found = here("quality", command, "--data", str(folder), *options, "--json")
    assert (text.exit_code, found.exit_code) == (code, code), text.err
    document = found.json
    if command == "yield":
        assert "26 of 27" in text.out
        assert document["whole"]["first_pass"]["number"] == 26
    elif command == "chart":
        assert document["run_length"]["standard_error"] > 0.0, "a rule that compares neighbours is simulated"
        assert "OUT OF CONTROL" in text.out
        assert document["runs"][document["chart"]["signals"][-1]["point"] - 1].endswith("-BAD")
    elif command == "type1":
        assert document["study"]["cg"] == pytest.approx(0.04 / 6 / np.std([0.001 * (n % 5) for n in range(26)], ddof=1))
    elif command == "capability":
        assert document["rows"][0]["found"]["values"] == 27


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("yield", "--by", "moon"), "--by: found 'moon'"),
        (("yield", "--since", "yesterday"), "--since"),
        (("yield", "--virtual"), "Of real units there are 27"),
        (("chart", *LOST_MOTION, "--rules", "nelsen"), "the rule sets shewhart"),
        (("chart", "--metric", "none"), "the newest run of this lot has the metrics lost_motion"),
        (("trend", *LOST_MOTION, "--by", "recipe"), "found 1 to compare (inverse)"),
        (("type1", *LOST_MOTION, "--serial", "U1", "--reference", "0.5", "--tolerance", "1"), "expected 25 or more"),
    ],
)
def test_what_was_asked_for_wrongly_is_said(folder: Path, options: tuple[str, ...], said: str) -> None:
    found = here("quality", *options, "--data", str(folder))
    assert found.exit_code == 2
    assert said in found.err


def test_a_guard_is_said_to_be_a_multiple_of_the_uncertainty() -> None:
    """As with --guard-factor of a trial: whoever takes it for a width in arcmin tries another band than he means."""
    for words in (("reevaluate", "--help"), ("quality", "trial", "--help")):
        told = " ".join(here(*words).out.split())
        assert "as a multiple of the uncertainty U" in told, words
        assert "width of the guard band" not in told


def test_a_figure_says_that_an_altered_run_is_not_in_it(tmp_path: Path) -> None:
    """A FAIL whose record was altered was left out without a word, and the yield was better than the units are."""
    data = tmp_path / "runs"
    store_run(data, "GOOD", [metric(0.5)], day=0)
    bad = store_run(data, "BAD", [metric(1.5)], day=1, failed="lost_motion").folder / "result.json"
    assert "not counted" not in here("quality", "yield", "--data", str(data)).out
    bad.write_text(bad.read_text(encoding="utf-8").replace("FAIL", "PASS"), encoding="utf-8")
    assert here("list", "--data", str(data)).exit_code == 0  # compares
    found = here("quality", "yield", "--data", str(data))
    assert "1 of 1" in found.out
    assert "not counted: 1 run" in found.out
    assert "not counted: 1 run" in here("quality", "yield", "--data", str(data), "--json").err
    written = ("quality", "dfq", "--out", str(tmp_path / "lot.dfq"), "--data", str(data))
    assert "not counted: 1 run" in here(*written).out
    assert "not counted: 1 run" in here(*written, "--json").err
    alone = here("quality", "yield", "--data", str(data), "--since", "2026-01-06")
    assert (alone.exit_code, "not believed: 1" in alone.err) == (2, True)
