"""Runs the command as a person does: real sockets on loopback where it is over wires, records in the test's folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from lostmotion_command import Ran, Running, forked, here
from patient import ONE_RAMP, OPEN_GATES, brisk_recipe, patient_bench, short_recipe

STORES = ("run", "list", "show")


@pytest.fixture
def lostmotion(tmp_path: Path) -> Callable[..., Ran]:
    """Run `lostmotion ARGS` to its end; `run` and `list` store below the test's folder.

    In a process of its own over wires, which is a fork: everything is loaded in it. In virtual time here, and without
    a report, which other tests look at.
    """

    def run(*args: str) -> Ran:
        words = (*args, *(("--data", str(tmp_path)) if args[0] in STORES else ()))
        over_wires = args[0] == "timing" or (args[0] == "run" and "--virtual-time" not in args)
        if args[0] == "run" and not over_wires:
            words = (*words, "--no-report")
        return forked(*words) if over_wires else here(*words)

    return run


@pytest.fixture
def stored(golden_run, tmp_path: Path) -> Path:
    """A copy of the golden recipe's run, with its index, in a folder of the test's own."""
    return golden_run.copy(tmp_path / "runs")


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Running]]:
    """Start `lostmotion ARGS` in a fork and go on; what still runs at the end is killed."""
    started: list[Running] = []

    def begin(*args: str, data: Path = tmp_path) -> Running:
        started.append(Running((*args, "--data", str(data)), data))
        return started[-1]

    yield begin
    for item in started:
        item.end()


@pytest.fixture
def one_ramp(tmp_path: Path) -> tuple[str, ...]:
    """Words for `lostmotion run`: a recipe that soon is in its first ramp, on a bench that waits; no report."""
    return (str(brisk_recipe(tmp_path, ONE_RAMP, OPEN_GATES)), "--no-report")


@pytest.fixture
def one_ramp_at_1_ms(tmp_path: Path) -> tuple[str, ...]:
    """Words for the same with so many records that those which wait for a full disk exceed the room kept free."""
    recipe = brisk_recipe(tmp_path, ONE_RAMP, OPEN_GATES, {"sampling": {"period": "1 ms"}})
    return (str(recipe), "--no-report")


@pytest.fixture
def ramp_by_wall_clock(tmp_path: Path) -> tuple[str, ...]:
    """Words for the same by the wall clock, with limits that a busy machine does not trip."""
    bench = str(patient_bench(tmp_path))
    return (str(short_recipe(tmp_path, ONE_RAMP)), "--bench", bench, "--no-report", "--wall-clock")
