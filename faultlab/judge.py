"""Judges a run with faults by what its scenario expects and forbids; every breach is one plain sentence."""

from __future__ import annotations

from collections.abc import Callable

from definitions.faults import FAULT_BY_ID
from definitions.image import DriveCommand, State
from faultlab.run import FaultRun
from virtual_bench.faults.scenario import Expect, Never, Scenario

INTERRUPTED = "interrupted"
NO_RECORD = "a run in virtual time has no record; run it over wires"


def judge(run: FaultRun, scenario: Scenario) -> list[str]:
    """Return what went wrong, in the order of the file; an empty list when the scenario holds."""
    wrong = list(run.unseen)
    if run.refused:
        if all(expect.refused is None for expect in scenario.expect):
            wrong.append(f"the bench was refused, so nothing was tried: {run.refused}")
        refusals = [expect.refused for expect in scenario.expect if expect.refused is not None]
        return wrong + [
            f"expected refused {text}: it says {run.refused}" for text in refusals if text not in run.refused
        ]
    if not run.finished and all(expect.found_as != INTERRUPTED for expect in scenario.expect):
        wrong.append("the run did not end")
    for expect in scenario.expect:
        kind = next(name for name in _EXPECT if getattr(expect, name) is not None)
        found = _EXPECT[kind](run, expect)
        if found:
            wrong.append(f"expected {_text(expect)}: {found}")
    for never in scenario.never:
        kind = next(name for name in _NEVER if getattr(never, name) is not None)
        found = _NEVER[kind](run, never)
        if found:
            wrong.append(f"never {_text(never)}: {found}")
    return wrong


def _text(clause: Expect | Never) -> str:
    return ", ".join(f"{name} {value}" for name, value in clause.model_dump(exclude_none=True).items())


def first_action(run: FaultRun) -> int | None:
    """Place in the run's lists at which the first fault acted."""
    return run.acted[0][1] if run.acted else None


def first_alarm(run: FaultRun) -> int | None:
    """Place in the run's lists of the first alarm."""
    alarms = run.alarms()
    return run.place(alarms[0].scan) if alarms else None


def low_from(run: FaultRun, place: int, limit_nm: float) -> int | None:
    """Scans after `place` from which on the torque in the reducer stays below a limit; None when it never does."""
    last = next((at for at in range(len(run.torque_nm) - 1, place - 1, -1) if abs(run.torque_nm[at]) >= limit_nm), None)
    if last is None:
        return 0
    return None if last == len(run.torque_nm) - 1 else run.waited(place, last + 1)


def _event(run: FaultRun, expect: Expect) -> str:
    if expect.event not in FAULT_BY_ID:
        return f"unknown fault; allowed {', '.join(sorted(FAULT_BY_ID))}"
    acted = first_action(run)
    found = [event.scan for event in run.alarms() if event.text == expect.event]
    if not found:
        said = ", ".join(event.text for event in run.alarms()) or "none"
        return f"alarms were: {said}"
    if acted is None:
        return "no fault has acted"
    waited = run.waited(acted, run.place(found[0]))
    return "" if waited <= (expect.within_scans or 0) else f"came after {waited} scans"


def _order(run: FaultRun, expect: Expect) -> str:
    alarm = first_alarm(run)
    if alarm is None:
        return "there was no alarm"
    wanted = DriveCommand[(expect.order or "").upper()]
    for at in range(alarm, len(run.orders)):
        if run.orders[at].drive_command == wanted:
            waited = run.waited(alarm, at)
            return "" if waited <= (expect.within_scans or 0) else f"came {waited} scans after the alarm"
    return "was not given"


def _torque_below(run: FaultRun, expect: Expect) -> str:
    begin = first_action(run) if expect.since == "fault" else first_alarm(run)
    if begin is None:
        return "no fault has acted" if expect.since == "fault" else "there was no alarm"
    limit_nm = expect.torque_below_nm or 0.0
    scans = low_from(run, begin, limit_nm)
    if scans is None:
        return f"{abs(run.torque_nm[-1]):.1f} N·m at the end"
    return "" if scans * run.period_s <= (expect.within_s or 0.0) else f"took {scans * run.period_s:.3f} s"


def _final_state(run: FaultRun, expect: Expect) -> str:
    return "" if run.states[-1] == expect.final_state else f"was {run.states[-1]}"


def _latched(run: FaultRun, expect: Expect) -> str:
    left = any(
        before.state == State.FAULT and after.state != State.FAULT
        for before, after in zip(run.orders, run.orders[1:], strict=False)
    )
    latched = run.states[-1] == "fault" and not left
    return "" if latched == expect.latched else f"states were {' → '.join(run.states)}"


def _never_state(run: FaultRun, never: Never) -> str:
    return f"states were {' → '.join(run.states)}" if never.state in run.states else ""


def _never_event(run: FaultRun, never: Never) -> str:
    found = [event for event in run.alarms() if event.text == never.event]
    return f"at scan {found[0].scan}" if found else ""


def _never_torque(run: FaultRun, never: Never) -> str:
    peak_nm = max(abs(torque_nm) for torque_nm in run.torque_nm)
    return f"{peak_nm:.1f} N·m" if peak_nm > (never.torque_above_nm or 0.0) else ""


def _never_order(run: FaultRun, never: Never) -> str:
    wanted = DriveCommand[(never.order_after_fault or "").upper()]
    for scan, orders in zip(run.scans, run.orders, strict=True):
        if orders.state == State.FAULT and orders.drive_command == wanted:
            return f"at scan {scan}"
    return ""


def _refused(_run: FaultRun, _expect: Expect) -> str:
    return "the bench was opened"


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
