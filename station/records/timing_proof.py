"""The proof of timing: what the records say about wake-up latency, work, missed periods and the age of samples."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from analysis.validity.evidence import RunFacts
from definitions.image import Reaction, SampleStatus, State
from definitions.states import LOADED
from recipes.schema.recipe_schema import Sampling
from station.documents.exported import Counts
from station.documents.scan_report import Pace, Percentiles, Realtime
from station.documents.timing import Timing
from station.records.clocks import SCAN, clock_of
from station.records.samples.table import Table
from station.records.samples.zeroes import from_zero, read_again

FRAMES_ON_THEIR_WAY = 64
"""Frames that may have come after the last answer of the bench that sets the pace."""

COUNTED: dict[SampleStatus, str] = {
    SampleStatus.TORQUE_IN_SATURATED: "torque_in_saturated",
    SampleStatus.TORQUE_OUT_SATURATED: "torque_out_saturated",
    SampleStatus.NOT_READY: "not_ready",
}
"""Status bits of the samples, and the validity check that counts each."""


def measuring(table: Table) -> npt.NDArray[np.bool_]:
    """Return which records were taken while the recipe's torque was on the unit."""
    return np.isin(table["orders"]["state"], sorted(LOADED))


def _percentiles(values_ns: Any) -> Percentiles:
    if not values_ns.size:
        return Percentiles()
    p50, p99, p999 = (round(float(value), 3) for value in np.percentile(values_ns, (50, 99, 99.9)) / 1000.0)
    return Percentiles(p50=p50, p99=p99, p999=p999, max=round(float(values_ns.max()) / 1000.0, 3))


def timing_block(table: Table, period_ns: int, clock: str, realtime: Realtime) -> Timing:
    """Return the `timing` object of a result; times in µs, ages in scans. `clock` is one of `CLOCKS`."""
    ages = table["image"]["sample_age_scans"][measuring(table)]
    return Timing(
        period_ns=period_ns,
        clock=clock,
        scans=len(table),
        missed=int(table["image"]["missed_periods"].sum(dtype=np.int64)),
        longest_gap_periods=int(table["image"]["missed_periods"].max(initial=0)),
        lateness_us=_percentiles(table["lateness_ns"]),
        work_us=_percentiles(table["work_ns"]),
        oldest_sample_scans=int(ages.max(initial=0)),
        realtime=realtime,
    )


def run_facts(table: Table, timing: Timing, sampling: Sampling) -> RunFacts:
    """Return how a trace was recorded, as the validity checks want to know it.

    Args:
        table: all records of the run.
        timing: its timing block.
        sampling: what the recipe allows.

    """
    return facts_of_counts(counts_of(table, timing), timing.period_ns, sampling)


def counts_of(table: Table, timing: Timing) -> Counts:
    """Return what was counted while recording, whatever a recipe allows of it; arguments as in `run_facts`."""
    flags = table["image"]["sample_status"][measuring(table)]
    counts = Counts(
        periods=timing.scans + timing.missed,
        missed=timing.missed,
        oldest_sample_scans=timing.oldest_sample_scans,
        **{name: int(np.count_nonzero(flags & bit)) for bit, name in COUNTED.items()},
        bench_waited=int(clock_of(timing.clock) == SCAN),
        holds=holds_in(table),
    )
    return _with_zeroes(counts, table)


def holds_in(table: Table) -> int:
    """Return how often a ramp was held while the recipe's torque was on the unit."""
    held = table["orders"]["reaction"][measuring(table)] == Reaction.HOLD
    return int(np.count_nonzero(held[1:] & ~held[:-1])) + int(held[:1].sum())


def _with_zeroes(counts: Counts, table: Table) -> Counts:
    """Add how many samples of the torque zeroes came after the run, and their means; nothing in older records."""
    there = read_again(table)
    if not len(there):
        ended = bool(np.any((table["orders"]["state"] == State.COMPLETE) & (table["orders"]["phase"] > 0)))
        return replace(counts, zeroes_again=0) if ended else counts
    torque_in, torque_out = (float(from_zero(there, name).mean()) for name in ("torque_in_nm", "torque_out_nm"))
    return replace(
        counts,
        zeroes_again=len(there),
        torque_in_zero_shift_nm=torque_in if math.isfinite(torque_in) else None,
        torque_out_zero_shift_nm=torque_out if math.isfinite(torque_out) else None,
    )


def facts_of_counts(counts: Counts, period_ns: int, sampling: Sampling) -> RunFacts:
    """Return counts of a recording with what the recipe allows."""
    return RunFacts(
        **asdict(counts),
        missed_allowed=sampling.missed_periods_fraction,
        sample_age_allowed_scans=round(sampling.sample_age_s * 1e9 / period_ns),
    )


def objections_to_clock(timing: Timing) -> list[str]:
    """Return what the clock has against a verdict: by one that waits for the scan only virtual units are judged."""
    pace = timing.pace or Pace()
    if clock_of(timing.clock) != SCAN:
        return []
    why = "the scan clock is for virtual units only"
    if not pace.unit:
        return [f"{why}, and no virtual bench has named its unit. Measure by the wall clock"]
    received, sent = pace.frames_received, pace.frames_sent_by_bench
    if received <= sent + FRAMES_ON_THEIR_WAY:
        return []
    found = f"{received} CAN frames came, and the virtual bench that sets the pace sent {sent}"
    return [f"{why}: {found}. Another device answers. Take 'pace' out of the bench file"]


def clock_note(timing: Timing) -> str:
    """Return what this computer would have missed with real hardware, and how to mend that; '' where nothing."""
    pace = timing.pace or Pace()
    missed = pace.would_have_missed
    if clock_of(timing.clock) != SCAN or not missed:
        return ""
    share = missed / max(timing.scans, 1)
    return (
        f"With real hardware this computer would have missed {missed} scan cycles ({share:.2%}). 'lostmotion timing' "
        "shows causes and remedies"
    )
