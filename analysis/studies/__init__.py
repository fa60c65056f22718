"""Studies beside the loop: eccentricity, frequency response, lock angle, temperature."""

from analysis.studies.eccentricity import PUBLISHED, EccentricityRow, EccentricityTrend, eccentricity_trend
from analysis.studies.frequency_response import FrequencyResponse, frequency_response
from analysis.studies.lock_angle import Correlation, LockAngleStudy, Spread, lock_angle_study
from analysis.studies.resonance import Resonance, fit_resonance
from analysis.studies.temperature import TemperatureTrend, temperature_trend

__all__ = [
    "PUBLISHED",
    "Correlation",
    "EccentricityRow",
    "EccentricityTrend",
    "FrequencyResponse",
    "LockAngleStudy",
    "Resonance",
    "Spread",
    "TemperatureTrend",
    "eccentricity_trend",
    "fit_resonance",
    "frequency_response",
    "lock_angle_study",
    "temperature_trend",
]
