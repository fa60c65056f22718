"""What is said first of a result: how the run ended, the verdict, that nothing real was measured, faults injected."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from definitions.checks import CHECKS
from station.documents.manifest import BenchSource, Manifest, Unit
from station.documents.result import Result
from station.records.clocks import VIRTUAL, clock_of
from station.reports.result_text import titled_reason

BENCH_FAULT = "BENCH FAULT"
FAULTS_INJECTED = "FAULTS INJECTED"
INVALID = "measurement invalid"
"""How a reason begins that is no limit of a metric."""

ENDED_WELL = ("complete", "analyzed")

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


def headline(result: Result) -> Headline:
    """Return what stands first: the verdict of a run that came to its end, else what became of the run."""
    verdict, state = result.verdict, result.state
    if state in ENDED_WELL:
        return Headline(verdict, "", verdict)
    if state == "fault":
        cause = result.first_cause
        found = cause.text if cause is not None else "the bench could not be opened"
        if cause is None and result.timing is not None and result.timing.scans:
            found = "the run ended in a fault"
        return Headline(f"{BENCH_FAULT}: {found}", verdict, "fault")
    if state == "stopped":
        cause = result.first_cause
        found = STOPPED_BY.get(result.stopped_by or "operator", "before its end")
        found = found if cause is None or cause.is_note else cause.text
        return Headline(f"STOPPED: {found}", verdict, "stopped")
    return Headline(ENDINGS.get(state, state).removeprefix("was ").removeprefix("is ").upper(), verdict, "stopped")


def how_it_ended(result: Result) -> str:
    """Return how the run ended, to be read behind `run`."""
    return ENDINGS.get(result.state, result.state)


def remaining_reasons(result: Result) -> list[str]:
    """Return the reasons, metrics and checks by title, without what the headline says already."""
    cause = result.first_cause
    said = f"{cause.text}: " if cause is not None and result.state == "fault" else ""
    titles = {name: check.title for name, check in CHECKS.items()}
    titles |= {metric.id: metric.title or "" for metric in result.metrics}
    return [titled_reason(reason.removeprefix(said), titles) for reason in result.reasons]


def objection(result: Result) -> str:
    """Return why a result's measurement was invalid, in its own words; '' where it was not."""
    return next((reason for reason in result.reasons if reason.startswith(INVALID)), "")


def badges(result: Result) -> tuple[str, ...]:
    """Return what stands beside the verdict so that nobody overlooks it: not real, or with faults injected."""
    return (*virtual_badges(result), *((FAULTS_INJECTED,) if result.scenario else ()))


def virtual_unit(unit: Unit | None) -> str:
    """Return the unit on the virtual bench, with what makes its noise again; empty for a real one."""
    if unit is None or not unit.virtual:
        return ""
    name, seed = unit.virtual, unit.noise_seed
    return name if seed is None else f"{name}, noise seed {seed} (again: --unit {name} --seed {seed})"


def virtual_badges(result: Result) -> tuple[str, ...]:
    """Return what says that no real unit was measured; empty for a real bench in real time."""
    timing = result.timing
    clocks = (result.clock, None if timing is None else timing.clock)
    return _virtual_badges(clocks, result.bench, result.unit)


def manifest_badges(manifest: Manifest) -> tuple[str, ...]:
    """Return the same of a run whose result is not believed, by what was known when it began."""
    return _virtual_badges((manifest.clock,), manifest.bench, manifest.unit)


def _virtual_badges(clocks: Sequence[str | None], bench: BenchSource | None, unit: Unit | None) -> tuple[str, ...]:
    in_virtual_time = VIRTUAL in map(clock_of, clocks)
    found = []
    if in_virtual_time and bench is not None and not bench.embedded:
        found.append(f"SIMULATED BENCH {bench.name}")
    elif in_virtual_time or (unit is not None and unit.virtual):
        found.append("VIRTUAL BENCH")
    return (*found, "VIRTUAL TIME") if in_virtual_time else tuple(found)
