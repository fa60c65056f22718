"""Metrics: what each word means. A row is a definition; the same loop gives other numbers by another row.

T is the torque at the output, T_r the reference torque, f(T) the forward branch (torque rising), r(T) the return branch
(torque falling), m(T) = (f + r) / 2 their mean, and F(T) the mean as fitted.
"""

from __future__ import annotations

from enum import Enum
from typing import Literal, NamedTuple

from definitions.units import ARCMINUTES, ARCSECONDS, LOSS, NUMBER, STIFFNESS, TORQUE, Kind


class Grade(NamedTuple):
    """Row of `GRADES`: number, the largest backlash that it takes [arcmin], and what it means."""

    grade: int
    most_arcmin: float
    text: str


GRADES: tuple[Grade, ...] = (
    Grade(1, 1.0, "precision grade 1: backlash up to 1 arcmin"),
    Grade(2, float("inf"), "not grade 1: backlash above 1 arcmin; no other grade is defined"),
)
"""Grades, best first. Source: "stiffness characterization", 3.2."""

GRADED = {
    "width_zero": "backlash_width_zero",
    "width_3pct": "backlash_width_3pct",
    "branches": "backlash_branches_3pct",
    "lost_motion": "lost_motion",
}
"""Backlash that a grade is read off, by the variant of the metric; the first one unless another is chosen."""


FIT_POINTS, LSQ_POINTS = 400, 200
"""Equally spaced torques, ends among them, at which each segment of a fit and the least squares stiffness are fitted:
neither dwell nor speed weighs one torque more. They belong to the definition: an end weighs as much as a point between,
and with five times as many points a spring constant is 0.02 % lower."""


class Fit(NamedTuple):
    """Row of `FITS`: name in a result, what it does, where it comes from."""

    name: str
    text: str
    source: str


FITS: dict[str, Fit] = {
    "six_segment": Fit(
        "six-segment fit",
        "three segments per branch: a straight line up to the break torque (±90 N·m for 412 N·m unless the recipe "
        "gives one), a quadratic curve on each side beyond it. Each segment is fitted by least squares at 400 equally "
        "spaced torques. The straight line is then shifted by the mean of its two gaps to the curves",
        "publication on backlash and stiffness measurement",
    ),
    "six_segment_20pct": Fit(
        "six-segment fit",
        "as the six-segment fit, with the break torque at 20 % of the reference torque",
        "publication on inverse loading",
    ),
    "three_region": Fit(
        "three-region fit",
        "three regions per torque direction: a quadratic curve up to 20 % of the reference torque, a straight line "
        "up to 80 %, a quadratic curve beyond. Each region is fitted by least squares at 400 equally spaced torques. "
        "Gaps between the regions are not closed",
        "publication on inverse loading",
    ),
}
"""Fits that a stiffness curve can be read from; the first one is taken when none is asked for."""


class Scale(Enum):
    """What the usual range of a limit is a multiple of; the value says it in words."""

    OWN = ""
    """The metric's own unit."""
    STIFFNESS = "the unit's catalogue stiffness"
    WINDUP = "the wind-up by the catalogue stiffness"
    LOSS = "reference torque times the wind-up by the catalogue stiffness"
    RATIO = "the ratio"
    RATED_TORQUE = "the rated torque"


class Usual(NamedTuple):
    """Range in which limits of a metric lie, in the scale; and what no unit can be beyond.

    Ranges are wide, a factor of ten about what reducers of robots and indexing tables have: they find a wrong unit or a
    slipped digit, not a strict limit. Sources: catalogues of Nabtesco, SPINEA and Harmonic Drive (backlash and lost
    motion below 1 to 3 arcmin, planetary gears up to 10), and the metrics of unit P1 of the virtual bench.
    """

    least: float
    most: float
    of: Scale = Scale.OWN
    floor: float | None = 0.0
    """Smallest value there is: a `min` up to it never fails, a `max` below it always does."""
    ceiling: float | None = None
    """Largest value there is: a `max` from it on never fails, a `min` above it always does."""


class Share(NamedTuple):
    """Range in which a torque that metrics are read at usually lies, as a fraction of another one."""

    least: float
    most: float

    def holds(self, fraction: float) -> bool:
        """Say whether a fraction is usual; a conversion of units may round it."""
        return self.least * (1.0 - 1e-9) <= fraction <= self.most * (1.0 + 1e-9)


USUAL_BAND = Share(0.01, 0.10)
"""Of the reference torque: catalogues have 3 to 5 %. Nearer to zero a worn unit shows no play, whatever the limit."""

USUAL_REFERENCE = Share(0.5, 1.25)
"""Of the rated torque: what percentages of metrics stand for. A loop over less torque has less play and more slope."""


class Bad(NamedTuple):
    """Side on which a unit is bad, and what a value that is too low and one that is too high mean."""

    side: Literal["low", "high"]
    too_low: str
    too_high: str


LOOSE = Bad("high", "the unit has less play than allowed: it may be tight", "the unit has more play than allowed")
SOFT = Bad("low", "the unit is softer than allowed", "the unit is stiffer than allowed: it may be preloaded or jammed")

PLAY = Usual(0.01, 15.0)
CATALOGUE = Usual(0.1, 3.0, Scale.STIFFNESS)

SPRING_STEP_ENDS = {"ending": 0.0, "centred": 0.5, "from": 1.0, "direct": 0.0}
"""Where the torque step of a spring constant ends, in steps beyond the reference torque, by its variant."""

BOTH = ("both",)
SIDED = ("+", "-")
WIDTH = ("width",)
MEAN = ("mean",)
LOAD = ("load",)
UNLOAD = ("unload",)
BRANCHES = ("load", "unload", "mean")
CURVES = ("mean", "load", "unload")
"""Branches of a fitted curve."""

TWO_SYSTEMS = "publications on inverse loading and on backlash and stiffness measurement"


class Metric(NamedTuple):
    """One metric. Of choices, the first one is taken unless another is asked for."""

    id: str
    symbol: str
    title: str
    """What people read first."""
    kind: Kind
    text: str
    """The definition."""
    source: str
    bad: Bad
    usual: Usual
    sides: tuple[str, ...] = BOTH
    """Sides that have a value of their own; `both` for one of the whole loop."""
    branches: tuple[str, ...] = MEAN
    estimator: str = "interpolation"
    variants: tuple[str, ...] = ()
    fits: tuple[str, ...] = ()
    """Fitted curves that it can be read from; none for a metric read off the branches."""
    band: float | None = None
    """Torque where it is read on both sides, as a fraction of the reference torque."""
    torque: float | None = None
    """Torque where it is read on one side, as a fraction of the reference torque."""
    span: tuple[float, float] | None = None
    """Torques on one side that it holds between, as fractions of the reference torque; None where band, torque, the
    break torques or a step say it."""
    free: tuple[str, ...] = ()
    """Of `band` and `torque`, what may be chosen; the rest is part of the definition."""
    reach: float = 0.0
    """Torque that the cycles must reach, as a fraction of the reference torque."""
    calibration: bool = False
    """It comes from the torque ratio, not from the loop: the state calibrate measures it."""
    graded: bool = False
    """The estimate is a backlash [arcmin], and the value is its grade."""
    magnitude: bool = False
    """The estimate has a sign, and the value is the magnitude of its mean over the cycles."""
    segmented: bool = False
    """The break torques T1 and T2 are part of what is read."""

    @property
    def unit(self) -> str:
        """Unit of value and limits; `1` for a plain number."""
        return self.kind.shown

    @property
    def narrowed_by_delay(self) -> bool:
        """Say whether a delay makes it smaller: read between the branches, or from one side of zero to the other."""
        return self.branches in (WIDTH, UNLOAD) or self.band is not None


def _segment(number: int, torques: str) -> Metric:
    return Metric(
        f"k{number}", f"K{number}", f"Stiffness K{number} ({torques})", STIFFNESS,
        f"stiffness {torques}, of three straight lines that meet at the break torques T1 and T2 (20 % and 70 % of the "
        "reference torque unless given), on the chosen branch",
        "Harmonic Drive catalogue", SOFT, CATALOGUE,
        sides=SIDED, branches=BRANCHES, estimator="three-segment fit", variants=("fitted", "chord"), reach=1.0,
        segmented=True,
    )  # fmt: skip


_ROWS = (
    Metric(
        "backlash_width_3pct", "B3", "Backlash (loop width at ±3 % T_r)", ARCMINUTES,
        "loop width at ±3 % of the reference torque: |f(T) − r(T)|, separately for each torque direction; f is the "
        "branch of rising, r of falling torque",
        TWO_SYSTEMS, LOOSE, PLAY,
        sides=SIDED, branches=WIDTH, band=0.03, reach=0.03, magnitude=True,
    ),
    Metric(
        "backlash_width_zero", "B0", "Backlash (loop width at zero torque)", ARCMINUTES,
        "loop width at zero torque: |f(0) − r(0)|; f is the branch of rising, r of falling torque",
        "publication on stiffness characterization; called backlash by Nabtesco, gear clearance by the standard",
        LOOSE, PLAY,
        branches=WIDTH, band=0.0, magnitude=True,
    ),
    Metric(
        "backlash_branches_3pct", "BB3", "Backlash (return branch at +3 % to forward branch at −3 % T_r)", ARCMINUTES,
        "angle on the branch of falling torque at +3 % minus angle on the branch of rising torque at −3 % of the "
        "reference torque: r(+b·T) − f(−b·T). It contains lost motion and loop width",
        "publication on static testing", LOOSE, PLAY,
        branches=WIDTH, band=0.03, reach=0.03,
    ),
    Metric(
        "gear_clearance", "j", "Gear clearance (unloading branches at zero torque)", ARCMINUTES,
        "half the distance between the two unloading branches, r and f, at zero torque; both torque directions show "
        "the same value. Variant intercept: distance of each branch from the zero of the angle",
        "publication on static testing", LOOSE, PLAY,
        sides=(*BOTH, *SIDED), branches=UNLOAD, variants=("centred", "intercept"), span=(0.0, 0.0),
    ),
    Metric(
        "grade", "G", "Precision grade (of the mean backlash)", NUMBER,
        "precision grade of the mean backlash: 1 up to 1 arcmin, 2 above (not grade 1); the backlash is the loop width "
        "at zero torque unless another is chosen",
        "publication on stiffness characterization",
        Bad("high", "the precision grade is better than required", LOOSE.too_high),
        Usual(1.0, 2.0, floor=GRADES[0].grade, ceiling=GRADES[-1].grade),
        branches=WIDTH, estimator="table of precision grades", band=0.03, variants=tuple(GRADED), reach=0.03,
        graded=True,
    ),
    Metric(
        "lost_motion", "LM", "Lost motion (centreline at ±3 % T_r by default)", ARCMINUTES,
        "change of the loop's centreline m between −b and +b of the reference torque T (b: 3 % by default): m(+b·T) "
        "− m(−b·T)",
        "Nabtesco catalogue, SPINEA catalogue", LOOSE, PLAY,
        band=0.03, free=("band",), reach=0.03,
    ),
    Metric(
        "stiffness_lsq", "K_lsq", "Stiffness (least squares, 20–80 % T_r)", STIFFNESS,
        "slope of the straight line through 200 equally spaced torques of the loading branch, 20–80 % of the "
        "reference torque, by least squares of the wind-up",
        "publications on static testing and on stiffness characterization (section 4.4)", SOFT, CATALOGUE,
        sides=SIDED, branches=LOAD, estimator="least squares", reach=0.8, span=(0.2, 0.8),
    ),
    Metric(
        "stiffness_two_point", "K_2p", "Stiffness (chord, 20–80 % T_r)", STIFFNESS,
        "slope of the straight line (chord) between two points of the loading branch, at 20 % and 80 % of the "
        "reference torque",
        "publication on stiffness characterization, section 4.3", SOFT, CATALOGUE,
        sides=SIDED, branches=LOAD, estimator="chord", reach=0.8, span=(0.2, 0.8),
    ),
    Metric(
        "stiffness_end_point", "K_ep", "Stiffness (end point: chord of the unloading branch)", STIFFNESS,
        "reference torque divided by a wind-up: wind-up of the loading branch at that torque minus wind-up of the "
        "unloading branch at zero torque; higher than the chord of the loading branch",
        "publication on stiffness characterization, section 4.2", SOFT, CATALOGUE,
        sides=SIDED, branches=LOAD, estimator="chord", reach=1.0, span=(0.0, 1.0),
    ),
    Metric(
        "stiffness_estimate", "K_est", "Stiffness (chord, 0–100 % T_r)", STIFFNESS,
        "slope of the straight line (chord) from zero to the reference torque on the loading branch, as read by eye",
        "publication on stiffness characterization, section 4.1", SOFT, CATALOGUE,
        sides=SIDED, branches=LOAD, estimator="chord", reach=1.0, span=(0.0, 1.0),
    ),
    Metric(
        "stiffness_50_100", "K_50", "Stiffness (secant, 50–100 % T_r)", STIFFNESS,
        "slope of the straight line (secant) between 50 % and 100 % of the reference torque on the chosen branch, as "
        "measured",
        "Nabtesco catalogue, general practice", SOFT, CATALOGUE,
        sides=SIDED, branches=BRANCHES, estimator="secant", reach=1.0, span=(0.5, 1.0),
    ),
    Metric(
        "stiffness_at", "K(T)", "Stiffness (slope of the fitted curve at a torque)", STIFFNESS,
        "1 / F′(T), the slope of torque over wind-up, at the chosen torque (50 % of the reference torque by default); "
        "F is the fitted curve of the mean of both branches, or of the chosen branch",
        "publication on inverse loading", SOFT, CATALOGUE,
        sides=SIDED, branches=CURVES, estimator="slope", torque=0.5, free=("torque",), fits=tuple(FITS), reach=0.5,
    ),
    Metric(
        "spring_constant", "K_s", "Spring constant (10 N·m of the fitted curve at T_r)", STIFFNESS,
        "ΔT / ΔF over the last 10 N·m up to the reference torque (a variant centres them on it or starts there); F is "
        "the fitted curve of the mean of both branches, or of the chosen branch",
        TWO_SYSTEMS, SOFT, CATALOGUE,
        sides=SIDED, branches=CURVES, estimator="chord", variants=tuple(SPRING_STEP_ENDS),
        fits=tuple(FITS), reach=1.0,
    ),
    _segment(1, "from zero to T1"),
    _segment(2, "from T1 to T2"),
    _segment(3, "from T2 to the reference torque"),
    Metric(
        "hysteresis_energy", "W", "Hysteresis loss (area of the loop)", LOSS,
        "area of the loop between its turning points: energy lost per cycle",
        "publication on stiffness characterization",
        Bad("high", "less energy is lost per load cycle than expected",
            "more energy is lost in friction per load cycle than allowed"),
        Usual(0.003, 1.0, Scale.LOSS),
        branches=WIDTH, estimator="trapezoid", span=(0.0, 1.0),
    ),
    Metric(
        "hysteresis_angle", "H", "Hysteresis (loop width at 50 % T_r by default)", ARCSECONDS,
        "loop width at the chosen torque of one direction (50 % of the reference torque by default): |f(T) − r(T)|; "
        "f is the branch of rising, r of falling torque",
        "publication on stiffness characterization",
        Bad("high", "less hysteresis than expected", "more hysteresis than allowed: the unit has more friction"),
        Usual(1.0, 900.0),
        sides=SIDED, branches=WIDTH, torque=0.5, free=("torque",), reach=0.5, magnitude=True,
    ),
    Metric(
        "windup", "Δφ", "Wind-up (−T_r to +T_r)", ARCMINUTES,
        "F(+T) − F(−T) at the reference torque T; F is the fitted curve of the mean of both branches",
        "all",
        Bad("high", "the unit winds up less than allowed", "the unit winds up more than allowed"),
        Usual(0.3, 10.0, Scale.WINDUP),
        estimator="difference", variants=("fitted", "direct"), fits=tuple(FITS), reach=1.0, span=(0.0, 1.0),
    ),
    Metric(
        "asymmetry_at_rated", "A", "Asymmetry of the torque directions at T_r", ARCSECONDS,
        "half the difference in wind-up of the two torque directions at the reference torque T: |m(+T) + m(−T) − 2 "
        "m(0)| / 2; m is the mean of both branches, as measured. It is not the transmission error, which needs "
        "rotation",
        "publication on static testing, there called transmission accuracy",
        Bad("high", "the wind-up of the two torque directions differs less than expected",
            "the unit winds up more in one torque direction than in the other"),
        Usual(1.0, 600.0),
        reach=1.0, span=(0.0, 1.0), magnitude=True,
    ),
    Metric(
        "torque_ratio_slope", "m", "Torque ratio, slope (loading)", NUMBER,
        "slope m of the line: output torque = C + m · input torque, while loading, for each torque direction",
        TWO_SYSTEMS,
        Bad("low", "the output torque is too low for the input torque: the unit has friction that grows with the load",
            "the output torque is too high for the gear ratio: check gear ratio and torque sensors"),
        Usual(0.5, 1.02, Scale.RATIO),
        sides=SIDED, branches=LOAD, estimator="least squares", calibration=True,
    ),
    Metric(
        "torque_ratio_offset", "C", "Torque ratio, offset (loading)", TORQUE,
        "offset C of the line: output torque = C + m · input torque, while loading (negative torques mirrored). It "
        "is the friction of the input side, as output torque",
        TWO_SYSTEMS,
        Bad("low", "the input side has more friction than allowed: the unit turns heavily",
            "the input side has less friction than expected"),
        Usual(-0.3, 0.0, Scale.RATED_TORQUE, floor=None),
        sides=SIDED, branches=LOAD, estimator="least squares", calibration=True,
    ),
)  # fmt: skip

METRICS: dict[str, Metric] = {row.id: row for row in _ROWS}
"""All metrics by id."""
