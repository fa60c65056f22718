"""Presets: which definitions belong together, by the published benches and by the makers' catalogues.

A preset names metrics and what is chosen for each. It has no limits: those are the recipe's. Percentages refer to the
recipe's reference torque; what that is at the source stands in `reference`.
"""

from __future__ import annotations

from typing import NamedTuple


class PresetMetric(NamedTuple):
    """One metric of a preset; None leaves the choice to the definition."""

    id: str
    branch: str | None = None
    band: float | None = None
    """Fraction of the reference torque."""
    variant: str | None = None
    fit: str | None = None


class Preset(NamedTuple):
    """Row of `PRESETS`."""

    text: str
    reference: str
    """What percentages refer to at the source."""
    breaks: str
    """Break torques of its fits."""
    metrics: tuple[PresetMetric, ...]


RATED = "rated torque"
NO_FIT = "no fit: values are read from the measured branches"

PRESETS: dict[str, Preset] = {
    "static": Preset(
        "static testing system: stiffness, backlash between the paths at ±3 %, clearance at zero torque, and what it "
        "calls transmission accuracy",
        f"{RATED}; loaded to twice that",
        "none but for the wind-up: ±90 N·m of 412 N·m",
        (
            PresetMetric("stiffness_lsq"),
            PresetMetric("backlash_branches_3pct"),
            PresetMetric("gear_clearance"),
            PresetMetric("asymmetry_at_rated"),
            PresetMetric("windup"),
        ),
    ),
    "inverse": Preset(
        "inverse loading test system: loop width at ±3 %, stiffness curve in three regions, spring constant over "
        "10 N·m",
        RATED,
        "20 % and 80 % (three regions); 20 % (six segments)",
        (
            PresetMetric("backlash_width_3pct"),
            PresetMetric("spring_constant", fit="six_segment_20pct"),
            PresetMetric("spring_constant", fit="three_region"),
            PresetMetric("stiffness_at", fit="six_segment_20pct"),
            PresetMetric("stiffness_at", fit="three_region"),
            PresetMetric("windup", fit="three_region"),
        ),
    ),
    "measurement": Preset(
        "backlash and stiffness measurement system: loop width at ±3 %, spring constant of the six-segment fit",
        RATED,
        "as the recipe gives them, else ±90 N·m of 412 N·m",
        (
            PresetMetric("backlash_width_3pct"),
            PresetMetric("spring_constant"),
            PresetMetric("windup"),
        ),
    ),
    "output": Preset(
        "stiffness characterization: four stiffness methods side by side, backlash at zero torque and its grade, "
        "hysteresis",
        "largest torque of the cycle, 300 N·m of 412 N·m rated",
        NO_FIT,
        (
            PresetMetric("backlash_width_zero"),
            PresetMetric("grade"),
            PresetMetric("hysteresis_angle"),
            PresetMetric("hysteresis_energy"),
            PresetMetric("stiffness_estimate"),
            PresetMetric("stiffness_end_point"),
            PresetMetric("stiffness_two_point"),
            PresetMetric("stiffness_lsq"),
        ),
    ),
    "nabtesco": Preset(
        "Nabtesco: backlash at zero torque, lost motion on the centreline at ±3 %, stiffness from 50 to 100 %",
        RATED,
        NO_FIT,
        (
            PresetMetric("backlash_width_zero"),
            PresetMetric("lost_motion", band=0.03),
            PresetMetric("stiffness_50_100", branch="load"),
        ),
    ),
    "spinea": Preset(
        "SPINEA: lost motion on the centreline at ±3 %; hysteresis at zero torque and stiffness from 50 to 100 % of "
        "the centreline by general practice",
        RATED,
        NO_FIT,
        (
            PresetMetric("lost_motion", band=0.03),
            PresetMetric("backlash_width_zero"),
            PresetMetric("stiffness_50_100", branch="mean"),
        ),
    ),
    "harmonic": Preset(
        "Harmonic Drive: stiffness in three segments, lost motion on the centreline at ±4 %, hysteresis at zero torque",
        RATED,
        "T1 and T2 as the recipe gives them, else 20 % and 70 %",
        (
            PresetMetric("k1"),
            PresetMetric("k2"),
            PresetMetric("k3"),
            PresetMetric("lost_motion", band=0.04),
            PresetMetric("backlash_width_zero"),
        ),
    ),
}
"""All presets by name."""
