"""What the studies of a bench say in words: a type 1 study, and one metric of a gage study."""

from __future__ import annotations

from analysis.line.type_one import CAPABLE, TypeOne
from station.quality.guided.evaluate import GageFigure
from station.web.languages import Words


def capable_said(one: TypeOne, say: Words) -> str:
    """Return whether a bench is good enough for the tolerance, with the shape of the word."""
    return say("● capable") if one.capable else say("■ NOT CAPABLE")


def indices_said(one: TypeOne, say: Words) -> str:
    """Return the indices of a type 1 study with their intervals."""
    return say(
        "Cg {cg} ({cg_low} … {cg_high}), Cgk {cgk} ({cgk_low} … {cgk_high}); {needed} is needed.",
        cg=f"{one.cg:.2f}",
        cg_low=f"{one.cg_low:.2f}",
        cg_high=f"{one.cg_high:.2f}",
        cgk=f"{one.cgk:.2f}",
        cgk_low=f"{one.cgk_low:.2f}",
        cgk_high=f"{one.cgk_high:.2f}",
        needed=CAPABLE,
    )


def measured_said(one: TypeOne, say: Words) -> str:
    """Return what a type 1 study is of, and the smallest tolerance that the bench is good enough for."""
    told = say(
        "{count} measurements, bias {bias}, standard deviation {sd}, tolerance {tolerance}.",
        count=one.measurements,
        bias=f"{one.bias:.3g}",
        sd=f"{one.sd:.3g}",
        tolerance=f"{one.tolerance:.4g}",
    )
    least = say("The smallest tolerance that this bench measures so is {least}.", least=f"{one.least_tolerance:.3g}")
    return say.whole(f"{told} {least}")


def gage_said(figure: GageFigure, say: Words) -> str:
    """Return the share of the bench in the spread of a metric, and how many groups of parts it tells apart."""
    return say(
        "{metric} side {side}: gage {shares}; the bench tells {groups} groups of parts apart",
        metric=figure.metric,
        side=figure.side,
        shares=say(figure.anova.shares),
        groups=figure.anova.ndc,
    )
