"""Hysteresis remembers the path: an angle sequence is followed run by run, each run of one direction in closed form."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

LARGEST_ANGLE_ARCMIN = 1e6
"""Larger angles are refused: no reducer winds up by 46 turns, and cubes of it still are finite."""

Element = Callable[[FloatArray, FloatArray], FloatArray]
"""States at the start of a run (shape m) and angles turned since (shape n, signed, one direction) to states (n, m)."""


@dataclass(frozen=True)
class PathState:
    """Where a model stands: last angle [arcmin] and its hysteresis states; as made, a unit at rest without load."""

    angle_arcmin: float | None = None
    hysteresis: FloatArray = field(default_factory=lambda: np.zeros(0))


def follow(
    angle_arcmin: FloatArray, state: PathState, rest_arcmin: float, states: int, element: Element
) -> tuple[FloatArray, PathState]:
    """Follow angles [arcmin] from a state; return the hysteresis states per sample (shape n, m) and the last state.

    rest_arcmin: angle of the unit without load, from which it comes when the state has no angle.
    Raises AnalysisError for angles that are not finite or beyond 1e6 arcmin, and for a state of another model.
    """
    angle = checked_angles(angle_arcmin)
    last = np.zeros(states) if state.hysteresis.size == 0 else state.hysteresis
    if last.shape != (states,):
        raise AnalysisError(
            f"model: the start state is of another model: it has {last.size} hysteresis values; this model has "
            f"{states}. Use a state that this model returned"
        )
    found = np.empty((angle.size, states))
    before = rest_arcmin if state.angle_arcmin is None else state.angle_arcmin
    for piece in _runs_of_one_direction(angle, before):
        start = before if piece.start == 0 else float(angle[piece.start - 1])
        found[piece] = element(last, angle[piece] - start)
        last = found[piece.stop - 1]
    return found, PathState(float(angle[-1]) if angle.size else before, last.copy())


def checked_angles(angle_arcmin: FloatArray) -> FloatArray:
    """Return the angles as a float array; AnalysisError for what is no finite row of angles."""
    angle = np.asarray(angle_arcmin, dtype=np.float64)
    if angle.ndim != 1:
        raise AnalysisError(f"model: the angles have {angle.ndim} dimensions; expected one angle per sample")
    bad = ~(np.abs(angle) <= LARGEST_ANGLE_ARCMIN)
    if bad.any():
        row = int(np.argmax(bad)) + 1
        raise AnalysisError(
            f"model: angle {row} is {angle[row - 1]} arcmin; expected a finite angle within "
            f"±{LARGEST_ANGLE_ARCMIN:g} arcmin; repair or remove this angle"
        )
    return angle


def _runs_of_one_direction(angle: FloatArray, before: float) -> Iterator[slice]:
    """Yield stretches that turn one way; samples that stand still belong to the stretch before."""
    if not angle.size:
        return
    direction = np.sign(np.diff(angle, prepend=before))
    moving = np.flatnonzero(direction)
    if moving.size:
        turns = moving[1:][direction[moving[1:]] != direction[moving[:-1]]]
        borders = [0, *turns.tolist(), angle.size]
    else:
        borders = [0, angle.size]
    for start, stop in itertools.pairwise(borders):
        yield slice(start, stop)
