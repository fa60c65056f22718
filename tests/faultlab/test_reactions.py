"""The table of reactions: complete, true of runs, and what the judge goes by."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

from definitions.faults import FAULT_BY_ID
from definitions.image import DriveCommand, Reaction, State
from drivers.servo_drive.cia402 import CONTROL_WORDS
from faultlab.judge import judge
from faultlab.matrix.matrix import undisturbed
from faultlab.run import FaultRun
from station.cli.faults import reactions as command_reactions
from virtual_bench.faults.reactions import REACTION_NAMES, REACTIONS
from virtual_bench.faults.scenario import Scenario
from virtual_bench.faults.vocabulary import FAULTS

PAGE = Path(__file__).parents[2] / "docs" / "fault-vocabulary.md"
IN_RAMP = {"state": "ramp_pos", "after_scans": 300}
BROUGHT_ABOUT = {
    "hold": {"target": "modbus.amplifier", "verb": "slow", "value": 14, "for_ms": 50},
    "unload": {"target": "modbus.brake", "verb": "off"},
    "quick_stop": {"target": "io.guard", "verb": "open"},
    "power_off": {"target": "io.estop", "verb": "trip"},
}
"""What brings each reaction about; no fault has the reaction warn."""

CONTACTS = {"io.estop": "estop", "io.guard": "guard_open"}


def scenario(reaction: str, *expect: dict) -> Scenario:
    fault = BROUGHT_ABOUT[reaction] | {"when": IN_RAMP}
    return Scenario.model_validate({"scenario": {"name": "test"}, "faults": [fault], "expect": expect})


@cache
def run_of(reaction: str) -> FaultRun:
    return undisturbed()["ramp_pos"].branch(scenario(reaction)).finish()


def test_every_reaction_has_its_row_in_the_order_of_severity():
    assert list(REACTIONS) == [reaction for reaction in Reaction if reaction != Reaction.NONE]
    for reaction, row in REACTIONS.items():
        assert (row.state is State.FAULT) == (reaction >= Reaction.UNLOAD), reaction
        assert bool(row.orders) == (reaction > Reaction.WARN), reaction
        assert row.what
    assert {fault.reaction for fault in FAULT_BY_ID.values()} == {Reaction[name.upper()] for name in BROUGHT_ABOUT}


def test_every_contact_brings_about_the_reaction_of_its_fault():
    opened = {target for (target, _), row in FAULTS.items() if row.acts_on.startswith("contact open")}
    assert opened == set(CONTACTS)
    for target, fault in CONTACTS.items():
        assert [reaction for reaction, row in REACTIONS.items() if target in row.contacts] == [
            FAULT_BY_ID[fault].reaction
        ]


@pytest.mark.parametrize("reaction", BROUGHT_ABOUT)
def test_a_run_does_what_the_row_of_its_reaction_says_and_no_other(reaction):
    for name in REACTION_NAMES:
        wrong = judge(run_of(reaction), scenario(reaction, {"reaction": name, "within_scans": 0}))
        assert (wrong == []) == (name == reaction), name
        assert name == reaction or f"reactions were: {reaction} at scan" in wrong[0]


@pytest.mark.parametrize("reaction", BROUGHT_ABOUT)
def test_what_follows_is_ordered_when_the_torque_is_gone(reaction):
    then = REACTIONS[Reaction[reaction.upper()]].then
    given = {orders.drive_command for orders in run_of(reaction).orders if orders.state == State.FAULT}
    assert then is None or then in given


@pytest.mark.parametrize("reaction", BROUGHT_ABOUT)
@pytest.mark.parametrize(
    ("wrong_row", "words"),
    [
        ({"orders": (DriveCommand.SWITCH_ON,)}, "this reaction gives switch_on"),
        ({"state": State.STOPPED}, "leads to stopped"),
    ],
)
def test_a_wrong_row_of_the_table_is_noticed(monkeypatch, reaction, wrong_row, words):
    key = Reaction[reaction.upper()]
    monkeypatch.setitem(REACTIONS, key, REACTIONS[key]._replace(**wrong_row))
    (wrong,) = judge(run_of(reaction), scenario(reaction, {"reaction": reaction, "within_scans": 0}))
    assert words in wrong


def test_a_wrong_order_afterwards_is_noticed(monkeypatch):
    row = REACTIONS[Reaction.QUICK_STOP]
    monkeypatch.setitem(REACTIONS, Reaction.QUICK_STOP, row._replace(then=DriveCommand.SHUTDOWN))
    (wrong,) = judge(run_of("quick_stop"), scenario("quick_stop", {"reaction": "quick_stop", "within_scans": 0}))
    assert "disable_voltage at scan" in wrong


def test_a_lock_that_a_reaction_opens_is_noticed():
    run = run_of("quick_stop")
    place = next(place for place, orders in enumerate(run.orders) if orders.state == State.FAULT)
    opened = [orders._replace(brake_on=0) if at >= place else orders for at, orders in enumerate(run.orders)]
    changed = FaultRun(**(vars(run) | {"orders": opened}))
    (wrong,) = judge(changed, scenario("quick_stop", {"reaction": "quick_stop", "within_scans": 0}))
    assert "the lock's contact changed" in wrong


def test_a_reaction_that_comes_late_is_said_with_the_scans():
    run = run_of("quick_stop")
    place = next(place for place, orders in enumerate(run.orders) if orders.state == State.FAULT)
    held = [orders._replace(reaction=0) if place <= at < place + 7 else orders for at, orders in enumerate(run.orders)]
    late = FaultRun(**(vars(run) | {"orders": held}))
    expected = [{"reaction": "quick_stop", "within_scans": scans} for scans in (6, 7)]
    (wrong,) = judge(late, scenario("quick_stop", *expected))
    assert "within_scans 6: the reaction came 7 scans after the alarm" in wrong


def test_the_command_and_the_page_have_every_row(capsys):
    assert command_reactions.list_reactions(as_json=False) == 0
    said = capsys.readouterr().out
    assert command_reactions.list_reactions(as_json=True) == 0
    rows = {row["reaction"]: row for row in json.loads(capsys.readouterr().out)}
    page = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    for reaction, row in REACTIONS.items():
        name = reaction.name.lower()
        (written,) = [line for line in page if line.startswith(f"| `{name}` |")]
        assert f"\n{name}\n" in f"\n{said}"
        for command in row.orders:
            assert f"{command.name.lower()} (control word 0x6040 = 0x{CONTROL_WORDS[command]:02X})" in said
            assert f"`{command.name.lower()}` (0x{CONTROL_WORDS[command]:02X})" in written
        assert rows[name]["faults"] == [fault.id for fault in FAULT_BY_ID.values() if fault.reaction == reaction]
        assert [order["order"] for order in rows[name]["orders"]] == [order.name.lower() for order in row.orders]
