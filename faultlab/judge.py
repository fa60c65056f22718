"""Judges a run with faults by what its scenario expects and forbids; every breach is one plain sentence.

A breach of something that was expected says what was given instead, with its times (`given`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from definitions.image import DriveCommand, Reaction, State
from faultlab.given import (
    alarms_given,
    at,
    changes_given,
    commands,
    orders,
    reactions,
    states_given,
    visits,
)
from faultlab.run import FaultRun
from virtual_bench.faults.reactions import REACTIONS, reaction_of
from virtual_bench.faults.scenario import OF_THE_RECORD, Expect, Never, Scenario, When
from virtual_bench.faults.schedule import moment_of, never_due, without_effect

INTERRUPTED, START = "interrupted", "start"
NO_RECORD = "a run in virtual time has no record; run it over wires"


class Breach(NamedTuple):
    """One thing that went wrong: the entry of the scenario that says so, as a path of names and indices, and a text."""

    option: tuple[str | int, ...]
    text: str


def judge(run: FaultRun, scenario: Scenario) -> list[str]:
    """Return what went wrong, in the order of the file; an empty list when the scenario holds."""
    return [breach.text for breach in breaches(run, scenario)]


def breaches(run: FaultRun, scenario: Scenario) -> list[Breach]:
    """Return what went wrong with the entry of the scenario that it breaks; empty when the scenario holds."""
    wrong = [_without_effect(run, scenario, text) for text in run.unseen]
    if run.refused:
        return wrong + _refusals(run, scenario)
    wrong += _not_ordered(run, scenario)
    if not run.finished and all(expect.found_as != INTERRUPTED for expect in scenario.expect):
        wrong.append(Breach((), "the run did not end"))
    for number, expect in enumerate(scenario.expect):
        kind = next(name for name in _EXPECT if getattr(expect, name) is not None)
        found = _EXPECT[kind](run, expect)
        if found:
            wrong.append(Breach(("expect", number), f"expected {_text(expect)}: {found}"))
    for number, never in enumerate(scenario.never):
        kind = next(name for name in _NEVER if getattr(never, name) is not None)
        found = _NEVER[kind](run, never)
        if found:
            wrong.append(Breach(("never", number), f"never {_text(never)}: {found}"))
    return wrong


def _text(clause: Expect | Never) -> str:
    return ", ".join(f"{name} {value}" for name, value in clause.model_dump(exclude_none=True).items())


def _refusals(run: FaultRun, scenario: Scenario) -> list[Breach]:
    """Judge a run whose bench was not opened: nothing has moved, so nothing but the refusal and its record can hold."""
    wrong = []
    if all(expect.refused is None for expect in scenario.expect):
        wrong.append(Breach((), f"the bench was refused, so nothing was tried: {run.refused}"))
    for number, expect in enumerate(scenario.expect):
        kind = next(name for name in _EXPECT if getattr(expect, name) is not None)
        if expect.refused is not None:
            found = "" if expect.refused in run.refused else f"it says {run.refused}"
        elif kind in OF_THE_RECORD:
            found = _EXPECT[kind](run, expect)
        else:
            found = "the bench was refused, nothing has moved"
        if found:
            wrong.append(Breach(("expect", number), f"expected {_text(expect)}: {found}"))
    return wrong


def _without_effect(run: FaultRun, scenario: Scenario, text: str) -> Breach:
    """Return a fault without effect as a breach of its own entry; one whose moment did not come says what did."""
    same = [number for number, fault in enumerate(scenario.faults) if text.startswith(without_effect(fault))]
    number = next((at for at in same if text == never_due(scenario.faults[at])), same[0] if same else None)
    if number is None:
        return Breach((), text)
    fault = scenario.faults[number]
    if text != never_due(fault):
        return Breach(("faults", number), text)
    return Breach(("faults", number), text + _instead(run, fault.when))


def _instead(run: FaultRun, when: When) -> str:
    """Say what a run came to in place of a moment, as the end of a sentence."""
    if not run.scans:
        return ""
    if when.torque_out_above_nm is not None:
        return f"; the torque was {max(map(abs, run.torque_nm)):.1f} N·m at most" if run.torque_nm else ""
    if when.state is None:
        last = len(run.scans) - 1
        return f"; the run ended {at(run, last)}"
    stays = [visit for visit in visits(run) if visit.state == when.state]
    longest = f"{when.state} lasted {max(visit.scans for visit in stays)} scans at most; " if stays else ""
    return f"; {longest}the states of the run were {states_given(run)}"


def _not_ordered(run: FaultRun, scenario: Scenario) -> list[Breach]:
    """Return the operator's commands that the run did not take, each as a breach of its own entry.

    A command that the controller took in no scan was not given; the start of the run is none of the operator's.
    """
    taken = [change.name for change in commands(run)]
    if START in taken:
        taken.remove(START)
    wrong = []
    for number, item in enumerate(scenario.operator):
        if item.command in taken:
            taken.remove(item.command)
            continue
        text = f"operator's {item.command} was not given: its trigger ({moment_of(item.when)}) was not reached"
        wrong.append(Breach(("operator", number), text + _instead(run, item.when)))
    return wrong


def first_action(run: FaultRun) -> int | None:
    """Place in the run's lists at which the first fault acted."""
    return run.acted[0][1] if run.acted else None


def first_alarm(run: FaultRun) -> int | None:
    """Place in the run's lists of the first alarm."""
    alarms = run.alarms()
    return run.place(alarms[0].scan) if alarms else None


def low_from(run: FaultRun, place: int, limit_nm: float) -> int | None:
    """Scans after `place` from which on the torque in the reducer stays below a limit; None when it never does."""
    last = next((n for n in range(len(run.torque_nm) - 1, place - 1, -1) if abs(run.torque_nm[n]) >= limit_nm), None)
    if last is None:
        return 0
    return None if last == len(run.torque_nm) - 1 else run.waited(place, last + 1)


def _event(run: FaultRun, expect: Expect) -> str:
    acted = first_action(run)
    found = [run.place(event.scan) for event in run.alarms() if event.text == expect.event]
    if not found:
        return f"alarms were: {alarms_given(run)}"
    if acted is None:
        return "the injected fault had no effect"
    after = [place for place in found if place >= acted]
    if not after:
        return f"the alarm came before the fault took effect; alarms were: {alarms_given(run)}"
    waited = run.waited(acted, after[0])
    return (
        "" if waited <= (expect.within_scans or 0) else f"came after {waited} scans; alarms were: {alarms_given(run)}"
    )


def _reaction(run: FaultRun, expect: Expect) -> str:
    """Hold a reaction against its row of the table: in force in time, with its order, state and contacts at once."""
    alarm = first_alarm(run)
    if alarm is None:
        return "there was no alarm"
    wanted = reaction_of(expect.reaction or "")
    instead = f"reactions were: {changes_given(run, reactions(run))}"
    place = next((place for place in range(alarm, len(run.orders)) if run.orders[place].reaction == wanted), None)
    if place is None:
        return f"the reaction did not take effect; {instead}"
    waited = run.waited(alarm, place)
    if waited > (expect.within_scans or 0):
        return f"the reaction came {waited} scans after the alarm; {instead}"
    return "; ".join(not_as_in_table(run, place))


def not_as_in_table(run: FaultRun, place: int) -> list[str]:
    """Say what the reaction that came into force at a place did otherwise than its row of the table has it."""
    given, wrong = run.orders[place], []
    reaction = Reaction(given.reaction)
    row = REACTIONS[reaction]
    order, state = DriveCommand(given.drive_command), State(given.state)
    if row.orders and order not in row.orders:
        usual = " or ".join(command.name.lower() for command in row.orders)
        wrong.append(f"the drive command was {order.name.lower()} {at(run, place)}; this reaction gives {usual}")
    if row.state is not None and state != row.state:
        wrong.append(f"state {state.name.lower()} {at(run, place)}; this reaction leads to {row.state.name.lower()}")
    if place and run.orders[place - 1].brake_on != given.brake_on:
        wrong.append(f"the lock's contact changed {at(run, place)}, and the reaction must not change it")
    following = next(
        (change for change in orders(run, place)[1:] if run.orders[change.place].reaction == reaction), None
    )
    if row.then is not None and following is not None and following.name != row.then.name.lower():
        usual = row.then.name.lower()
        wrong.append(
            f"the next drive command was {following.name} {at(run, following.place)}; this reaction allows {usual}"
        )
    return wrong


def _order(run: FaultRun, expect: Expect) -> str:
    alarm = first_alarm(run)
    if alarm is None:
        return "there was no alarm"
    wanted = DriveCommand[(expect.order or "").upper()]
    instead = f"orders from the alarm on were: {changes_given(run, orders(run, alarm))}"
    for place in range(alarm, len(run.orders)):
        if run.orders[place].drive_command == wanted:
            waited = run.waited(alarm, place)
            return "" if waited <= (expect.within_scans or 0) else f"came {waited} scans after the alarm; {instead}"
    return f"the drive command was not given; {instead}"


def _torque_below(run: FaultRun, expect: Expect) -> str:
    begin = first_action(run) if expect.since == "fault" else first_alarm(run)
    if begin is None:
        return "the injected fault had no effect" if expect.since == "fault" else "there was no alarm"
    limit_nm = expect.torque_below_nm or 0.0
    scans = low_from(run, begin, limit_nm)
    if scans is not None and scans * run.period_s <= (expect.within_s or 0.0):
        return ""
    highest = max(range(begin, len(run.torque_nm)), key=lambda place: abs(run.torque_nm[place]))
    instead = (
        f"{abs(run.torque_nm[begin]):.1f} N·m {at(run, begin)}, at most {abs(run.torque_nm[highest]):.1f} N·m "
        f"{at(run, highest)}, {abs(run.torque_nm[-1]):.1f} N·m at the end"
    )
    return (
        f"the torque was {instead}" if scans is None else f"took {scans * run.period_s:.3f} s; the torque was {instead}"
    )


def _final_state(run: FaultRun, expect: Expect) -> str:
    last = run.states[-1]
    return "" if last == expect.final_state else f"was {last}; the states of the run were {states_given(run)}"


def _latched(run: FaultRun, expect: Expect) -> str:
    left = any(
        before.state == State.FAULT and after.state != State.FAULT
        for before, after in zip(run.orders, run.orders[1:], strict=False)
    )
    latched = run.states[-1] == "fault" and not left
    return "" if latched == expect.latched else f"the states of the run were {states_given(run)}"


def _never_state(run: FaultRun, never: Never) -> str:
    return f"the states of the run were {states_given(run)}" if never.state in run.states else ""


def _never_event(run: FaultRun, never: Never) -> str:
    found = [event for event in run.alarms() if event.text == never.event]
    return f"came {at(run, run.place(found[0].scan))} in {found[0].state}" if found else ""


def _never_torque(run: FaultRun, never: Never) -> str:
    peak = max(range(len(run.torque_nm)), key=lambda place: abs(run.torque_nm[place]))
    peak_nm = abs(run.torque_nm[peak])
    return f"{peak_nm:.1f} N·m {at(run, peak)}" if peak_nm > (never.torque_above_nm or 0.0) else ""


def _never_order(run: FaultRun, never: Never) -> str:
    wanted = DriveCommand[(never.order_after_fault or "").upper()]
    for place, given in enumerate(run.orders):
        if given.state == State.FAULT and given.drive_command == wanted:
            return f"came {at(run, place)}"
    return ""


def _refused(_run: FaultRun, _expect: Expect) -> str:
    return "the bench was opened, although the start must be refused"


def _found_as(run: FaultRun, expect: Expect) -> str:
    if run.kept is None:
        return NO_RECORD
    return "" if run.kept.state == expect.found_as else f"was found as {run.kept.state}"


def _record(run: FaultRun, _expect: Expect) -> str:
    return NO_RECORD if run.kept is None else "; ".join(run.kept.problems)


def _verdict(run: FaultRun, expect: Expect) -> str:
    if run.kept is None:
        return NO_RECORD
    return "" if run.kept.verdict == expect.verdict else f"was {run.kept.verdict}"


_EXPECT: dict[str, Callable[[FaultRun, Expect], str]] = {
    "event": _event,
    "reaction": _reaction,
    "order": _order,
    "torque_below_nm": _torque_below,
    "final_state": _final_state,
    "latched": _latched,
    "refused": _refused,
    "found_as": _found_as,
    "record": _record,
    "verdict": _verdict,
}
_NEVER: dict[str, Callable[[FaultRun, Never], str]] = {
    "state": _never_state,
    "event": _never_event,
    "torque_above_nm": _never_torque,
    "order_after_fault": _never_order,
}
