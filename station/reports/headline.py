"""What is said first of a result: how the run ended, the verdict, that nothing real was measured, faults injected."""

from __future__ import annotations

from typing import Any, NamedTuple

BENCH_FAULT = "BENCH FAULT"
FAULTS_INJECTED = "FAULTS INJECTED"
ENDED_WELL = ("complete", "analyzed")
NOTES = ("warn", "hold")
"""Reactions of alarms that end no run: notes to whoever looks after the bench."""

ENDINGS: dict[str, str] = {
    "fault": "ended in a fault",
    "stopped": "was stopped",
    "interrupted": "was interrupted",
    "recording": "is still going on",
    "complete": "complete",
    "analyzed": "analyzed",
}
"""State of a run as it stands behind the word `run`."""


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
        found = "by the operator" if cause is None or is_note(cause) else cause["text"]
        return Headline(f"STOPPED: {found}", verdict, "stopped")
    return Headline(ENDINGS.get(state, state).removeprefix("was ").removeprefix("is ").upper(), verdict, "stopped")


def ending_text(result: dict[str, Any]) -> str:
    """Return how the run ended, to be read behind `run`."""
    return ENDINGS.get(result["state"], str(result["state"]))


def remaining_reasons(result: dict[str, Any]) -> list[str]:
    """Return the reasons with what the headline says already left out of the first one."""
    cause = first_cause(result)
    said = f"{cause['text']}: " if cause is not None and result["state"] == "fault" else ""
    return [reason.removeprefix(said) if said else reason for reason in result["reasons"]]


def badges(result: dict[str, Any]) -> tuple[str, ...]:
    """Return what stands beside the verdict so that nobody overlooks it: not real, or with faults injected."""
    return (*virtual_badges(result), *((FAULTS_INJECTED,) if result.get("scenario") else ()))


def virtual_badges(result: dict[str, Any]) -> tuple[str, ...]:
    """Return what says that no real unit was measured; empty for a real bench in real time."""
    bench, unit = result.get("bench") or {}, result.get("unit") or {}
    timing = result.get("timing") or {}
    in_virtual_time = "virtual" in (result.get("clock"), timing.get("clock"))
    found = []
    if in_virtual_time and bench.get("embedded") is False:
        found.append(f"SIMULATED BENCH {bench['name']}")
    elif in_virtual_time or unit.get("virtual"):
        found.append("VIRTUAL BENCH")
    return (*found, "VIRTUAL TIME") if in_virtual_time else tuple(found)
