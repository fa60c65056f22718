"""The table of metrics: what each word means. A row is a definition; the same loop gives other numbers by another row.

Results print the definition beside the number.
"""

from __future__ import annotations

import difflib
import math
from functools import partial

from analysis import estimators
from analysis.curves import FITS
from analysis.errors import AnalysisError
from analysis.grades import GRADED
from analysis.method import MetricWanted
from analysis.metric_definition import BRANCHES, SIDED, Definition, defined

_TIGHT, _PLAY = "the unit has less play than allowed: it may be tight", "the unit has more play than allowed"

_FITS = tuple(FITS)
_CURVE = ("mean", "load", "unload")


STIFFNESS = "N·m/arcmin"


def _segment(number: int, torques: str) -> Definition:
    return defined(
        STIFFNESS,
        f"stiffness {torques}, of three straight lines that meet at the break torques T1 and T2 (20 % and 70 % of the "
        "reference torque unless given), on the chosen branch",
        "Harmonic Drive",
        partial(estimators.stiffness_segment, segment=number - 1), sides=SIDED, branch="load", branches=BRANCHES,
        estimator="three-segment fit", variants=("fitted", "chord"), segmented=True,
    )  # fmt: skip


METRICS: dict[str, Definition] = {
    "backlash_width_3pct": defined(
        "arcmin",
        "loop width at ±3 % of the reference torque: |f(T) − r(T)|, each side for itself",
        "inverse loading; backlash and stiffness measurement",
        estimators.backlash_width, sides=SIDED, branch="width", band=0.03, words=(_TIGHT, _PLAY), magnitude=True,
    ),
    "backlash_width_zero": defined(
        "arcmin",
        "loop width at zero torque: |f(0) − r(0)|",
        "stiffness characterization; Nabtesco backlash; gear clearance of the standard",
        estimators.backlash_width, branch="width", band=0.0, words=(_TIGHT, _PLAY), magnitude=True,
    ),
    "backlash_branches_3pct": defined(
        "arcmin",
        "return branch at +3 % minus forward branch at −3 % of the reference torque: r(+b·T) − f(−b·T); lost motion "
        "and loop width together",
        "static testing",
        estimators.backlash_branches, branch="width", band=0.03, words=(_TIGHT, _PLAY),
    ),
    "gear_clearance": defined(
        "arcmin",
        "unloading branches at zero torque: half the distance of r(0) and f(0), and each side from their mean (so both "
        "sides read half the width), or from the zero of the angle by variant intercept",
        "static testing",
        estimators.gear_clearance, sides=("both", *SIDED), branch="unload", variants=("centred", "intercept"),
        words=(_TIGHT, _PLAY),
    ),
    "grade": defined(
        "1",
        "precision grade of the mean backlash: 1 up to 1 arcmin, 2 above (not grade 1); the backlash is the loop width "
        "at zero torque unless another is chosen",
        "stiffness characterization",
        estimators.graded_backlash, branch="width", estimator="table of grades", band=0.03,
        variants=tuple(GRADED),
        words=("the unit has a better grade than asked for", _PLAY), graded=True,
    ),
    "lost_motion": defined(
        "arcmin",
        "centreline of the loop between plus and minus the band (3 % unless chosen): m(+b·T) − m(−b·T)",
        "Nabtesco, SPINEA",
        estimators.lost_motion, band=0.03, free=("band",), words=(_TIGHT, _PLAY),
    ),
    "stiffness_lsq": defined(
        STIFFNESS,
        "least squares of wind-up over torque, loading branch, 20–80 % of the reference torque",
        "static testing; stiffness characterization 4.4",
        estimators.stiffness_lsq, sides=SIDED, branch="load", estimator="least squares",
    ),
    "stiffness_two_point": defined(
        STIFFNESS,
        "chord of the loading branch between 20 % and 80 % of the reference torque",
        "stiffness characterization 4.3",
        estimators.stiffness_chord, sides=SIDED, branch="load", estimator="chord", variants=("two_point",),
    ),
    "stiffness_end_point": defined(
        STIFFNESS,
        "reference torque over loading branch at that torque minus unloading branch at zero (the unloading chord: it "
        "reads high)",
        "stiffness characterization 4.2",
        estimators.stiffness_end_point, sides=SIDED, branch="load", estimator="chord",
    ),
    "stiffness_estimate": defined(
        STIFFNESS,
        "chord of the whole loading branch, zero to the reference torque: what reading the slope by eye aims at",
        "stiffness characterization 4.1",
        estimators.stiffness_estimate, sides=SIDED, branch="load", estimator="chord",
    ),
    "stiffness_50_100": defined(
        STIFFNESS,
        "secant between 50 % and 100 % of the reference torque on the chosen branch",
        "Nabtesco, general practice",
        estimators.stiffness_chord, sides=SIDED, branch="load", branches=BRANCHES, estimator="secant",
        variants=("secant",),
    ),
    "stiffness_at": defined(
        STIFFNESS,
        "1 / F′(T) of the fitted mean curve, or of a branch's own, at the chosen torque (50 % of the reference torque "
        "unless chosen)",
        "inverse loading",
        estimators.stiffness_at, sides=SIDED, branches=_CURVE, estimator="slope", torque=0.5, free=("torque_nm",),
        fits=_FITS,
    ),
    "spring_constant": defined(
        STIFFNESS,
        "ΔT / ΔF over 10 N·m of the fitted mean curve, or of a branch's own, ending at the reference torque (centred "
        "on it or starting from it by variant)",
        "inverse loading; backlash and stiffness measurement",
        estimators.spring_constant, sides=SIDED, branches=_CURVE, estimator="chord",
        variants=("ending", "centred", "from", "direct"), fits=_FITS,
    ),
    "k1": _segment(1, "from zero to T1"),
    "k2": _segment(2, "from T1 to T2"),
    "k3": _segment(3, "from T2 to the reference torque"),
    "hysteresis_energy": defined(
        "N·m·arcmin",
        "area of the loop between its turning points: energy lost per cycle",
        "stiffness characterization",
        estimators.hysteresis_energy, branch="width", estimator="trapezoid",
        words=("less energy is lost than expected", "more energy is lost in friction than allowed"),
    ),
    "hysteresis_angle": defined(
        "arcsec",
        "loop width within one side at the chosen torque (50 % of the reference torque unless chosen): |f(T) − r(T)|",
        "stiffness characterization",
        estimators.hysteresis_angle, sides=SIDED, branch="width", torque=0.5, free=("torque_nm",),
        words=("less hysteresis than expected", "more hysteresis than allowed: friction"), magnitude=True,
    ),
    "windup": defined(
        "arcmin",
        "F(+T) − F(−T) of the fitted mean curve at the reference torque",
        "all",
        estimators.windup, estimator="difference", variants=("fitted", "direct"), fits=_FITS,
        words=("the unit winds up less than allowed", "the unit winds up more than allowed"),
    ),
    "asymmetry_at_rated": defined(
        "arcsec",
        "half of what the two sides wind up differently at the reference torque: |m(+T) + m(−T) − 2 m(0)| / 2; no "
        "transmission error, which needs rotation",
        "static testing, there called transmission accuracy",
        estimators.asymmetry,
        words=("the sides are more alike than expected", "one side winds up more than the other"), magnitude=True,
    ),
    "torque_ratio_slope": defined(
        "1",
        "slope m of T_out = C + m·T_in, loading, each side for itself",
        "inverse loading; backlash and stiffness measurement",
        None, sides=SIDED, branch="load", estimator="least squares",
        words=("less torque arrives at the output than allowed: friction that grows with load",
               "more torque arrives than the ratio allows: check ratio and sensors"),
    ),
    "torque_ratio_offset": defined(
        "N·m",
        "offset C of T_out = C + m·T_in, loading, negative side mirrored: friction of the input side as output torque",
        "inverse loading; backlash and stiffness measurement",
        None, sides=SIDED, branch="load", estimator="least squares",
        words=("the input side has more friction than allowed: the unit is tight",
               "the input side has less friction than expected"),
    ),
}  # fmt: skip
"""All metrics by id."""

METRIC_UNITS = {name: row.unit for name, row in METRICS.items()}
"""Unit of each metric's value and limits."""


def definition(wanted: MetricWanted) -> Definition:
    """Return the row of a wanted metric; AnalysisError naming what is unknown or not possible, and what is allowed."""
    row = METRICS.get(wanted.id)
    if row is None:
        near = difflib.get_close_matches(wanted.id, METRICS, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise AnalysisError(f"metric '{wanted.id}' is not known{hint} Known are {', '.join(METRICS)}")
    for name, found, allowed in (
        ("branch", wanted.branch, row.branches),
        ("side", wanted.side, row.sides),
        ("variant", wanted.variant, row.variants),
        ("fit", wanted.fit, row.fits),
    ):
        if found is not None and found not in allowed:
            raise AnalysisError(f"metric {wanted.id}: {name}: found '{found}'; allowed: {', '.join(allowed) or 'none'}")
    if wanted.fit is not None and wanted.variant == "direct":
        raise AnalysisError(f"metric {wanted.id}: fit: found '{wanted.fit}' with variant direct, which reads no fit")
    for name, chosen, most in (("band", wanted.band, 1.0), ("torque_nm", wanted.torque_nm, math.inf)):
        if chosen is not None and name not in row.free:
            raise AnalysisError(
                f"metric {wanted.id}: {name}: found {chosen:g}; it is part of the definition: leave it out"
            )
        if chosen is not None and not 0.0 < chosen <= most:
            raise AnalysisError(
                f"metric {wanted.id}: {name}: found {chosen:g}; needed is a number above 0, at most {most:g}"
            )
    return row
