"""What a bench file declares of sensors, fixture and lock, as the analysis takes it for its uncertainty budget."""

from __future__ import annotations

import math

from analysis.loop.fixture_curve import fixture_stiffness, stiffness_at_output
from analysis.torque_ratio.quadrants import QUADRANTS
from analysis.uncertainty.figures import AngleFigures, LineCovariance, SensorFigures, TorqueFigures, UnitDeviation
from definitions.units import ARCMIN_PER_RAD
from recipes import Bench, Calibration
from recipes.schema.calibration_schema import QuadrantLine
from recipes.schema.sensor_schema import AngleSensor, TorqueSensor

U_SLOPE_FRACTION = 0.005
U_OFFSET_NM = 0.5
"""Standard uncertainty of a stored calibration line of which none is declared."""


def figures_of(bench: Bench, stored: Calibration | None = None, period_s: float = 0.0) -> SensorFigures:
    """Return the declared figures of a bench; stored: the calibration that converts the torque, when one does.

    period_s: of the scan in which the channels were asked for; 0 where nobody knows.
    """
    sensors, fixture = bench.sensors, bench.fixture
    return SensorFigures(
        torque_in=_torque(sensors.torque_in),
        torque_out=_torque(sensors.torque_out),
        angle_in=_angle(sensors.angle_in),
        angle_out=_angle(sensors.angle_out),
        skew_s=bench.skew(period_s),
        drift_arcmin_per_min=fixture.drift_arcmin_min,
        fixture_fraction=fixture.accuracy_fraction,
        lock_width_arcmin=fixture.lock_width_rad * ARCMIN_PER_RAD,
        lock_windup_fraction=fixture.lock_windup_fraction,
        calibration={} if stored is None else {name: _line(getattr(stored, name)) for name in QUADRANTS},
        calibrated_units=() if stored is None else [UnitDeviation.between(unit, stored) for unit in stored.units or ()],
    )


def _torque(sensor: TorqueSensor | None) -> TorqueFigures | None:
    if sensor is None:
        return None
    return TorqueFigures(
        full_scale_nm=sensor.full_scale_nm,
        gain_fraction=sensor.accuracy_fraction,
        zero_fraction=sensor.tared_zero_fraction,
        at_rest_fraction=sensor.at_rest_fraction,
        reversibility_fraction=sensor.reversibility_fraction,
        noise_fraction=sensor.noise_fraction,
        stated_by=sensor.stated_by,
    )


def _angle(sensor: AngleSensor | None) -> AngleFigures | None:
    if sensor is None:
        return None
    step_rad = 2.0 * math.pi / 2.0**sensor.resolution_bits
    return AngleFigures(step_rad, sensor.accuracy_rad, sensor.interpolation_rad, sensor.noise_rad)


def _line(line: QuadrantLine) -> LineCovariance:
    return LineCovariance(
        U_OFFSET_NM if line.u_offset_nm is None else abs(line.u_offset_nm),
        U_SLOPE_FRACTION * line.slope if line.u_slope is None else line.u_slope,
        line.correlation or 0.0,
    )


def fixture_of(bench: Bench, ratio: float) -> tuple[float | None, float | None]:
    """Return the stiffness of all of a bench's fixture and of its locked side, at the output [N·m/arcmin].

    The second is None where a fixture is not stated by its parts. ratio: of the unit, by which the input's part counts.
    """
    parts = bench.fixture.parts
    if parts is None:
        return bench.fixture.stiffness_nm_per_arcmin, None
    output, at_input = parts.output_nm_per_arcmin, parts.input_nm_per_arcmin
    lock = output if bench.bench.loading == "input" else stiffness_at_output(at_input, ratio)
    return fixture_stiffness(output, at_input, ratio), lock
