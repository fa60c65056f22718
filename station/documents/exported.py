"""What an exported file says of its run: who it is, by what it was measured, what came of it, how it was recorded."""

from __future__ import annotations

from dataclasses import dataclass

from station.documents.entries import Count, left_out
from station.documents.manifest import BenchSource, CountFrom1, Finite, Moment, Period, RecipeSource, Software
from station.documents.result import MetricValue
from station.documents.timing import Timing


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """What was counted while recording, whatever a recipe allows of it.

    holds: how often a ramp was held; None in what was counted by versions that did not ask.
    """

    periods: CountFrom1
    missed: Count
    oldest_sample_scans: Count
    torque_in_saturated: Count
    torque_out_saturated: Count
    not_ready: Count
    bench_waited: Count = 0
    zeroes_again: Count | None = None
    torque_in_zero_shift_nm: Finite | None = None
    torque_out_zero_shift_nm: Finite | None = None
    holds: Count | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedRun:
    """A run as its exported file describes it.

    `trace` is the fingerprint of the trace, and `recorded` what was counted; both are there when it has a trace.
    `ratio` and `loading` are those of its recipe; files of older versions lack them.
    """

    id: str
    serial: str
    attempt: int | None = None
    state: str
    started: Moment
    ended: str | None = left_out()
    clock: str | None = None
    period_ns: Period
    recipe: RecipeSource
    bench: BenchSource
    software: Software
    scenario: str | None = left_out()
    operator: str | None = left_out()
    unit: str
    ratio: Finite | None = left_out()
    loading: str | None = left_out()
    virtual_unit: str | None = left_out()
    noise_seed: int | None = left_out()
    verdict: str
    reasons: tuple[str, ...] = ()
    metrics: tuple[MetricValue, ...] = ()
    timing: Timing | None = None
    altered: tuple[str, ...] | None = left_out()
    trace: str | None = left_out()
    recorded: Counts | None = left_out()
