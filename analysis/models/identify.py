"""Parameters of a model from a measured loop: robust least squares, covariance, and what the loop cannot tell.

A branch is followed from its turn with a hysteresis state of its own. What the friction is when the wind-up turns
cannot be had from the path before: while a torque is held, a drive that hums by less than an encoder's step makes
friction creep, and it turns from less than all of it. For the same reason a part of a branch may disobey the law
of the model; Cauchy's loss lets what obeys it decide.

Residuals of a model that does not quite fit are not noise: neighbours err alike. The covariance is the larger one, for
each parameter, of two: residuals as independent, and residuals summed over stretches of the path (P. J. Huber, "The
behavior of maximum likelihood estimates under nonstandard conditions", 1967; stretches as clusters after K.-Y. Liang
and S. L. Zeger, 1986). To that comes what is left of the noise of the wind-up: next to a turn the loop is so steep that
an encoder's step is many N·m. None of it knows of errors that every stretch shares, as of a sensor's gain.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads optimize where it is used

from analysis.models.path import PathState
from analysis.models.samples import LoopSamples, loop_shape
from analysis.models.table import Model, checked_values, model_named
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray, IntArray

FIRST_EVALUATIONS = 12
"""Steps from each start; the best one is then followed to its end."""

MOST_EVALUATIONS = 200

ROUNDS = (1e-4, 1e-5, 1e-8)
"""Fits with the scale of Cauchy's loss from the residuals of the fit before: relative change of the loss at the end."""

ROUGH = 1e-3
"""The same for the fit by least squares before them."""

CAUCHY = 2.385 * 1.4826
"""Scale of the loss over the median of the residuals' size: 95 % efficient where they are normal."""

LEAST_SCALE = 1e-9
"""Scale of the loss over the peak torque at least: a loop without noise leaves rounding."""

TURNS = 2
"""Kinds of turn: from rising to falling, and back."""

FIRST_SHARE = 0.9
"""Where the search starts for the share of the friction that is there at a turn."""

MOST_CORRELATION = 0.95
"""Parameters whose estimates hang together by more than this cannot be told apart."""

NO_INFLUENCE = 1e-9
"""A parameter whose column of the Jacobian is this small beside the largest one does not move the torque."""

STRETCHES = (160, 40, 10, 3, 1)
"""Lengths of path over which residuals are summed, as parts of a branch: the one that says most counts."""

SHORT_STRETCHES = 10
"""Stretches of this many parts of a branch or more: how far an error of the wind-up may reach."""


@dataclass(frozen=True)
class Identified:
    """A model with its parameters, and how far they can be trusted.

    values by name; u standard uncertainty by name (0: fixed; NaN: at its bound or without influence), from residuals
    that hang together along the path. correlation: of the parameters in `free`. residual_pct and worst_pct: rms and
    largest residual as % of the peak torque, from turn to turn. at_bound: parameters that ended at the limit of their
    range. friction_at_turns: share of the friction, 0…1, that was left when the wind-up turned to fall and to rise;
    1 where nothing had crept; none for a model that has no memory or keeps it over the turn.
    """

    model: str
    values: Mapping[str, float]
    u: Mapping[str, float]
    free: tuple[str, ...]
    correlation: FloatArray
    refused: tuple[Refusal, ...]
    at_bound: tuple[str, ...]
    residual_pct: float
    worst_pct: float
    peak_nm: float
    angle_range_arcmin: tuple[float, float]
    samples: int
    friction_at_turns: tuple[float, ...] = ()


def identify(loop: LoopSamples, model: str, fixed: Mapping[str, float] | None = None) -> Identified:
    """Fit a model of the table to a loop; `fixed` gives parameters that are known from elsewhere.

    Raises AnalysisError for an unknown model or parameter, a fixed value out of its range, or a fit that does not end.
    A parameter that cannot be told from another is not an error here: it is named in `refused`, and the parameters are
    not exported until it is fixed.
    """
    row = model_named(model)
    given = dict(fixed or {})
    starts = [_inside(row, start) for start in row.starts(loop, loop_shape(loop))]
    known = checked_values(model, {**starts[0], **given})
    free = [name for name in row.parameters if name not in given]
    if not free:
        raise AnalysisError(f"model {model}: every parameter is fixed; leave at least one free")
    ratio = np.array([row.parameters[name].by_ratio for name in free])
    turns = 0 if row.friction_state is None else TURNS
    least = np.append(_searched(np.array([row.parameters[name].least for name in free]), ratio), [0.0] * turns)
    most = np.append(_searched(np.array([row.parameters[name].most for name in free]), ratio), [1.0] * turns)

    def values(x: FloatArray) -> dict[str, float]:
        natural = _natural(x[: len(free)], ratio)
        return {**known, **dict(zip(free, natural.tolist(), strict=True))}

    def residual(x: FloatArray) -> FloatArray:
        return torque_on_branches(row, values(x), x[len(free) :], loop) - loop.torque_nm

    def search(begin: FloatArray, evaluations: int, **how: Any) -> Any:
        return scipy.optimize.least_squares(
            residual, begin, bounds=(least, most), x_scale="jac", max_nfev=evaluations, **how
        )

    try:
        with np.errstate(all="ignore"):
            natural = [np.array([start[name] for name in free]) for start in starts]
            begins = [np.append(_searched(begin, ratio), [FIRST_SHARE] * turns) for begin in natural]
            first = min((search(begin, FIRST_EVALUATIONS) for begin in begins), key=lambda fit: float(fit.cost))
            found = search(first.x, MOST_EVALUATIONS, ftol=ROUGH)
            for enough in ROUNDS:
                scale_nm = _scale_nm(found.fun, loop)
                found = search(found.x, MOST_EVALUATIONS, loss="cauchy", f_scale=scale_nm, ftol=enough)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise AnalysisError(f"model {model}: the fit fails on this loop: {error}; check the measured loop") from error
    if found.status <= 0:
        raise AnalysisError(
            f"model {model}: no fit after {MOST_EVALUATIONS} evaluations; check the measured loop, or fix a parameter"
        )
    at_bound = np.flatnonzero(found.active_mask[: len(free)]).tolist()
    inside = [index for index in range(len(free)) if index not in at_bound]
    beside = [len(free) + index for index in np.flatnonzero(found.active_mask[len(free) :] == 0).tolist()]
    slope = _slope(row, values(found.x), found.x[len(free) :], loop)
    jacobian = _jacobian(residual, found.x, least, most)[:, inside + beside]
    fit = RobustFit(jacobian, found.fun, scale_nm, slope * loop.angle_noise_arcmin)
    u, correlation, refused = trust(fit, _place(loop), [free[index] for index in inside])
    final = values(found.x)
    spread = {**dict.fromkeys(given, 0.0), **dict.fromkeys(free, float("nan"))}
    for index, name in zip(inside, u, strict=True):
        spread[free[index]] = float(name) * (abs(final[free[index]]) if ratio[index] else 1.0)
    return Identified(
        model=model,
        values=final,
        u={name: spread[name] for name in row.parameters},
        free=tuple(free[index] for index in inside),
        correlation=correlation,
        refused=refused,
        at_bound=tuple(free[index] for index in at_bound),
        residual_pct=100.0 * float(np.sqrt(np.mean(found.fun**2))) / loop.peak_nm,
        worst_pct=100.0 * float(np.abs(found.fun).max()) / loop.peak_nm,
        peak_nm=loop.peak_nm,
        angle_range_arcmin=loop.angle_range_arcmin,
        samples=loop.torque_nm.size,
        friction_at_turns=tuple(found.x[len(free) :].tolist()),
    )


def torque_on_branches(
    row: Model, values: Mapping[str, float], at_turns: Sequence[float] | FloatArray, loop: LoopSamples
) -> FloatArray:
    """Torque [N·m] along the branches of a loop, each from its turn; at_turns as `Identified.friction_at_turns`.

    The turn is where the branch begins, or where the one before it ended when that is further out: samples after a
    reversal may be missing.
    """
    torque = np.empty_like(loop.torque_nm)
    before = float(loop.angle_arcmin[-1])
    for branch in loop.branches:
        rising = loop.direction[branch.start] > 0.0
        state = PathState((min if rising else max)(before, float(loop.angle_arcmin[branch.start])))
        if row.friction_state is not None:
            share = float(at_turns[int(rising)]) * (-1.0 if rising else 1.0)
            state = replace(state, hysteresis=np.array([share * row.friction_state(values)]))
        torque[branch], _ = row.play(values, loop.angle_arcmin[branch], state)
        before = float(loop.angle_arcmin[branch.stop - 1])
    return torque


def _slope(row: Model, values: Mapping[str, float], at_turns: FloatArray, loop: LoopSamples) -> FloatArray:
    """Slope dT/dφ [N·m/arcmin] along the branches; the turns stay where they are."""
    step = 1e-6 * (loop.angle_range_arcmin[1] - loop.angle_range_arcmin[0])
    moved = loop.angle_arcmin + step * loop.direction
    moved[[branch.start for branch in loop.branches]] -= step * loop.direction[[one.start for one in loop.branches]]
    there = torque_on_branches(row, values, at_turns, replace(loop, angle_arcmin=moved))
    return (there - torque_on_branches(row, values, at_turns, loop)) / (step * loop.direction)


def _scale_nm(residual_nm: FloatArray, loop: LoopSamples) -> float:
    return max(CAUCHY * float(np.median(np.abs(residual_nm))), LEAST_SCALE * loop.peak_nm)


def _jacobian(
    residual: Callable[[FloatArray], FloatArray], x: FloatArray, least: FloatArray, most: FloatArray
) -> FloatArray:
    """Jacobian of the residuals by central differences, one-sided at a bound; what the search returns is weighted."""
    columns = []
    for index in range(x.size):
        low, high = x.copy(), x.copy()
        step = 1e-6 * max(1.0, abs(float(x[index])))
        low[index], high[index] = max(x[index] - step, least[index]), min(x[index] + step, most[index])
        columns.append((residual(high) - residual(low)) / (high[index] - low[index]))
    return np.array(columns).T


def _place(loop: LoopSamples) -> FloatArray:
    """Where each sample lies: the number of its branch, plus the share of the branch that is behind it."""
    return np.concatenate(
        [number + np.arange(one.stop - one.start) / (one.stop - one.start) for number, one in enumerate(loop.branches)]
    )


def _inside(row: Model, values: Mapping[str, float]) -> dict[str, float]:
    """Start values a little inside their ranges."""
    inner = {}
    for name, parameter in row.parameters.items():
        if parameter.by_ratio:
            span = (parameter.most / parameter.least) ** 1e-3
            inner[name] = float(np.clip(values[name], parameter.least * span, parameter.most / span))
        else:
            inner[name] = float(np.clip(values[name], 0.99 * parameter.least, 0.99 * parameter.most))
    return inner


def _searched(values: FloatArray, ratio: FloatArray) -> FloatArray:
    return np.where(ratio, np.log(np.where(ratio, values, 1.0)), values)


def _natural(x: FloatArray, ratio: FloatArray) -> FloatArray:
    return np.where(ratio, np.exp(np.where(ratio, x, 0.0)), x)


class Refusal(NamedTuple):
    """A parameter that the loop does not determine: the one it cannot be told from ("" for none), and why."""

    parameter: str
    other: str
    correlation: float
    reason: str


class RobustFit(NamedTuple):
    """What a fit by Cauchy's loss leaves: Jacobian (samples, parameters), residuals [N·m], their scale c [N·m].

    angle_error_nm: torque that the noise of the wind-up stands for, per sample: slope times noise.
    """

    jacobian: FloatArray
    residual_nm: FloatArray
    scale_nm: float
    angle_error_nm: FloatArray


def trust(fit: RobustFit, place: FloatArray, names: list[str]) -> tuple[FloatArray, FloatArray, tuple[Refusal, ...]]:
    """Return standard uncertainties, correlation of the estimates, and the parameters that are not determined.

    place: where each sample lies on the path, the number of its branch plus the share of it that is behind.
    names: of the first columns of the Jacobian; what comes after them is estimated beside, and not reported.
    """
    jacobian, count = fit.jacobian, len(names)
    size = np.sqrt(np.square(jacobian).sum(axis=0))
    dead = size <= NO_INFLUENCE * size.max(initial=0.0)
    refused = [Refusal(names[index], "", 0.0, "has no effect on the torque") for index in np.flatnonzero(dead[:count])]
    alive = np.flatnonzero(~dead)
    scaled = jacobian[:, alive] / size[alive]
    bread, meat = _covariances(scaled, fit, place)
    root = np.sqrt(np.maximum(np.diag(bread), 1e-300))
    u, correlation = np.full(size.size, np.nan), np.full((size.size, size.size), np.nan)
    u[alive] = np.sqrt(np.maximum(meat, 0.0)) / size[alive]
    correlation[np.ix_(alive, alive)] = np.clip(bread / np.outer(root, root), -1.0, 1.0)
    for first, left in enumerate(alive[alive < count]):
        for right in alive[alive < count][first + 1 :]:
            together = float(correlation[left, right])
            if abs(together) > MOST_CORRELATION:
                # the one that the loop moves less for the same step is the one to give up
                weak, strong = (left, right) if u[left] >= u[right] else (right, left)
                reason = f"cannot be separated from {names[strong]}: correlation {together:+.3f}"
                refused.append(Refusal(names[weak], names[strong], together, reason))
    return u[:count], correlation[:count, :count], tuple(refused)


def _covariances(scaled: FloatArray, fit: RobustFit, place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverse of the curvature of the loss, and the variances of the parameters that belong to `scaled`."""
    z = np.square(fit.residual_nm / fit.scale_nm)
    score = fit.residual_nm / (1.0 + z)
    # second derivative of the loss; where it is negative the sample says nothing
    curvature = np.maximum((1.0 - z) / np.square(1.0 + z), 0.0)
    inverse = np.linalg.pinv((scaled * curvature[:, None]).T @ scaled, hermitian=True)
    spare = max(1, score.size - scaled.shape[1])
    alone = float(np.square(score).sum()) / spare / max(float(curvature.mean()), 1e-12)
    variances, by_angle = [alone * np.diag(inverse)], [np.zeros(scaled.shape[1])]
    for parts in STRETCHES:
        starts: IntArray = np.flatnonzero(np.diff(np.floor(place * parts), prepend=-1.0))
        sums = np.add.reduceat(scaled * score[:, None], starts, axis=0) @ inverse
        variances.append(np.square(sums).sum(axis=0) * starts.size / max(1, starts.size - 1))
        # the same error all along a branch would be an offset of the wind-up
        if parts >= SHORT_STRETCHES:
            sums = np.add.reduceat(scaled * (curvature * fit.angle_error_nm)[:, None], starts, axis=0) @ inverse
            by_angle.append(np.square(sums).sum(axis=0))
    total: FloatArray = np.max(variances, axis=0) + np.max(by_angle, axis=0)
    return np.asarray(inverse, dtype=np.float64), total
