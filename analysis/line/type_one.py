"""Type 1 study: whether a gage measures one part of known value well enough for a tolerance.

One part with a reference value is measured again and again by one bench. Cg compares the spread with a share of the
tolerance, Cgk the nearer end of that share with the bias too. Source: ISO 22514-7; VDA 5; AIAG MSA (bias by a t-test).
The share of 20 % spread over six standard deviations is the usual choice; a customer may prescribe another.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import scipy  # loads special where it is used

from analysis.line.capability import interval_of_both, interval_of_nearest
from analysis.line.samples import checked_level, checked_row
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

SHARE = 0.20
"""Share of the tolerance that the gage may take."""

SIGMAS = 6.0
"""Standard deviations that the spread of the gage counts as."""

CAPABLE = 1.33
"""Cg and Cgk from which a gage counts as capable."""

LEAST = 25
USUAL = 50
"""Measurements that a study needs at least, and that it usually has."""

MOST_RESOLUTION = 0.05
"""Largest resolution as a share of the tolerance."""


@dataclass(frozen=True)
class TypeOne:
    """Result of a type 1 study; intervals are confidence intervals, bias is mean minus reference.

    p_no_bias: p value of a bias of zero by a t-test. least_tolerance: the smallest tolerance for which Cg and Cgk
    reach 1.33. resolution: smallest difference of two different readings; resolution_share: of the tolerance.
    """

    measurements: int
    reference: float
    tolerance: float
    mean: float
    sd: float
    bias: float
    p_no_bias: float
    cg: float
    cg_low: float
    cg_high: float
    cgk: float
    cgk_low: float
    cgk_high: float
    least_tolerance: float
    resolution: float
    resolution_share: float
    capable: bool

    @property
    def fine_enough(self) -> bool:
        """Whether the readings are resolved finely enough for the tolerance."""
        return self.resolution_share <= MOST_RESOLUTION


def type_one(
    values: Sequence[float] | FloatArray,
    reference: float,
    tolerance: float,
    *,
    share: float = SHARE,
    sigmas: float = SIGMAS,
    level: float = 0.95,
) -> TypeOne:
    """Judge measurements of one part.

    reference: its known value, in the unit of the values. tolerance: upper minus lower limit; of a metric with one
    limit it has to be stated. share, sigmas: of the tolerance, and what it is compared with. Raises AnalysisError for
    fewer than 25 measurements, a tolerance or share that is not above zero, or readings that never differ.
    """
    row = checked_row(values, "type 1 study", LEAST)
    checked_level(level)
    if not (math.isfinite(reference) and tolerance > 0.0 and math.isfinite(tolerance)):
        raise AnalysisError(
            f"type 1 study: reference {reference:g}, tolerance {tolerance:g}; expected numbers, and a tolerance above 0"
        )
    if not (0.0 < share <= 1.0 and sigmas > 0.0):
        raise AnalysisError(
            f"type 1 study: found a share of {share:g} of the tolerance and {sigmas:g} standard deviations; expected a "
            "share above 0, up to 1, and more than 0 standard deviations"
        )
    ordered = sorted({float(value) for value in row})
    if len(ordered) < 2:
        raise AnalysisError(
            f"type 1 study: every reading is {ordered[0]:g}; expected different readings; check the resolution"
        )
    mean, sd = float(row.mean()), float(row.std(ddof=1))
    bias, freedom = mean - reference, row.size - 1.0
    cg = share * tolerance / (sigmas * sd)
    cgk = (0.5 * share * tolerance - abs(bias)) / (0.5 * sigmas * sd)
    cg_low, cg_high = interval_of_both(cg, freedom, level)
    cgk_low, cgk_high = interval_of_nearest(cgk, row.size, freedom, level)
    resolution = min(after - before for before, after in itertools.pairwise(ordered))
    return TypeOne(
        measurements=row.size,
        reference=reference,
        tolerance=tolerance,
        mean=mean,
        sd=sd,
        bias=bias,
        p_no_bias=2.0 * float(scipy.special.stdtr(freedom, -abs(bias) * math.sqrt(row.size) / sd)),
        cg=cg,
        cg_low=cg_low,
        cg_high=cg_high,
        cgk=cgk,
        cgk_low=cgk_low,
        cgk_high=cgk_high,
        least_tolerance=(CAPABLE * sigmas * sd + 2.0 * abs(bias)) / share,
        resolution=resolution,
        resolution_share=resolution / tolerance,
        capable=min(cg, cgk) >= CAPABLE,
    )
