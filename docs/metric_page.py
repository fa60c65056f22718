"""The page of metrics: definitions, fits, presets and grades."""

from __future__ import annotations

from definitions.metrics import FITS, GRADES, METRICS, Metric
from docs.markdown import NOTE, table
from recipes.schema.metric_presets import PRESETS, PresetMetric

METRIC_WORDS = """
The same loop gives different numbers under the same word, so the definition is part of every number: results, reports
and `lostmotion metrics` give it beside the value, with the branch, the estimator, its break torques and the cycles.

T is the torque at the output, T_r the reference torque, f(T) the forward branch (torque rising), r(T) the return branch (torque falling), and
m(T) = (f + r) / 2 the centreline, all as measured, next to a turn too; F(T) is the centreline as fitted. Loading on the positive side is f,
on the negative side r. A recipe chooses with `branch`, `side`, `torque`, `band`, `variant` and `fit`; the first of the
names below is taken when it says nothing.

"""
FIT_WORDS = """`fit` chooses the curve for metrics that read one. With `branch: load` or `unload` the same fit is read
of that branch alone. Near the rated torque the fits differ on one and the same loop: the spring constant of unit
P1, loaded to ±480 N·m without noise, reads 115.17, 115.75 and 109.28 N·m/arcmin by the three fits; the unit's elastic
stiffness there is 109.34.

"""
REVERSAL_WORDS = """After a turn the friction of the unit goes over to the other side, and one branch is steeper there than the spring of
the unit. What is read off the branches has that in it: a secant of `branch: mean` or `branch: unload` next to the turn
is stiffer than that of the loading branch, the more the less the unit was loaded beyond the reference torque. Fits leave that
stretch out: at most 2.25 times the friction torque of the loop, no more than 1.125 times the torque by which the loop shows its friction reversed,
and less of it, down to nothing, where the branch does not leave its turn steeply. It grows without a step; the result
says how long it is. U of a fitted metric has in it what finding the stretch costs, for it is found again in every loop that the
budget moves.

"""
PRESET_WORDS = """A preset asks for the definitions that belong together at one source. In a recipe, beside `metrics` or instead
of them: `presets: [inverse, nabtesco]`. For a trace: `lostmotion analyze TRACE --recipe R --preset nabtesco` reports
the preset's metrics instead of the recipe's. A preset has no limits; a limit in the recipe for the same
definition holds, and with `--preset` nothing passes while the recipe limits a definition that the preset leaves out.

A single metric: `lostmotion analyze TRACE --recipe R --metric "stiffness_at torque=50% branch=load"`, once for each,
beside `--preset` or instead of it. The text is the id and then the options of an entry of `metrics` as `option=value`,
by the same names, units and ranges. Limits are the recipe's, as with `--preset`.

A recipe that asks for one metric in several ways has several series of it:
`lostmotion capability --metric "spring_constant three_region"`. Percentages are always of the recipe's `reference_torque`; Yaskawa's lost motion is `lost_motion` with `band: 5 %`.

"""
GRADE_WORDS = """`grade` is read off the mean backlash of the cycles. When the uncertainty of the backlash reaches into
another grade, the grade is uncertain by one: with a guard band it is not decidable then.

"""


def _choices(metric: Metric) -> str:
    """What can be chosen for a metric, the default first."""
    several = {"branch": metric.branches, "variant": metric.variants, "fit": metric.fits}
    found = [f"{key}: {', '.join(names)}" for key, names in several.items() if len(names) > 1]
    return "; ".join([*found, *metric.free])


def _preset_metric(row: PresetMetric) -> str:
    """A metric of a preset with what is chosen for it."""
    band = "" if row.band is None else f"band {100 * row.band:g} %"
    chosen = ", ".join(part for part in (row.branch, band, row.variant, row.fit) if part)
    return f"`{row.id}`" + (f" ({chosen})" if chosen else "")


def metrics() -> str:
    """The page of metric definitions, fits, presets and grades."""
    rows = (
        (m.title, f"`{key}`", m.symbol, m.unit, m.text, m.estimator, ", ".join(m.sides), _choices(m), m.source)
        for key, m in METRICS.items()
    )
    head = (
        "metric",
        "id",
        "symbol",
        "unit",
        "definition",
        "estimator",
        "sides",
        "what can be chosen",
        "where it comes from",
    )
    presets = (
        (f"`{key}`", p.text, ", ".join(map(_preset_metric, p.metrics)), p.reference, p.breaks)
        for key, p in PRESETS.items()
    )
    preset_head = ("preset", "whose definitions", "metrics", "percentages at the source refer to", "break torques")
    grades = ((row.grade, f"{row.most_arcmin:g} arcmin" if row.most_arcmin < 1e9 else "", row.text) for row in GRADES)
    return (
        "# Metrics\n\n" + NOTE + METRIC_WORDS + table(head, rows)
        + "\n## Fits of the stiffness curve\n\n" + FIT_WORDS + REVERSAL_WORDS
        + table(("fit", "what it does", "where it comes from"), ((f"`{k}`", f.text, f.source) for k, f in FITS.items()))
        + "\n## Presets\n\n" + PRESET_WORDS + table(preset_head, presets)
        + "\n## Precision grades\n\n" + GRADE_WORDS + table(("grade", "up to", "what it means"), grades)
    )  # fmt: skip
