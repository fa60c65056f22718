from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import pytest
from made_documents import BENCH, alarm, left, result, timing
from rich.console import Console

from station.documents.events import LeftState
from station.documents.result import Result
from station.records.left_state import left_action, left_text
from station.records.ring.ring import StopCause
from station.reports.headline import STOPPED_BY, badges, headline, remaining_reasons, virtual_badges
from station.reports.result_view import show_result, way_back_command

CELL = BENCH | {"name": "cell-3", "embedded": False}
REAL = {"model": "RV", "virtual": None}


def told(one: LeftState) -> LeftState:
    return replace(one, text=left_text(one), next_action=left_action(one))


def printed(found: Result) -> str:
    stream = io.StringIO()
    show_result(Console(file=stream, width=110), found)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, ("VIRTUAL BENCH",)),
        ({"clock": "virtual"}, ("VIRTUAL BENCH", "VIRTUAL TIME")),
        (
            {"clock": "virtual", "bench": CELL},
            ("SIMULATED BENCH cell-3", "VIRTUAL TIME"),
        ),
        ({"bench": CELL, "unit": REAL}, ()),
        ({"bench": None, "unit": None, "clock": None, "timing": None}, ()),
    ],
)
def test_what_is_not_real_says_so(changes: dict[str, Any], said: tuple[str, ...]) -> None:
    assert virtual_badges(result(**changes)) == badges(result(**changes)) == said
    assert all(badge in printed(result(**changes)) for badge in said)
    assert ("VIRTUAL" in printed(result(**changes))) == bool(said)


def test_injected_faults_are_told_beside_the_verdict_and_by_name() -> None:
    text = printed(result(scenario="scenarios/slow-amplifier.yaml"))
    assert "VIRTUAL BENCH    FAULTS INJECTED" in text
    assert "note   faults were injected: scenarios/slow-amplifier.yaml" in text
    assert badges(result(unit=REAL, scenario="line.yaml")) == ("FAULTS INJECTED",)
    named = printed(result(scenario="x.yaml", notes=["faults were injected: slow amplifier"], stages=[{"stage": "a"}]))
    assert named.count("faults were injected") == 1
    assert "FAULTS" not in printed(result(scenario=None)).upper()


def test_a_fault_is_the_headline_and_the_verdict_stands_below() -> None:
    found = result(
        state="fault",
        verdict="NOT DECIDABLE",
        alarms=[alarm()],
        reasons=["Guard opened: open. Close it"],
        left=told(left()),
    )
    assert headline(found)[:2] == ("BENCH FAULT: Guard opened", "NOT DECIDABLE")
    assert remaining_reasons(found) == ["open. Close it"]
    box = printed(found).partition("╭")[2].splitlines()
    assert "BENCH FAULT: Guard opened" in box[1]
    assert "NOT DECIDABLE" in box[2]
    assert "run ended in a fault" in box[2]
    assert "left with −9.7 N·m at the output, lock closed, drive off" in " ".join(box)


def test_a_stop_and_a_bench_that_did_not_open_are_headlines_too() -> None:
    assert headline(result(state="stopped", verdict="NOT DECIDABLE")).text == "STOPPED: by the operator"
    for cause, words in STOPPED_BY.items():
        said = headline(result(state="stopped", verdict="NOT DECIDABLE", stopped_by=cause)).text
        assert said == f"STOPPED: {words}"
        assert ("operator" in said) is (cause == "operator")
    assert {cause.name.lower() for cause in StopCause if cause} == set(STOPPED_BY) - {"operator"}
    refused = result(state="fault", verdict="NOT DECIDABLE", timing=timing(scans=0))
    assert headline(refused).text == "BENCH FAULT: the bench could not be opened"
    assert headline(result(state="interrupted", verdict="NOT DECIDABLE")).text == "INTERRUPTED"
    assert headline(result(verdict="FAIL")) == ("FAIL", "", "FAIL")


@pytest.mark.parametrize(
    ("changes", "advice"),
    [
        ({}, "still wound up"),
        ({"torque_nm": 1.0}, "open the lock"),
        ({"torque_nm": 1.0, "lock": "open"}, "can be removed"),
        ({"lock": "open"}, "zero of the torque sensor"),
        ({"torque_known": False}, "treat the unit as wound up"),
        ({"torque_nm": None}, "treat the unit as wound up"),
        ({"lock_known": False, "torque_nm": 0.0}, "treat the unit as wound up"),
    ],
)
def test_what_to_do_follows_from_how_the_bench_was_left(changes: dict[str, Any], advice: str) -> None:
    assert advice in left_action(left(**changes))
    assert ("(last known)" in left_text(left(**changes))) == ("known" in "".join(changes))


@pytest.mark.parametrize(
    ("changes", "command"),
    [
        ({}, "lostmotion recover --data /srv/line/runs"),
        ({"record": "runs/x"}, "lostmotion recover"),
        ({"state": "stopped"}, ""),
        ({"clock": "virtual"}, ""),
        ({"bench": BENCH}, ""),
    ],
)
def test_a_fault_on_a_real_bench_names_the_way_back(changes: dict[str, Any], command: str) -> None:
    there = {"bench": CELL, "clock": "real", "record": "/srv/line/runs/x", "left": told(left()), "state": "fault"}
    assert way_back_command(result(**there | changes)) == command
