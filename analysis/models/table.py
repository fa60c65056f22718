"""The table of models: what each parameter means, its unit, where it may lie, and the torque that follows."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from analysis.models.elements import Compliance, bouc_wen, cubic_torque_nm, dahl
from analysis.models.path import PathState, checked_angles, follow
from analysis.models.samples import LoopSamples, LoopShape
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

Values = Mapping[str, float]
Play = Callable[[Values, FloatArray, PathState], tuple[FloatArray, PathState]]


class Parameter(NamedTuple):
    """One parameter: unit, meaning, where it may lie, and whether the search goes by ratio (above zero)."""

    unit: str
    text: str
    least: float
    most: float
    by_ratio: bool = True


class Model(NamedTuple):
    """One model: equations, what it can do, parameters, torque of an angle sequence, start values."""

    equations: str
    text: str
    parameters: Mapping[str, Parameter]
    play: Play
    starts: Callable[[LoopSamples, LoopShape], tuple[Values, ...]]
    """Start values; several where a search can end in a side valley."""

    friction_state: Callable[[Values], float] | None = None
    """Hysteresis state of a unit that was run one way until nothing changes; None: the model has no memory."""


STIFFNESS, ANGLE, TORQUE = "N·m/arcmin", "arcmin", "N·m"

_OFFSET = Parameter(ANGLE, "wind-up at which the elastic torque is zero", -1e5, 1e5, by_ratio=False)


def _play_cubic(values: Values, angle_arcmin: FloatArray, state: PathState) -> tuple[FloatArray, PathState]:
    angle = checked_angles(angle_arcmin)
    torque = cubic_torque_nm(
        values["linear_nm_per_arcmin"], values["cubic_nm_per_arcmin3"], angle - values["angle_offset_arcmin"]
    )
    return torque, PathState(float(angle[-1]) if angle.size else state.angle_arcmin)


def _starts_cubic(loop: LoopSamples, shape: LoopShape) -> tuple[Values, ...]:
    reach = max(abs(angle - shape.offset_arcmin) for angle in loop.angle_range_arcmin)
    chord = loop.peak_nm / reach
    return (
        {
            "linear_nm_per_arcmin": 0.7 * chord,
            "cubic_nm_per_arcmin3": 0.3 * chord / reach**2,
            "angle_offset_arcmin": shape.offset_arcmin,
        },
    )


def _play_gap_dahl(values: Values, angle_arcmin: FloatArray, state: PathState) -> tuple[FloatArray, PathState]:
    element = dahl(values["friction_nm"], values["presliding_nm_per_arcmin"])
    hysteresis, last = follow(angle_arcmin, state, values["angle_offset_arcmin"], 1, element)
    elastic = Compliance(
        values["stiffness_nm_per_arcmin"],
        values["soft_zone_arcmin"],
        values["soft_zone_nm"],
        values["gap_arcmin"],
        values["gap_torque_nm"],
    )
    return elastic.torque_nm(angle_arcmin - values["angle_offset_arcmin"]) + hysteresis[:, 0], last


def _starts_gap_dahl(loop: LoopSamples, shape: LoopShape) -> tuple[Values, ...]:
    common = {
        "stiffness_nm_per_arcmin": shape.stiffness_nm_per_arcmin,
        "soft_zone_arcmin": 0.8 * shape.soft_zone_arcmin,
        "soft_zone_nm": 0.2 * loop.peak_nm,
        "friction_nm": shape.half_height_nm,
        "presliding_nm_per_arcmin": 15.0 * shape.stiffness_nm_per_arcmin,
        "angle_offset_arcmin": shape.offset_arcmin,
    }
    return tuple(
        {**common, "gap_arcmin": share * shape.soft_zone_arcmin, "gap_torque_nm": sharpness * loop.peak_nm}
        for share in (0.3, 0.9)
        for sharpness in (0.003, 0.01, 0.03)
    )


def _play_bouc_wen(values: Values, angle_arcmin: FloatArray, state: PathState) -> tuple[FloatArray, PathState]:
    element = bouc_wen(values["yield_arcmin"], values["exponent"], values["shape"])
    hysteresis, last = follow(angle_arcmin, state, values["angle_offset_arcmin"], 1, element)
    elastic, _ = _play_cubic(values, angle_arcmin, state)
    return elastic + values["friction_nm"] * hysteresis[:, 0], last


def _starts_bouc_wen(loop: LoopSamples, shape: LoopShape) -> tuple[Values, ...]:
    common = {"friction_nm": shape.half_height_nm, "exponent": 1.2, "shape": 0.8}
    return tuple(
        {**elastic, **common, "yield_arcmin": shape.half_height_nm / (times * shape.stiffness_nm_per_arcmin)}
        for elastic in _starts_cubic(loop, shape)
        for times in (3.0, 15.0)
    )


_CUBIC = {
    "linear_nm_per_arcmin": Parameter(STIFFNESS, "stiffness a₁ at zero wind-up", -1e9, 1e9, by_ratio=False),
    "cubic_nm_per_arcmin3": Parameter("N·m/arcmin³", "stiffening a₃", -1e9, 1e9, by_ratio=False),
    "angle_offset_arcmin": _OFFSET,
}

MODELS: dict[str, Model] = {
    "cubic": Model(
        "T = a₁ θ + a₃ θ³, θ = φ − φ₀",
        "A function of the angle: it cannot make a loop. Half the height of the loop stays in its residual.",
        _CUBIC,
        _play_cubic,
        _starts_cubic,
    ),
    "gap_dahl": Model(
        "T = g(φ − φ₀) + F; g inverts φ = T/K_inf + b·sgn(T)(1 − exp(−|T|/T0)) + (j/2)·tanh(T/T_j); "
        "F' = σ (1 − F s/F_c) φ', s = sgn(φ')",
        "Compliance that stiffens, a gap, and Dahl friction.",
        {
            "stiffness_nm_per_arcmin": Parameter(STIFFNESS, "stiffness K_inf at high torque", 1e-6, 1e9),
            "soft_zone_arcmin": Parameter(ANGLE, "wind-up b of the contacts that stiffen", 1e-6, 1e5),
            "soft_zone_nm": Parameter(TORQUE, "torque T0 over which they stiffen", 1e-3, 1e7),
            "gap_arcmin": Parameter(ANGLE, "gap j", 1e-6, 1e5),
            "gap_torque_nm": Parameter(TORQUE, "torque T_j that closes the gap", 1e-4, 1e6),
            "friction_nm": Parameter(TORQUE, "friction F_c: half the height of the loop", 1e-6, 1e7),
            "presliding_nm_per_arcmin": Parameter(STIFFNESS, "stiffness σ of the friction after a reversal", 1e-4, 1e8),
            "angle_offset_arcmin": _OFFSET,
        },
        _play_gap_dahl,
        _starts_gap_dahl,
        lambda values: values["friction_nm"],
    ),
    "bouc_wen": Model(
        "T = a₁ θ + a₃ θ³ + F z, θ = φ − φ₀; z' = φ'/δ · (1 − |z|ⁿ (β sgn(φ' z) + 1 − β))",
        "Cubic elasticity with a Bouc–Wen loop; exponent 1 and shape 1 is Dahl's loop.",
        {
            **_CUBIC,
            "friction_nm": Parameter(TORQUE, "friction F: half the height of the loop", 1e-6, 1e7),
            "yield_arcmin": Parameter(ANGLE, "wind-up δ over which the friction turns round", 1e-6, 1e4),
            "exponent": Parameter("1", "exponent n: sharpness of the knee", 0.3, 10.0),
            "shape": Parameter("1", "shape β: share of the friction that opposes motion", 0.5, 1.0),
        },
        _play_bouc_wen,
        _starts_bouc_wen,
        lambda _: 1.0,
    ),
}  # fmt: skip
"""Models that are identified by least squares; "maxwell_slip" has its own method."""


def model_named(name: str) -> Model:
    """Return the row of a model; AnalysisError naming the known ones."""
    row = MODELS.get(name)
    if row is None:
        near = difflib.get_close_matches(name, MODELS, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise AnalysisError(f"model '{name}' is not known{hint} Known are {', '.join(MODELS)}, maxwell_slip")
    return row


def checked_values(name: str, values: Values) -> dict[str, float]:
    """Return all parameters of a model in order; AnalysisError for one that is missing, unknown or out of its range."""
    row = model_named(name).parameters
    unknown = [key for key in values if key not in row]
    missing = [key for key in row if key not in values]
    if unknown or missing:
        raise AnalysisError(
            f"model {name}: unknown parameters: {', '.join(unknown) or 'none'}; "
            f"missing: {', '.join(missing) or 'none'}; expected {', '.join(row)}"
        )
    for key, parameter in row.items():
        if not (math.isfinite(values[key]) and parameter.least <= values[key] <= parameter.most):
            raise AnalysisError(
                f"model {name}: {key}: found {values[key]}; allowed: {parameter.least:g}…{parameter.most:g} "
                f"{parameter.unit}"
            )
    return {key: float(values[key]) for key in row}
