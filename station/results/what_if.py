"""What if another recipe had been in force: its interlocks and its verdict limits on a run that was recorded.

The run's own controller steps through the record, so that tares, references and states are exactly those of the run;
beside it a second set of interlocks looks at the same scans with the other recipe's limits. Up to the divergence, the
first scan in which the other recipe's controller orders something else, the answer is exact; after it the bench would
have gone another way, and what stands in the record shows only what was measured, not what would have been.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np

from analysis.evaluation.pipeline import Result as Found
from controller.conditions import Measured
from controller.interlocks import INTERLOCKS, Watch
from definitions.faults import FAULT_BY_NUMBER
from definitions.image import Image, Reaction, State
from definitions.program import Program, Segment
from definitions.states import LOADED
from recipes import Bench, Recipe
from station.documents.result import MetricValue
from station.documents.timing import Timing
from station.records.program_file import SegmentRow
from station.records.samples.table import Table
from station.records.timing_proof import run_facts
from station.results.divergence import Divergence
from station.results.evaluation import evaluate_trace, trace_of


class Raised(NamedTuple):
    """An interlock that was, or would have been, raised: number of the fault and of the record."""

    number: int
    sequence: int


class ShadowWatch(Watch):
    """The interlocks of the run, and beside them those of another program, which only look."""

    def __init__(self, program: Program, other: Program) -> None:
        super().__init__(program)
        self._shadow = Watch(other)
        self._other_limits = other.limits
        self._lock_proven = True
        self._looks = 0
        self._noted = 0
        self.raised: list[Raised] = []

    def look(self, image: Image, measured: Measured, state: State) -> int:
        """Evaluate both; the run follows its own."""
        strongest = super().look(image, measured, state)
        own_limit_rad = measured.lock_motion_limit_rad
        if isfinite(own_limit_rad):
            measured.lock_motion_limit_rad = self._lock_limit_rad(state)
        self._shadow.look(image, measured, state)
        measured.lock_motion_limit_rad = own_limit_rad
        fresh = self._shadow.latched & ~self._noted
        self._noted |= fresh
        while fresh:
            bit = fresh & -fresh
            fresh ^= bit
            self.raised.append(Raised(bit.bit_length() - 1, self._looks))
        self._looks += 1
        return strongest

    def _lock_limit_rad(self, state: State) -> float:
        """Return the other recipe's limit of the lock [rad]: that of its proof, until a load says that it is proven."""
        if state == State.LOCK:
            self._lock_proven = False
        elif state in LOADED:
            self._lock_proven = True
        limits = self._other_limits
        return limits.lock_slip_rad if self._lock_proven else limits.lock_proof_motion_rad


WATCHED = frozenset(row.fault for row in INTERLOCKS)


def recorded_interlocks(table: Table) -> list[Raised]:
    """Return the interlocks that the run itself raised; faults of steps (homing, tare ...) are not among them."""
    alarms = table["orders"]["alarms"]
    found = []
    for number, fault in FAULT_BY_NUMBER.items():
        if fault.id in WATCHED:
            raised = (alarms >> np.uint64(number)) & np.uint64(1)
            if raised.any():
                found.append(Raised(number, int(np.argmax(raised))))
    return sorted(found, key=lambda one: one.sequence)


@dataclass(frozen=True, slots=True, kw_only=True)
class InterlockChange:
    """An interlock that would have acted otherwise.

    `change` is "new" (only with the other recipe), "gone" (only as recorded) or "moved" (at another scan).
    """

    change: str
    id: str
    reaction: str
    state: str
    recorded_scan: int | None
    other_scan: int | None
    torque_out_nm: float
    diverges: bool
    exact: bool

    @property
    def first_scan(self) -> int:
        """The scan in which the two first differ."""
        return min(scan for scan in (self.recorded_scan, self.other_scan) if scan is not None)


def interlock_changes(table: Table, shadow: ShadowWatch, divergence: Divergence | None) -> tuple[InterlockChange, ...]:
    """Return what the other recipe's interlocks would have done differently, in order of time.

    `exact` is False for what comes after the divergence: the other recipe would never have seen that load.
    """
    recorded = dict(recorded_interlocks(table))
    other = dict(shadow.raised)
    changes = []
    for number in sorted(recorded.keys() | other.keys()):
        before, then = recorded.get(number), other.get(number)
        if before == then:
            continue
        change = "new" if before is None else "gone" if then is None else "moved"
        at = min(position for position in (before, then) if position is not None)
        fault = FAULT_BY_NUMBER[number]
        changes.append(
            InterlockChange(
                change=change,
                id=fault.id,
                reaction=Reaction(fault.reaction).name.lower(),
                state=State(int(table["orders"]["state"][max(at - 1, 0)])).name.lower(),
                recorded_scan=None if before is None else int(table["scan"][before]),
                other_scan=None if then is None else int(table["scan"][then]),
                torque_out_nm=round(float(table["image"]["torque_out_nm"][at]), 3),
                diverges=fault.reaction >= Reaction.HOLD,
                exact=divergence is None or at <= divergence.sequence,
            ),
        )
    return tuple(sorted(changes, key=lambda one: one.first_scan))


def tare_changes(table: Table, own: Program, other: Program) -> list[str]:
    """Return which torque zeroes the other recipe would have refused."""
    orders = table["orders"]
    changes = []
    for channel in ("torque_in", "torque_out"):
        zero_nm = float(orders[f"{channel}_tare_nm"][-1])
        allowed_nm = getattr(other.tare, f"{channel}_zero_nm")
        if abs(zero_nm) > allowed_nm and abs(zero_nm) <= getattr(own.tare, f"{channel}_zero_nm"):
            changes.append(
                f"the zero offset of {channel} is {zero_nm:.4g} N·m, the other recipe allows at most "
                f"{allowed_nm:.4g} N·m"
            )
    return changes


def same_load(own: Program, other: Program) -> bool:
    """Whether both recipes command the same load: then the interlocks and limits are all that differs."""
    return own.segments == other.segments and own.period_s == other.period_s


class Stored(NamedTuple):
    """What a run says of its trace: segment table, proof of timing and its id."""

    segments: Sequence[SegmentRow | Segment]
    timing: Timing
    id: str


def judge(table: Table, recipe: Recipe, bench: Bench, stored: Stored, objections: Sequence[str] = ()) -> Found:
    """Evaluate the recorded trace by a recipe's method and limits.

    Args:
        table: all records of the run.
        recipe: the recipe.
        bench: the run's own bench.
        stored: what the run says of its trace.
        objections: what speaks against the record as a whole.

    """
    facts = run_facts(table, stored.timing, recipe.sampling)
    trace = trace_of(table, stored.segments, bench, stored.timing.period_ns, stored.id)
    return evaluate_trace(trace, recipe, bench, [*objections], facts)


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricChange:
    """A metric as recorded and by the other recipe; None where one of them does not ask for it."""

    id: str
    branch: str
    recorded: MetricValue | None
    other: MetricValue | None


def _key(metric: MetricValue) -> tuple[object, ...]:
    return metric.id, metric.branch, metric.side, metric.torque_nm, metric.band


def _judged_by(metric: MetricValue | None) -> tuple[object, ...]:
    return () if metric is None else (metric.value, metric.limits, metric.verdict)


def verdict_changes(recorded: Sequence[MetricValue], other: Sequence[MetricValue]) -> tuple[MetricChange, ...]:
    """Return the metrics whose value, limits or verdict differ between two results."""
    before = {_key(metric): metric for metric in recorded}
    then = {_key(metric): metric for metric in other}
    changes = []
    for key in dict.fromkeys((*before, *then)):
        one, two = before.get(key), then.get(key)
        named = one or two
        if named is not None and _judged_by(one) != _judged_by(two):
            changes.append(MetricChange(id=named.id, branch=named.branch, recorded=one, other=two))
    return tuple(changes)
