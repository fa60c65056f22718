"""What models are made of: elastic torque over wind-up, and hysteresis elements on one run of constant direction.

Elastic: a compliance that stiffens, with a gap, and its cubic approximation. Hysteresis, in closed form: Dahl,
Bouc–Wen, Maxwell-slip. Sources: P. Dahl, "A solid friction model" (1968); R. Bouc (1967), Y.-K. Wen (1976);
Maxwell-slip after Iwan (1966).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analysis.models.path import Element
from analysis.trace.units import FloatArray

TABLE_POINTS = 400
"""Torques at which the compliance is tabulated before Newton's steps polish its inverse."""

SETTLED = 1e-8
"""Newton's step, of the torque over which the curve bends, from which the next one is below the rounding."""

NEWTON_STEPS = 4
"""At most: from a table of 400 points two reach the rounding of a float."""

SATURATION = 28.0
"""The Bouc–Wen state is tabulated up to 1 − e⁻²⁸, where 1 − z is at the rounding of a float."""

CURVE_POINTS = 1200
"""Points of the tabulated Bouc–Wen curve on each side of zero."""


class Compliance(NamedTuple):
    """Wind-up over torque: φ = T/K_inf + b·sgn(T)(1 − exp(−|T|/T0)) + (j/2)·tanh(T/T_j); all above zero.

    stiffness_nm_per_arcmin K_inf at high torque, soft_zone_arcmin b and soft_zone_nm T0 of the contacts that stiffen,
    gap_arcmin j and gap_torque_nm T_j of the play.
    """

    stiffness_nm_per_arcmin: float
    soft_zone_arcmin: float
    soft_zone_nm: float
    gap_arcmin: float
    gap_torque_nm: float

    def angle_arcmin(self, torque_nm: FloatArray) -> FloatArray:
        """Wind-up [arcmin] at torques [N·m]."""
        angle: FloatArray = np.sign(torque_nm) * self._one_side(np.abs(torque_nm))[0]
        return angle

    def _one_side(self, torque_nm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Wind-up [arcmin] and its slope dφ/dT [arcmin/(N·m)] at torques of zero or more [N·m]."""
        soft = np.expm1(torque_nm * (-1.0 / self.soft_zone_nm))
        closed = np.tanh(torque_nm * (1.0 / self.gap_torque_nm))
        softness = 1.0 / self.stiffness_nm_per_arcmin
        half_gap = 0.5 * self.gap_arcmin
        angle = torque_nm * softness - self.soft_zone_arcmin * soft + half_gap * closed
        slope = self.soft_zone_arcmin / self.soft_zone_nm * (1.0 + soft)
        slope += half_gap / self.gap_torque_nm * (1.0 - closed * closed) + softness
        return angle, slope

    def torque_nm(self, angle_arcmin: FloatArray) -> FloatArray:
        """Torque [N·m] at wind-ups [arcmin]: the inverse, tabulated and polished by Newton's method."""
        wanted = np.abs(angle_arcmin)
        # φ ≥ T/K_inf, so the torque cannot be higher than this
        most = self.stiffness_nm_per_arcmin * float(wanted.max(initial=0.0)) * 1.01 + 1e-9
        scale = min(self.gap_torque_nm, self.soft_zone_nm, most)
        nodes = scale * np.sinh(np.linspace(0.0, math.asinh(most / scale), TABLE_POINTS))
        torque = np.interp(wanted, self.angle_arcmin(nodes), nodes)
        for _ in range(NEWTON_STEPS):
            angle, slope = self._one_side(torque)
            moved = np.maximum(torque - (angle - wanted) / slope, 0.0)
            step = float(np.abs(moved - torque).max(initial=0.0))
            torque = moved
            if step <= SETTLED * scale:
                break
        result: FloatArray = np.copysign(torque, angle_arcmin)
        return result


def cubic_torque_nm(linear: float, cubic: float, angle_arcmin: FloatArray) -> FloatArray:
    """Torque [N·m] T = a₁ θ + a₃ θ³ with a₁ in N·m/arcmin and a₃ in N·m/arcmin³ ("stiffness characterization" 5)."""
    torque: FloatArray = linear * angle_arcmin + cubic * angle_arcmin**3
    return torque


def dahl(friction_nm: float, presliding_nm_per_arcmin: float) -> Element:
    """Dahl friction with F' = σ (1 − F s / F_c) φ': F = s F_c + (F₀ − s F_c) exp(−σ |Δφ| / F_c), torque in N·m."""

    def element(start: FloatArray, turned: FloatArray) -> FloatArray:
        level = np.sign(turned) * friction_nm
        kept = np.exp(-presliding_nm_per_arcmin * np.abs(turned) / friction_nm)
        torque: FloatArray = (level + (start[0] - level) * kept)[:, None]
        # a sample that has not moved keeps its torque exactly: sign(0) gives no level
        torque[turned == 0.0, 0] = start[0]
        return torque

    return element


def bouc_wen(yield_arcmin: float, exponent: float, shape: float) -> Element:
    """Bouc–Wen state z within ±1: z' = φ'/δ · (1 − |z|ⁿ (β sgn(φ' z) + 1 − β)), with δ the yield angle and β the shape.

    On a run of one direction this is separable: φ/δ = G(z) = ∫ du / h(u) with h = 1 − uⁿ above zero and
    h = 1 + (2β − 1)|u|ⁿ below (rising; falling is its mirror image). G is tabulated, so that a step may be long.
    n = 1 and β = 1 is Dahl's model. shape within 0.5…1 (dissipates in every cycle), exponent above 0.
    """
    w = np.linspace(0.0, SATURATION, CURVE_POINTS)
    above = -np.expm1(-w)
    # dz = (1 − z) dw: the integrand stays finite where z approaches 1
    slope = np.ones_like(w)
    slope[1:] = np.exp(-w[1:]) / -np.expm1(exponent * np.log1p(-np.exp(-w[1:])))
    rise = _cumulative(slope, w)
    below = np.linspace(0.0, 1.0, CURVE_POINTS)
    fall = _cumulative(1.0 / (1.0 + (2.0 * shape - 1.0) * below**exponent), below)
    z = np.concatenate([-below[:0:-1], above])
    turned_to = np.concatenate([-fall[:0:-1], rise])

    def element(start: FloatArray, turned: FloatArray) -> FloatArray:
        direction = -1.0 if turned[-1] < 0 else 1.0
        begin = np.interp(direction * float(start[0]), z, turned_to)
        state: FloatArray = direction * np.interp(begin + np.abs(turned) / yield_arcmin, turned_to, z)[:, None]
        state[turned == 0.0, 0] = start[0]
        return state

    return element


def maxwell_slip(yields_arcmin: FloatArray) -> Element:
    """Deflections [arcmin] of springs that slip at their yield angles: s = clip(s₀ + Δφ, −δ, +δ), one per element."""

    def element(start: FloatArray, turned: FloatArray) -> FloatArray:
        return np.clip(start[None, :] + turned[:, None], -yields_arcmin, yields_arcmin)

    return element


def _cumulative(slope: FloatArray, x: FloatArray) -> FloatArray:
    """Integral from the first x by the trapezoidal rule."""
    pieces = 0.5 * (slope[1:] + slope[:-1]) * np.diff(x)
    return np.concatenate([[0.0], np.cumsum(pieces)])
