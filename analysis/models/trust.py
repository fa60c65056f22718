"""How far identified parameters can be trusted: uncertainties that hold where a model does not fit, and correlations.

Residuals of a model that does not quite fit are not noise: neighbours err alike. The covariance is the larger one, for
each parameter, of two: residuals as independent, and residuals summed over stretches of the path (P. J. Huber, "The
behavior of maximum likelihood estimates under nonstandard conditions", 1967; stretches as clusters after K.-Y. Liang
and S. L. Zeger, 1986). To that comes what is left of the noise of the wind-up: next to a turn the loop is so steep that
an encoder's step is many N·m. None of it knows of errors that every stretch shares, as of a sensor's gain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from analysis.trace.units import FloatArray, IntArray

MOST_CORRELATION = 0.95
"""Parameters whose estimates hang together by more than this cannot be told apart."""

NO_INFLUENCE = 1e-9
"""A parameter whose column of the Jacobian is this small beside the largest one does not move the torque."""

STRETCHES = (160, 40, 10, 3, 1)
"""Lengths of path over which residuals are summed, as parts of a branch: the one that says most counts."""

SHORT_STRETCHES = 10
"""Stretches of this many parts of a branch or more: how far an error of the wind-up may reach."""


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
    refused = [Refusal(names[index], "", 0.0, "does not move the torque") for index in np.flatnonzero(dead[:count])]
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
                reason = f"cannot be told from {names[strong]}: correlation {together:+.3f}"
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
