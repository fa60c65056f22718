"""Figures of documents and data sheets in the units of this package.

The background documents give stiffness in N·m/rad, angles at the input shaft, and encoders by their lines.
"""

from __future__ import annotations

import math

from analysis.trace.errors import AnalysisError
from definitions.units import RAD_PER_ARCMIN

ARCMIN_PER_TURN = 360.0 * 60.0


def nm_per_arcmin(stiffness_nm_per_rad: float) -> float:
    """Stiffness in N·m/arcmin from N·m/rad."""
    return stiffness_nm_per_rad * RAD_PER_ARCMIN


def nm_per_rad(stiffness_nm_per_arcmin: float) -> float:
    """Stiffness in N·m/rad from N·m/arcmin."""
    return stiffness_nm_per_arcmin / RAD_PER_ARCMIN


def series_stiffness(*stiffnesses: float) -> float:
    """Stiffness of springs behind one another, all referred to one shaft and in one unit: 1/K = Σ 1/K_n."""
    compliance = sum(1.0 / _stiffness(one) for one in stiffnesses)
    return 1.0 / compliance if compliance else math.inf


def fixture_stiffness(output_side: float, input_side: float, ratio: float) -> float:
    """Stiffness of a fixture at the output, 1/K = 1/K_1 + 1/(K_i i²), all in one unit.

    output_side: K_1, of shaft and connections at the output; input_side: K_i, of shaft, coupling and lock at the input,
    as it is there. Source: "inverse loading test system" and "stiffness characterization", 2.
    """
    return series_stiffness(output_side, stiffness_at_output(input_side, ratio))


def compensated_stiffness(measured: float, output_side: float, input_side: float, ratio: float) -> float:
    """Stiffness of the unit alone, 1/K = 1/K_r − 1/K_1 − 1/(K_i i²), all in one unit.

    measured: K_r, of unit and fixture together; the others as in `fixture_stiffness`, infinite for a side that does not
    give way. AnalysisError when the fixture alone is as soft as what was measured. It holds for a stiffness alone, as
    one of a data sheet: for lost motion the angle trace is corrected (`fixture.parts` of a bench file).
    """
    fixture = fixture_stiffness(output_side, input_side, ratio)
    left = 1.0 / _above_zero(measured, "measured stiffness") - 1.0 / fixture
    if left <= 0.0:
        raise AnalysisError(
            f"measured stiffness: found {measured:g}, and the fixture alone has {fixture:g}; expected less than that: "
            "check the fixture's stiffness"
        )
    return 1.0 / left


def angle_at_output(angle_at_input: float, ratio: float) -> float:
    """Angle at the output for one at the input, in the same unit; AnalysisError unless the ratio is above zero."""
    return angle_at_input / _above_zero(ratio, "ratio")


def stiffness_at_output(stiffness_at_input: float, ratio: float) -> float:
    """Stiffness seen at the output of a spring at the input: i² times, in the same unit."""
    return _stiffness(stiffness_at_input) * _above_zero(ratio, "ratio") ** 2


def encoder_step_arcmin(lines: float, interpolation: float = 1.0) -> float:
    """Angle of one count [arcmin] of an encoder with so many lines per turn, each divided by the interpolation.

    ×4 is what a quadrature counter gives. Raises AnalysisError for lines or interpolation that are not above zero.
    """
    return ARCMIN_PER_TURN / (_above_zero(lines, "lines") * _above_zero(interpolation, "interpolation"))


def _stiffness(value: float) -> float:
    """Return a stiffness; infinite is one that does not give way."""
    return value if value == math.inf else _above_zero(value, "stiffness")


def _above_zero(value: float, what: str) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise AnalysisError(f"{what}: found {value}; expected a number above zero")
    return value
