"""Earlier wordings of what a metric means: results that were stored with one mean the same as those of today.

A result keeps the definition that it was made by, word by word, and values are compared only where these are alike. Who
words a definition better, and changes nothing of what is computed, puts the words of before here.
"""

from __future__ import annotations

from definitions.metrics import METRICS

FORMER_DEFINITIONS: dict[str, tuple[str, ...]] = {
    "backlash_width_3pct": (
        "loop width at ±3 % of the reference torque: |f(T) − r(T)|, each side for itself",
        "loop width at ±3 % of the reference torque: |f(T) − r(T)|, separately for each side",
    ),
    "backlash_width_zero": ("loop width at zero torque: |f(0) − r(0)|",),
    "backlash_branches_3pct": (
        (
            "return branch at +3 % minus forward branch at −3 % of the reference torque: r(+b·T) − f(−b·T); lost "
            "motion and loop width together"
        ),
    ),
    "gear_clearance": (
        (
            "unloading branches at zero torque: half the distance of r(0) and f(0), and each side from their mean"
            " (so both sides read half the width), or from the zero of the angle by variant intercept"
        ),
        (
            "unloading branches at zero torque: half the distance between r(0) and f(0). Each side is measured "
            "from their mean, so both sides show half the width; variant intercept measures from the zero of the "
            "angle"
        ),
        (
            "half the distance between the unloading branches at zero torque, r(0) and f(0); both sides show the "
            "same value. Variant intercept: distance of each branch from the zero of the angle"
        ),
    ),
    "lost_motion": (
        "centreline of the loop between plus and minus the band (3 % unless chosen): m(+b·T) − m(−b·T)",
        "centreline of the loop between plus and minus the band (3 % by default): m(+b·T) − m(−b·T)",
    ),
    "stiffness_lsq": (
        (
            "least squares of wind-up over 200 equally spaced torques of the loading branch, 20–80 % of the "
            "reference torque"
        ),
    ),
    "stiffness_two_point": ("chord of the loading branch between 20 % and 80 % of the reference torque",),
    "stiffness_end_point": (
        (
            "reference torque over loading branch at that torque minus unloading branch at zero (the unloading "
            "chord: it reads high)"
        ),
        (
            "reference torque divided by a wind-up: loading branch at that torque minus unloading branch at zero "
            "torque; higher than the chord of loading"
        ),
    ),
    "stiffness_estimate": (
        "chord of the whole loading branch, from zero to the reference torque; the slope as read by eye",
    ),
    "stiffness_50_100": ("secant between 50 % and 100 % of the reference torque on the chosen branch, as measured",),
    "stiffness_at": (
        (
            "1 / F′(T) of the fitted mean curve, or of a branch's own, at the chosen torque (50 % of the "
            "reference torque unless chosen)"
        ),
        (
            "1 / F′(T) of the fitted mean curve, or of a branch's own, at the chosen torque (50 % of the "
            "reference torque by default)"
        ),
    ),
    "spring_constant": (
        (
            "ΔT / ΔF over 10 N·m of the fitted mean curve, or of a branch's own, ending at the reference torque "
            "(centred on it or starting from it by variant)"
        ),
    ),
    "hysteresis_angle": (
        "loop width within one side at the chosen torque (50 % of the reference torque unless chosen): |f(T) − r(T)|",
        "loop width within one side at the chosen torque (50 % of the reference torque by default): |f(T) − r(T)|",
    ),
    "windup": ("F(+T) − F(−T) of the fitted mean curve at the reference torque",),
    "asymmetry_at_rated": (
        (
            "half the difference in wind-up of the two sides at the reference torque: |m(+T) + m(−T) − 2 m(0)| / "
            "2, as measured; not the transmission error, which needs rotation"
        ),
    ),
    "torque_ratio_slope": ("slope m of T_out = C + m·T_in, loading, each side for itself",),
    "torque_ratio_offset": (
        "offset C of T_out = C + m·T_in, loading, negative side mirrored: friction of the input side as output torque",
    ),
}
"""By metric, as `METRICS` has it; the oldest first."""

FORMER_ESTIMATORS: dict[str, str] = {"table of grades": "table of precision grades"}
"""Earlier names of estimators, with those of today."""

_NOW = {text: METRICS[metric].text for metric, texts in FORMER_DEFINITIONS.items() for text in texts}
_NOW |= FORMER_ESTIMATORS


def wording_of_today(text: str) -> str:
    """Return a definition or an estimator in the words of today; as it is where none of before are known."""
    return _NOW.get(text, text)


def wordings(text: str) -> tuple[str, ...]:
    """Return all texts that say what this one says, that of today first."""
    now = wording_of_today(text)
    return (now, *(old for old, new in _NOW.items() if new == now))
