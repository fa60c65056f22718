"""Every name of a scenario misspelt by one letter is refused in one line: place, what was found, what is allowed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from faultlab.bench_under_test import BenchUnderTest
from recipes import RecipeError
from station.bench.assemble_virtual import parse_scenario, vocabulary_on
from station.bench.request import load_job
from virtual_bench.faults.names import (
    COMMAND_NAMES,
    EVENT_NAMES,
    ORDER_NAMES,
    REACTION_NAMES,
    STATE_NAMES,
    TARGETS,
    excerpt,
)
from virtual_bench.faults.scenario import EXPECT_KINDS
from virtual_bench.faults.vocabulary import FAULTS, ONLY_OVER_WIRES

ROOT = Path(__file__).parents[2]
HEAD = "scenario: {name: x}\n"
FAULT = "faults:\n  - {target: io.guard, verb: open, when: {state: lock}}\n"
SPARSE = 9
"""Of the names that stand in long lists every ninth misspelling is tried: each is compared with the whole list."""

LOCK = "when: {state: lock}"


def misspelt(name: str, allowed: set[str]) -> list[str]:
    """Every text that one letter makes of a name, left out, doubled, replaced or swapped with the next, but no name."""
    texts = set()
    for at, letter in enumerate(name):
        before, after = name[:at], name[at + 1 :]
        texts |= {
            before + after,
            before + 2 * letter + after,
            f"{before}x{after}",
            before + after[:1] + letter + after[1:],
        }
    return sorted(texts - allowed - {""})


def problems_of(text: str) -> list[str]:
    """What is said of a scenario that is wrong, line by line."""
    with pytest.raises(RecipeError) as refused:
        parse_scenario(text.encode(), "mine.yaml")
    return str(refused.value).splitlines()


@pytest.mark.parametrize(
    ("bench", "wrong", "meant"),
    [
        ("can-sensors", "can.encodrs", "can.encoders"),
        ("can-sensors", "can.flange.hartbeat", "can.flange.heartbeat"),
        ("can-sensors", "modbus.amplifier", "modbus.brake"),
        ("two-amplifiers", "modbus.torqes", "modbus.torques"),
        ("two-amplifiers", "modbus.torques.cycl", "modbus.torques.cycle"),
    ],
)
def test_a_device_that_the_bench_does_not_have_is_refused_with_those_that_it_has(bench, wrong, meant):
    job = load_job("rv-40e-121-quick", str(ROOT / "tests" / "data" / "benches" / f"{bench}.yaml"))
    text = f"{HEAD}faults:\n  - {{target: {wrong}, verb: freeze, {LOCK}}}\n"
    with pytest.raises(RecipeError) as refused:
        parse_scenario(text.encode(), "mine.yaml", vocabulary_on(job.bench, job.profile_sources))
    (said,) = str(refused.value).splitlines()
    assert said.startswith("mine.yaml:3:")
    assert f"'{wrong}', which is not a target" in said
    assert f" {meant}," in said or f" {meant}." in said


@pytest.mark.parametrize(("target", "verb"), FAULTS)
def test_every_misspelt_verb_gives_one_line_with_its_place(target, verb):
    verbs = {known for of, known in FAULTS if of == target}
    wrong = misspelt(verb, verbs)
    faults = "".join(f"  - {{target: {target}, verb: '{text}', {LOCK}}}\n" for text in wrong)
    said = problems_of(f"{HEAD}faults:\n{faults}")
    assert len(said) == len(wrong)
    column = len(f"  - {{target: {target}, verb: ") + 1
    for line, (text, problem) in enumerate(zip(wrong, said, strict=True), start=3):
        assert problem.startswith(f"mine.yaml:{line}:{column}: faults[{line - 3}].verb: found {excerpt(text)}")
        allowed = problem.partition("; allowed: ")[2].partition(".")[0]
        assert set(allowed.replace(" or ", ", ").split(", ")) == verbs


def entries(kind: str, wrong: list[str]) -> str:
    """A scenario whose entries have misspelt names of a kind, one a line from line 3 on."""
    lines = {
        "target": ("faults", "{{target: {0}, verb: off, " + LOCK.replace("{", "{{").replace("}", "}}") + "}}"),
        "state": ("faults", "{{target: io.guard, verb: open, when: {{state: {0}}}}}"),
        "command": ("operator", "{{command: {0}, when: {{state: lock}}}}"),
        "event": ("expect", "{{event: {0}, within_scans: 3}}"),
        "reaction": ("expect", "{{reaction: {0}, within_scans: 3}}"),
        "order": ("expect", "{{order: {0}, within_scans: 3}}"),
        "final_state": ("expect", "{{final_state: {0}}}"),
        "never state": ("never", "{{state: {0}}}"),
        "never event": ("never", "{{event: {0}}}"),
        "order_after_fault": ("never", "{{order_after_fault: {0}}}"),
        "kind": ("expect", "{{{0}: 3}}"),
    }
    section, line = lines[kind]
    rest = "" if section == "faults" else FAULT
    return f"{HEAD}{section}:\n" + "".join(f"  - {line.format(text)}\n" for text in wrong) + rest


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("target", TARGETS),
        ("state", STATE_NAMES),
        ("command", COMMAND_NAMES),
        ("event", EVENT_NAMES),
        ("reaction", REACTION_NAMES),
        ("order", ORDER_NAMES),
        ("final_state", STATE_NAMES),
        ("never state", STATE_NAMES),
        ("never event", EVENT_NAMES),
        ("order_after_fault", ORDER_NAMES),
        ("kind", EXPECT_KINDS),
    ],
)
def test_every_other_misspelt_name_does_so_too(kind, names):
    options = {*names, "within_scans", "within_s", "since"}
    for name in names:
        wrong = misspelt(name, options)[::SPARSE]
        said = problems_of(entries(kind, wrong))
        assert len(said) == len(wrong)
        for line, (text, problem) in enumerate(zip(wrong, said, strict=True), start=3):
            assert problem.startswith(f"mine.yaml:{line}:")
            assert excerpt(text) in problem
            assert all(known in problem.partition("; allowed: ")[2] for known in names)


def test_the_command_says_one_line_and_nothing_else_and_refuses_as_bad_input(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"{HEAD}{FAULT.replace('open', 'oppen')}", encoding="utf-8")
    command = [sys.executable, "-W", "default", "-m", "station", "faults", "run", str(path)]
    root = Path(__file__).parents[2]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=root)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == (
        f"{path}:3:30: faults[0].verb: found 'oppen', which is not a fault of io.guard; allowed: open. "
        "Did you mean 'open'?\n"
    )


@pytest.fixture(scope="module")
def bench() -> BenchUnderTest:
    return BenchUnderTest()


@pytest.mark.parametrize(("target", "verb"), sorted(set(FAULTS) - ONLY_OVER_WIRES))
def test_a_misspelt_verb_in_a_test_gives_one_line_with_the_place_of_the_call(bench, target, verb):
    for text in misspelt(verb, {known for of, known in FAULTS if of == target}):
        with pytest.raises(ValueError, match=r"which is not a fault of") as refused:
            bench.inject(target, text)
        here = refused.traceback[0].lineno + 1
        (line,) = str(refused.value).splitlines()
        assert f"test_misspelt_names.py:{here}:" in line
        assert f"verb: found {excerpt(text)}" in line
