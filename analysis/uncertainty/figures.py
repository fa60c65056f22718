"""What is declared of the sensors, the fixture and the lock: the figures that an uncertainty is made of.

Every figure is a limit ± unless it says otherwise: the error is somewhere within, and no value within is likelier than
another (rectangular distribution, GUM 4.3.7). What a calibration certificate states is an expanded uncertainty with
k = 2 (normal distribution, GUM 4.3.3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from analysis.torque_ratio.quadrants import QUADRANTS
from analysis.trace.errors import AnalysisError
from analysis.uncertainty.distributions import STATED_BY

StatedBy = Literal["data_sheet", "certificate"]

TorqueChannel = Literal["torque_in_nm", "torque_out_nm"]
TORQUES: tuple[TorqueChannel, ...] = ("torque_in_nm", "torque_out_nm")

INTERPOLATION = 512
"""Counts that an encoder of high resolution interpolates within one line of its graduation."""


@dataclass(frozen=True)
class TorqueFigures:
    """Torque sensor with its amplifier; fractions of full scale unless it says otherwise.

    stated_by: who states gain and reversibility. A certificate states nothing of the zero, which the bench tares by
    itself, and nothing of the noise. gain_fraction: of the reading. zero_fraction: what is left of the zero after the
    tare (drift of the zero since, and the friction torque that stood on the sensor while it was tared).
    at_rest_fraction: torque that friction keeps on the sensor after a run, lock open and drive off.
    reversibility_fraction: half the difference between the reading under falling and under rising torque, at
    mid-range. noise_fraction: standard deviation of one sample.
    """

    full_scale_nm: float
    gain_fraction: float = 1e-3
    zero_fraction: float = 2e-4
    at_rest_fraction: float = 2e-3
    reversibility_fraction: float = 2e-4
    noise_fraction: float = 2e-4
    stated_by: StatedBy = "data_sheet"

    def __post_init__(self) -> None:
        """Refuse figures below zero or not finite, and a full scale that is not above zero."""
        _check("torque sensor", _numbers(self))
        if self.stated_by not in STATED_BY:
            raise AnalysisError(f"torque sensor: stated_by: found '{self.stated_by}'; allowed: {', '.join(STATED_BY)}")
        if not self.full_scale_nm > 0.0:
            raise AnalysisError(
                f"torque sensor: full_scale_nm: found {self.full_scale_nm}; expected a number above zero"
            )


@dataclass(frozen=True)
class AngleFigures:
    """Encoder, at its own shaft: one count, error over a turn, error within one line, noise (standard deviation)."""

    step_rad: float
    accuracy_rad: float = math.radians(10 / 3600)
    interpolation_rad: float = math.radians(0.5 / 3600)
    noise_rad: float = 0.0

    def __post_init__(self) -> None:
        """Refuse figures below zero or not finite."""
        _check("encoder", vars(self))

    @property
    def line_rad(self) -> float:
        """Period of the error within one line."""
        return min(INTERPOLATION * self.step_rad, 2.0 * math.pi)


@dataclass(frozen=True)
class LineCovariance:
    """Standard uncertainties of offset [N·m] and slope of one calibration line, and their correlation."""

    u_offset_nm: float
    u_slope: float
    correlation: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no covariance."""
        _check("calibration line", {"u_offset_nm": self.u_offset_nm, "u_slope": self.u_slope})
        if not -1.0 <= self.correlation <= 1.0:
            raise AnalysisError(f"calibration line: correlation: found {self.correlation}; expected -1 to 1")


class UnitDeviation(NamedTuple):
    """How one of the units that stored lines are the mean of differs from it.

    lines: by quadrant, offset [N·m] and slope. transition_rad: of the transition after a reversal; 0 where none is
    known.
    """

    lines: Mapping[str, tuple[float, float]]
    transition_rad: float

    @classmethod
    def between(cls, unit: Any, mean: Any) -> UnitDeviation:
        """Return how a unit differs from the mean: both have a line of each quadrant, and a transition or None."""
        lines = {}
        for name in QUADRANTS:
            own, stored = getattr(unit, name), getattr(mean, name)
            lines[name] = (own.offset_nm - stored.offset_nm, own.slope - stored.slope)
        known = unit.transition_rad is not None and mean.transition_rad is not None
        return cls(lines, unit.transition_rad - mean.transition_rad if known else 0.0)


@dataclass(frozen=True)
class SensorFigures:
    """Everything declared of one bench; None for a sensor that it does not have.

    skew_s: difference between the delays of torque and angle that no alignment removed. drift_arcmin_per_min: creep of
    the wind-up with the torque, which comes back in every cycle and which no comparison of cycles shows.
    fixture_fraction: of the stiffness by which the wind-up is corrected. lock_width_arcmin, lock_windup_fraction: how
    loop width and wind-up depend on the teeth at which the shaft is locked; one run cannot see it. calibration:
    covariance of stored calibration lines by quadrant; lines measured in the same run bring their own.
    calibrated_units: the units that stored lines are the mean of, two or more; none where it is not known.
    """

    torque_in: TorqueFigures | None = None
    torque_out: TorqueFigures | None = None
    angle_in: AngleFigures | None = None
    angle_out: AngleFigures | None = None
    skew_s: float = 0.0
    drift_arcmin_per_min: float = 0.0
    fixture_fraction: float = 0.0
    lock_width_arcmin: float = 0.0
    lock_windup_fraction: float = 0.0
    calibration: Mapping[str, LineCovariance] = field(default_factory=dict)
    calibrated_units: Sequence[UnitDeviation] = ()

    def __post_init__(self) -> None:
        """Refuse figures below zero or not finite."""
        _check("figures", _numbers(self))

    @property
    def noisy(self) -> bool:
        """Say whether any sensor is declared to have noise."""
        torques = (one.noise_fraction for one in (self.torque_in, self.torque_out) if one is not None)
        angles = (one.noise_rad for one in (self.angle_in, self.angle_out) if one is not None)
        return any(noise > 0.0 for noise in (*torques, *angles))

    @property
    def torque_noise_nm(self) -> dict[str, float]:
        """Standard deviation of the noise of both torque channels, N·m; 0 without such a sensor."""
        return {"torque_in_nm": _noise_nm(self.torque_in), "torque_out_nm": _noise_nm(self.torque_out)}

    @property
    def torque_gain(self) -> float | None:
        """Limit of the gain errors of both torque sensors together, relative; None unless both are declared."""
        if self.torque_in is None or self.torque_out is None:
            return None
        return self.torque_in.gain_fraction + self.torque_out.gain_fraction

    @property
    def torque_out_reversibility_nm(self) -> float:
        """Hysteresis of the output torque that is declared at mid-range, N·m; 0 without that sensor."""
        sensor = self.torque_out
        return 0.0 if sensor is None else sensor.reversibility_fraction * sensor.full_scale_nm

    @property
    def torque_out_zero_nm(self) -> float:
        """Limit of what the tare leaves of the zero of the output torque, N·m; 0 without that sensor."""
        return self.zero_nm("torque_out_nm") or 0.0

    def zero_nm(self, name: TorqueChannel) -> float | None:
        """Return the limit of what the tare leaves of a channel's zero, N·m; None without sensor."""
        sensor = self.torque_in if name == "torque_in_nm" else self.torque_out
        return None if sensor is None else sensor.zero_fraction * sensor.full_scale_nm

    def zero_move_nm(self, name: TorqueChannel) -> tuple[float, float] | None:
        """Return by how much a channel's zero may move in a run: by friction at rest, and at most; None without sensor.

        At most: both readings leave something of the zero (`zero_fraction`), which adds to the friction.
        """
        sensor = self.torque_in if name == "torque_in_nm" else self.torque_out
        if sensor is None:
            return None
        at_rest_nm = sensor.at_rest_fraction * sensor.full_scale_nm
        return at_rest_nm, at_rest_nm + 2.0 * sensor.zero_fraction * sensor.full_scale_nm


def _noise_nm(sensor: TorqueFigures | None) -> float:
    return 0.0 if sensor is None else sensor.noise_fraction * sensor.full_scale_nm


def _numbers(figures: object) -> dict[str, float]:
    return {name: value for name, value in vars(figures).items() if isinstance(value, int | float)}


def _check(where: str, figures: Mapping[str, float]) -> None:
    for name, value in figures.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise AnalysisError(f"{where}: {name}: found {value}; expected a finite number, zero or more")
