"""The fast part of `make model-check`: the neighbourhood of every run, and the mutants that it has to notice."""

from __future__ import annotations

import pickle

import pytest
from exploration import ENDS, Explorer, check_mutant, coarse_time
from mutants import (
    NOT_ASKED_FOR,
    SEEN_OTHERWISE,
    asked_for,
    debounce_rows,
    guards,
    interlock_rows,
    jogs,
    live_states,
    trip_rows,
    way_back,
)
from safety_rules import ALLOWED, CONDITIONS, RULES, BrokenRuleError

from controller.interlocks import INTERLOCKS
from controller.states import TRANSITIONS
from definitions.image import State

MUTANTS = {m.name: m for make in (trip_rows, interlock_rows, debounce_rows, guards, way_back, jogs) for m in make()}
BLIND = live_states()


@pytest.mark.parametrize("by_speed", [False, True], ids=["torque", "speed"])
def test_no_rule_is_broken_near_any_run(by_speed):
    with coarse_time():
        found = Explorer(by_speed=by_speed).explore(2000)
    assert found.visited == set(State) - {State.JOG}
    assert found.longest_scans < 200
    for name, condition in CONDITIONS.items():
        assert found.probed[name] == {*condition.states, *condition.established_in} - {State.JOG}, name


def test_no_rule_is_broken_on_the_way_back_from_a_bench_that_was_left_wound_up():
    with coarse_time():
        found = Explorer(left=True).explore(1500)
    assert found.visited == {State.IDLE, State.FAULT, State.UNLOAD, State.RELEASE, State.STOPPED}


def test_no_rule_is_broken_near_a_jog():
    with coarse_time():
        found = Explorer(jog=True).explore(1500)
    assert found.visited <= {State.IDLE, State.JOG, State.FAULT, State.UNLOAD, State.RELEASE, State.STOPPED}
    asked = {name for name, one in CONDITIONS.items() if State.JOG in (*one.states, *one.established_in)}
    assert asked == {name for name, states in found.probed.items() if State.JOG in states}


def test_the_rules_know_every_interlock_and_every_transition():
    named = {name.split(" ")[0] for name in CONDITIONS}
    assert {row.fault for row in INTERLOCKS} - {"torque_channels_disagree"} == named
    for row in TRANSITIONS:
        if row.trigger != "trip":
            assert row.dest in ALLOWED[row.source]
    assert State.FAULT in ENDS


def test_every_row_is_asked_for_where_it_is_live_or_says_why_not():
    live = {(row.fault, state) for row in INTERLOCKS for state in row.live_in}
    assert {at for at in live if not asked_for(*at)} == set(NOT_ASKED_FOR)
    assert {at for at in SEEN_OTHERWISE if asked_for(*at)} == set(SEEN_OTHERWISE)


def test_a_broken_rule_says_how_it_was_reached_across_processes():
    error = BrokenRuleError(RULES[4], "in LOCK")
    error.add_note("timeline: 0.START")
    again = pickle.loads(pickle.dumps(error))  # noqa: S301  what a pool of processes does
    assert (str(again), again.__notes__) == (f"{RULES[4]}: in LOCK", ["timeline: 0.START"])


@pytest.mark.parametrize("name", sorted(MUTANTS))
def test_a_mutant_is_noticed(name):
    assert check_mutant(MUTANTS[name])


@pytest.mark.parametrize("number", range(0, len(BLIND), 12))
def test_an_interlock_that_does_not_see_in_one_state_is_noticed(number):
    assert check_mutant(BLIND[number]), BLIND[number].name
