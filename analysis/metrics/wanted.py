"""What is asked of a metric, held against its definition."""

from __future__ import annotations

import difflib
import math

from analysis.loop.method import MetricWanted
from analysis.trace.errors import AnalysisError
from definitions.metrics import METRICS, Metric


def definition(wanted: MetricWanted) -> Metric:
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
        raise AnalysisError(
            f"metric {wanted.id}: fit: found '{wanted.fit}' with variant direct, which uses no fit; leave it out"
        )
    for name, chosen, most in (("band", wanted.band, 1.0), ("torque", wanted.torque_nm, math.inf)):
        if chosen is not None and name not in row.free:
            raise AnalysisError(
                f"metric {wanted.id}: {name}: found {chosen:g}; this value is fixed by the definition: leave the "
                "option out"
            )
        if chosen is not None and not 0.0 < chosen <= most:
            raise AnalysisError(
                f"metric {wanted.id}: {name}: found {chosen:g}; expected a number above 0, at most {most:g}"
            )
    return row
