"""What is said first of a result: how the run ended, the verdict, that nothing real was measured, faults injected."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from definitions.checks import CHECKS
from station.records.clocks import VIRTUAL, clock_of
from station.reports.result_text import titled_reason

BENCH_FAULT = "BENCH FAULT"
FAULTS_INJECTED = "FAULTS INJECTED"
ENDED_WELL = ("complete", "analyzed")
NOTES = ("warn", "hold")
"""Reactions of alarms that end no run: notes to whoever looks after the bench."""

ENDINGS: dict[str, str] = {
    "fault": "ended in a fault",
    "stopped": "was stopped",
    "interrupted": "was interrupted",
    "recording": "is still in progress",
    "not concluded": "is not concluded",
    "complete": "complete",
    "analyzed": "analyzed",
}
"""State of a run as it stands behind the word `run`."""


STOPPED_BY: dict[str, str] = {
    "operator": "by the operator",
    "disk": "records could not be written to disk",
    "records_lost": "records were lost: the supervisor process was too slow",
    "desk_silent": "the supervisor process ended during the run",
    "desk_gone": "the supervisor process ended before the run started",
}
"""Who or what stopped a run, as it stands behind STOPPED."""


class Headline(NamedTuple):
    """First line of a result, the verdict below it ('' where the verdict is the headline), and its style's name."""

    text: str
    verdict: str
    style: str


def first_cause(result: dict[str, Any]) -> dict[str, Any] | None:
    """Return the alarm that ended the run, None when none did."""
    return next((alarm for alarm in result.get("alarms", []) if alarm.get("first")), None)


def is_note(alarm: dict[str, Any]) -> bool:
    """Whether an alarm only held or warned: it ends no run and is shown without alarm."""
    return alarm["reaction"] in NOTES


def headline(result: dict[str, Any]) -> Headline:
    """Return what stands first: the verdict of a run that came to its end, else what became of the run."""
    verdict, state = str(result["verdict"]), result["state"]
    if state in ENDED_WELL:
        return Headline(verdict, "", verdict)
    if state == "fault":
        cause = first_cause(result)
        found = cause["text"] if cause is not None else "the bench could not be opened"
        if cause is None and result.get("timing") and result["timing"]["scans"]:
            found = "the run ended in a fault"
        return Headline(f"{BENCH_FAULT}: {found}", verdict, "fault")
    if state == "stopped":
        cause = first_cause(result)
        found = STOPPED_BY.get(result.get("stopped_by") or "operator", "before its end")
        found = found if cause is None or is_note(cause) else cause["text"]
        return Headline(f"STOPPED: {found}", verdict, "stopped")
    return Headline(ENDINGS.get(state, state).removeprefix("was ").removeprefix("is ").upper(), verdict, "stopped")


def ending_text(result: dict[str, Any]) -> str:
    """Return how the run ended, to be read behind `run`."""
    return ENDINGS.get(result["state"], str(result["state"]))


def remaining_reasons(result: dict[str, Any]) -> list[str]:
    """Return the reasons, metrics and checks by title, without what the headline says already."""
    cause = first_cause(result)
    said = f"{cause['text']}: " if cause is not None and result["state"] == "fault" else ""
    titles = {name: check.title for name, check in CHECKS.items()}
    titles |= {str(metric["id"]): str(metric.get("title", "")) for metric in result.get("metrics") or ()}
    return [titled_reason(reason.removeprefix(said), titles) for reason in result["reasons"]]


def objection(result: Mapping[str, Any]) -> str:
    """Return why a result's measurement was invalid, in its own words; '' where it was not."""
    said = (str(reason) for reason in result.get("reasons", ()))
    return next((reason for reason in said if reason.startswith("measurement invalid")), "")


def badges(result: dict[str, Any]) -> tuple[str, ...]:
    """Return what stands beside the verdict so that nobody overlooks it: not real, or with faults injected."""
    return (*virtual_badges(result), *((FAULTS_INJECTED,) if result.get("scenario") else ()))


def virtual_unit(unit: Mapping[str, Any]) -> str:
    """Return the unit on the virtual bench, with what makes its noise again; empty for a real one."""
    name, seed = unit.get("virtual"), unit.get("noise_seed")
    if not name:
        return ""
    return str(name) if seed is None else f"{name}, noise seed {seed} (again: --unit {name} --seed {seed})"


def virtual_badges(result: dict[str, Any]) -> tuple[str, ...]:
    """Return what says that no real unit was measured; empty for a real bench in real time."""
    bench, unit = result.get("bench") or {}, result.get("unit") or {}
    timing = result.get("timing") or {}
    in_virtual_time = VIRTUAL in (clock_of(result), clock_of(timing))
    found = []
    if in_virtual_time and bench.get("embedded") is False:
        found.append(f"SIMULATED BENCH {bench['name']}")
    elif in_virtual_time or unit.get("virtual"):
        found.append("VIRTUAL BENCH")
    return (*found, "VIRTUAL TIME") if in_virtual_time else tuple(found)
