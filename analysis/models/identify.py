"""Parameters of a model from a measured loop: least squares, covariance, and a word on what the loop cannot tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from analysis.errors import AnalysisError
from analysis.models.path import PathState
from analysis.models.samples import LoopSamples, loop_shape
from analysis.models.table import Model, checked_values, model_named
from analysis.units import FloatArray

MOST_CORRELATION = 0.95
"""Parameters whose estimates hang together by more than this cannot be told apart."""

FIRST_EVALUATIONS = 12
"""Steps from each start; the best one is then followed to its end."""

MOST_EVALUATIONS = 200

NO_INFLUENCE = 1e-9
"""A parameter whose column of the Jacobian is this small beside the largest one does not move the torque."""


class Refusal(NamedTuple):
    """A parameter that the loop does not determine: the one it cannot be told from ("" for none), and why."""

    parameter: str
    other: str
    correlation: float
    reason: str


@dataclass(frozen=True)
class Identified:
    """A model with its parameters, and how far they can be trusted.

    values by name; u standard uncertainty by name (0: fixed; NaN: at its bound or without influence). The covariance
    takes the residuals as independent: where the model does not fit, they are not, and u is too small. correlation:
    of the parameters in `free`. residual_pct and worst_pct: rms and largest residual as % of the peak torque.
    at_bound: parameters that ended at the limit of their range.
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
    least = _searched(np.array([row.parameters[name].least for name in free]), ratio)
    most = _searched(np.array([row.parameters[name].most for name in free]), ratio)

    def values(x: FloatArray) -> dict[str, float]:
        natural = _natural(x, ratio)
        return {**known, **dict(zip(free, natural.tolist(), strict=True))}

    def residual(x: FloatArray) -> FloatArray:
        return torque_on_closed_path(row, values(x), loop) - loop.torque_nm

    def search(begin: FloatArray, evaluations: int) -> Any:
        return optimize.least_squares(residual, begin, bounds=(least, most), x_scale="jac", max_nfev=evaluations)

    try:
        with np.errstate(all="ignore"):
            begins = [_searched(np.array([start[name] for name in free]), ratio) for start in starts]
            first = min((search(begin, FIRST_EVALUATIONS) for begin in begins), key=lambda fit: float(fit.cost))
            found = search(first.x, MOST_EVALUATIONS)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise AnalysisError(f"model {model}: the fit fails on this loop: {error}; look at the loop") from error
    if found.status <= 0:
        raise AnalysisError(
            f"model {model}: no fit after {MOST_EVALUATIONS} evaluations; look at the loop, or fix a parameter"
        )
    at_bound = np.flatnonzero(found.active_mask).tolist()
    inside = [index for index in range(len(free)) if index not in at_bound]
    u, correlation, refused = _trust(found.jac[:, inside], found.fun, [free[index] for index in inside])
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
    )


def torque_on_closed_path(row: Model, values: Mapping[str, float], loop: LoopSamples) -> FloatArray:
    """Torque [N·m] along a loop that starts in the state in which it ends."""
    _, last = row.play(values, loop.angle_arcmin, PathState())
    torque, _ = row.play(values, loop.angle_arcmin, last)
    return torque


def _trust(
    jacobian: FloatArray, residual: FloatArray, names: list[str]
) -> tuple[FloatArray, FloatArray, tuple[Refusal, ...]]:
    """Standard uncertainties of the searched parameters, their correlation, and those that are not determined."""
    size = np.sqrt(np.square(jacobian).sum(axis=0))
    dead = size <= NO_INFLUENCE * size.max(initial=0.0)
    refused = [Refusal(names[index], "", 0.0, "does not move the torque") for index in np.flatnonzero(dead)]
    alive = np.flatnonzero(~dead)
    u, correlation = np.full(len(names), np.nan), np.full((len(names), len(names)), np.nan)
    scaled = jacobian[:, alive] / size[alive]
    variance = float(np.square(residual).sum()) / max(1, residual.size - alive.size)
    covariance = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    root = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    u[alive] = np.sqrt(variance) * root / size[alive]
    correlation[np.ix_(alive, alive)] = np.clip(covariance / np.outer(root, root), -1.0, 1.0)
    for first, left in enumerate(alive):
        for right in alive[first + 1 :]:
            together = float(correlation[left, right])
            if abs(together) > MOST_CORRELATION:
                # the one that the loop moves less for the same step is the one to give up
                weak, strong = (left, right) if u[left] >= u[right] else (right, left)
                reason = f"cannot be told from {names[strong]}: correlation {together:+.3f}"
                refused.append(Refusal(names[weak], names[strong], together, reason))
    return u, correlation, tuple(refused)


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
