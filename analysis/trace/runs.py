"""Which samples belong to which branch: from the commanded segments, or from turning points found on the curve.

A run is a stretch of one direction of torque. The sign of the torque's derivative is never used: noise turns it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.trace.errors import AnalysisError
from analysis.trace.trace import SegmentInfo, Trace
from analysis.trace.units import FloatArray

TURNING_PROMINENCE = 0.25
"""A turning point stands out by this share of the whole torque range, or it is noise."""

SEARCH_BLOCKS = 4000
"""Turning points are searched on this many block means at most."""

FULL_BRANCH = 0.9
"""A last stretch that covers this share of the branch before it is a branch; less is the final unloading."""


@dataclass(frozen=True)
class Run:
    """Samples of one direction: role, direction (+1 torque rising, -1 falling), cycle, and where they are."""

    role: str
    direction: int
    cycle: int
    pieces: tuple[slice, ...]

    def take(self, values: FloatArray) -> FloatArray:
        """Take the samples of this run from a channel."""
        if len(self.pieces) == 1:
            return values[self.pieces[0]]
        return np.concatenate([values[piece] for piece in self.pieces])

    @property
    def first_row(self) -> int:
        """Row of the first sample, counted from 1."""
        return int(self.pieces[0].start) + 1


def commanded_runs(trace: Trace) -> list[Run]:
    """Return the runs of a trace with a segment table, in order of time.

    Neighbours of the same role, direction and cycle are one run: steps, each a piece, and so is each hold that belongs
    to the branch; a dwell between them is left out.
    """
    if trace.segment is None or not trace.segments:
        return []
    borders = np.flatnonzero(trace.segment[1:] != trace.segment[:-1]) + 1
    starts = [0, *borders.tolist()]
    stops = [*borders.tolist(), trace.segment.size]
    runs: list[Run] = []
    for start, stop in zip(starts, stops, strict=True):
        info: SegmentInfo = trace.segments[int(trace.segment[start])]
        if info.direction == 0:
            continue
        piece = slice(start, stop)
        last = runs[-1] if runs else None
        if last is not None and (last.role, last.direction, last.cycle) == tuple(info):
            runs[-1] = Run(last.role, last.direction, last.cycle, (*last.pieces, piece))
        else:
            runs.append(Run(info.role, info.direction, info.cycle, (piece,)))
    return runs


def found_runs(torque_nm: FloatArray) -> list[Run]:
    """Find branches between the turning points of a torque [N·m]; stretches before and after full branches are named.

    The first stretch is `virgin` when it starts nearer to zero than to a turning point, the last one `unload` when it
    covers less than 90 % of the branch before. Raises AnalysisError when the torque never turns.
    """
    size = max(1, -(-torque_nm.size // SEARCH_BLOCKS))
    edges = np.arange(0, torque_nm.size, size)
    means = np.add.reduceat(torque_nm, edges) / np.diff(np.append(edges, torque_nm.size))
    zigzag = _zigzag(means, TURNING_PROMINENCE * float(np.ptp(means)))
    turns = _with_rows_between(
        [(_refine(torque_nm, int(edges[turn]), size, rising=up), up) for turn, up in zigzag], torque_nm.size
    )
    if not turns:
        raise AnalysisError(
            f"turning points: the torque goes from {torque_nm[0]:g} to {torque_nm[-1]:g} N·m and never reverses; "
            "expected a rising and a falling branch; record a whole loop, or name the branches in column segment"
        )
    points = [0, *(row for row, _ in turns), torque_nm.size]
    directions = [1 if turns[0][1] else -1]
    for _ in turns:
        directions.append(-directions[-1])
    amplitude = float(np.abs(means).max())
    runs = [
        Run("measure", direction, 0, (slice(start, stop),))
        for direction, start, stop in zip(directions, points[:-1], points[1:], strict=True)
    ]
    if abs(float(means[0])) < 0.5 * amplitude:
        runs[0] = Run("virgin", runs[0].direction, 0, runs[0].pieces)
    spans = [abs(float(torque_nm[run.pieces[0].stop - 1] - torque_nm[run.pieces[0].start])) for run in runs]
    if spans[-1] < FULL_BRANCH * spans[-2]:
        runs[-1] = Run("unload", runs[-1].direction, 0, runs[-1].pieces)
    return runs


def paired_cycles(runs: Sequence[Run]) -> list[tuple[Run, Run]]:
    """Pair each measured branch with the next one of the opposite direction; return (forward, return) per cycle.

    A branch without a partner is left out. Raises AnalysisError when there is no pair at all.
    """
    measured = [run for run in runs if run.role == "measure"]
    pairs: list[tuple[Run, Run]] = []
    waiting: Run | None = None
    for run in measured:
        if waiting is not None and waiting.direction == -run.direction:
            pairs.append((run, waiting) if run.direction > 0 else (waiting, run))
            waiting = None
        else:
            waiting = run
    if not pairs:
        found = ", ".join(f"{run.role} {run.direction:+d}" for run in runs) or "none"
        raise AnalysisError(
            f"branches: found {found}; expected at least one rising and one falling branch to be measured, after the "
            "first rise; record a whole cycle"
        )
    return pairs


def _zigzag(values: FloatArray, prominence: float) -> list[tuple[int, bool]]:
    """Find turning points (index, is maximum) between stretches that each move by more than the prominence."""
    turns: list[tuple[int, bool]] = []
    low = high = 0
    rising: bool | None = None
    for index, value in enumerate(values.tolist()):
        if value > values[high]:
            high = index
        if value < values[low]:
            low = index
        if rising is not False and values[high] - value > prominence:
            if rising or high > 0:
                turns.append((high, True))
            rising, low = False, index
        elif rising is not True and value - values[low] > prominence:
            if rising is False or low > 0:
                turns.append((low, False))
            rising, high = True, index
    return _without_edge(values, turns, prominence)


def _without_edge(values: FloatArray, turns: list[tuple[int, bool]], prominence: float) -> list[tuple[int, bool]]:
    """Drop a first turn that noise made at the very start: nothing leads up to it."""
    if turns and abs(float(values[turns[0][0]] - values[0])) < 0.1 * prominence:
        return turns[1:]
    return turns


def _refine(torque_nm: FloatArray, start: int, size: int, *, rising: bool) -> int:
    """First sample after the extreme near a block: where the next branch begins."""
    begin, end = max(0, start - size), min(torque_nm.size, start + 2 * size)
    near = torque_nm[begin:end]
    return begin + int(np.argmax(near) if rising else np.argmin(near)) + 1


def _with_rows_between(turns: Sequence[tuple[int, bool]], rows: int) -> list[tuple[int, bool]]:
    """Leave out turns (first row after it, is maximum) between which there is no row: noise turned there and back."""
    kept: list[tuple[int, bool]] = []
    for turn in turns:
        if kept and turn[0] <= kept[-1][0]:
            kept.pop()
        else:
            kept.append(turn)
    return kept[:-1] if kept and kept[-1][0] >= rows else kept
