"""PASS, FAIL and NOT DECIDABLE: the rule as a table, and what never passes."""

import math
import statistics

import pytest
from printed_numbers import reads
from reference_unit import ReferenceUnit, exact_trace

from analysis.evaluation.evaluate import judged_spread
from analysis.evaluation.metric_result import SideValue
from analysis.evaluation.pipeline import analyse
from analysis.evaluation.verdict import Verdict, judge, worst
from analysis.loop.method import Decision, Method, MetricWanted
from analysis.trace.errors import AnalysisError
from definitions.metrics import METRICS

METHOD = Method(ratio=121, rated_torque_nm=412)
TRACE = exact_trace(ReferenceUnit(), 480.0, points=3001)
BACKLASH = MetricWanted("backlash_width_3pct", max=1.0)
SIMPLE, GUARDED = Decision(), Decision("guard_band", 0.5)

PASS, FAIL, OPEN = Verdict.PASS, Verdict.FAIL, Verdict.NOT_DECIDABLE


@pytest.mark.parametrize(
    ("value", "uncertainty", "limits", "decision", "verdict"),
    [
        (0.94, None, (None, 1.0), SIMPLE, PASS),
        (1.00, None, (None, 1.0), SIMPLE, PASS),
        (1.01, None, (None, 1.0), SIMPLE, FAIL),
        (0.94, None, (0.95, None), SIMPLE, FAIL),
        (0.94, None, (0.95, 0.99), SIMPLE, FAIL),
        (0.97, None, (0.95, 0.99), SIMPLE, PASS),
        (None, None, (None, 1.0), SIMPLE, OPEN),
        (math.nan, 0.1, (None, 1.0), SIMPLE, OPEN),
        (math.inf, 0.1, (0.5, None), SIMPLE, OPEN),
        (0.94, 0.10, (None, 1.0), GUARDED, PASS),
        (0.96, 0.10, (None, 1.0), GUARDED, OPEN),
        (1.04, 0.10, (None, 1.0), GUARDED, OPEN),
        (1.06, 0.10, (None, 1.0), GUARDED, FAIL),
        (0.94, None, (None, 1.0), GUARDED, OPEN),
        (0.50, math.nan, (None, 1.0), GUARDED, OPEN),
        (0.97, 0.20, (0.95, 0.99), GUARDED, OPEN),
    ],
)
def test_rule(
    value: float | None,
    uncertainty: float | None,
    limits: tuple[float | None, float | None],
    decision: Decision,
    verdict: Verdict,
) -> None:
    assert judge(value, uncertainty, limits, decision)[0] is verdict


@pytest.mark.parametrize(
    ("verdicts", "overall"),
    [([], OPEN), ([PASS], PASS), ([PASS, OPEN], OPEN), ([OPEN, FAIL, PASS], FAIL)],
)
def test_worst(verdicts: list[Verdict], overall: Verdict) -> None:
    assert worst(verdicts) is overall


def test_pass_and_fail_of_a_run() -> None:
    good = analyse(TRACE, METHOD, [BACKLASH])
    assert (good.verdict, good.reasons) == (PASS, ())
    bad = analyse(TRACE, METHOD, [MetricWanted("backlash_width_3pct", max=0.9)])
    assert bad.verdict is FAIL
    assert reads(bad.reasons[0], "backlash_width_3pct, side +: 0.94 arcmin is above the limit of 0.9 arcmin: ")


SPREAD_LIMIT = 0.01


@pytest.mark.parametrize(
    ("widths", "verdict", "said"),
    [
        ((0.94, 0.945, 0.94), PASS, ""),
        ((0.92, 0.945, 0.96), FAIL, "above the limit of 0.01 arcmin"),
        ((0.94,), OPEN, "needs two cycles or more; there is 1"),
    ],
)
@pytest.mark.parametrize("largest", [None, 1.0, 0.9])
def test_the_standard_deviation_over_the_cycles_may_have_a_limit(
    widths: tuple[float, ...], verdict: Verdict, said: str, largest: float | None
) -> None:
    """It decides beside the limits of the value, on each side, and by itself where there are none."""
    row = METRICS["lost_motion"]
    wanted = MetricWanted("lost_motion", max=largest, max_standard_deviation=SPREAD_LIMIT)
    spread = statistics.stdev(widths) if len(widths) > 1 else None
    for side in ("both", "-"):
        of_value, why = (FAIL, "too wide") if largest == 0.9 else (PASS, "")
        found = SideValue(side, statistics.mean(widths), None, spread, widths, of_value, why)
        judged = judged_spread(wanted, row, found, invalid=False)
        assert judged.verdict is worst((of_value, verdict))
        assert said in judged.reason
        assert judged.reason.startswith(why or "lost_motion" * bool(said))
        assert judged_spread(wanted, row, found, invalid=True).verdict is OPEN


def test_a_limit_on_the_spread_alone_decides_a_run() -> None:
    wanted = MetricWanted("backlash_width_3pct", max_standard_deviation=SPREAD_LIMIT)
    one_cycle = analyse(TRACE, METHOD, [wanted])
    assert one_cycle.verdict is OPEN
    assert one_cycle.metrics[0].to_dict()["limits"] == {"min": None, "max": None, "max_standard_deviation": 0.01}


@pytest.mark.parametrize("limit", [1.0, 0.9])
def test_an_invalid_measurement_decides_nothing(limit: float) -> None:
    wanted = [MetricWanted("backlash_width_3pct", max=limit)]
    result = analyse(TRACE, METHOD, wanted, invalid=["0.4 % of the periods were missed, 0.1 % are allowed"])
    assert result.verdict is OPEN
    assert result.metrics[0].verdict is OPEN
    assert result.reasons[0] == "measurement invalid: 0.4 % of the periods were missed, 0.1 % are allowed"
    assert "PASS" not in str(result.to_dict())


def test_a_metric_that_cannot_be_had_never_passes() -> None:
    short = exact_trace(ReferenceUnit(), 300.0, points=3001)
    result = analyse(short, METHOD, [BACKLASH, MetricWanted("stiffness_50_100", min=95.0)])
    assert result.metrics[0].verdict is PASS
    assert result.metrics[1].verdict is OPEN
    assert result.verdict is OPEN
    assert "could not be evaluated" in result.reasons[0]
    assert "412" in result.reasons[0]


def test_what_is_missing_decides_where_it_has_a_limit_and_is_noted_where_it_has_none() -> None:
    told = analyse(TRACE, METHOD, [BACKLASH, MetricWanted("torque_ratio_slope")])
    assert (told.verdict, told.reasons) == (PASS, ())
    assert (told.metrics[1].verdict, told.metrics[1].headline.value) == (None, None)
    assert "torque_in_nm" in told.notes[-1]
    limited = analyse(TRACE, METHOD, [BACKLASH, MetricWanted("torque_ratio_slope", min=1.0)])
    assert limited.verdict is OPEN
    assert "torque_in_nm" in limited.reasons[0]


def test_guard_band_needs_an_uncertainty() -> None:
    result = analyse(TRACE, METHOD, [BACKLASH], GUARDED)
    assert result.verdict is OPEN
    assert "give the bench file (--bench)" in result.reasons[0]
    twice = exact_trace(ReferenceUnit(), 480.0, points=3001, cycles=2)
    assert analyse(twice, METHOD, [BACKLASH], GUARDED).verdict is PASS


def test_without_a_limit_there_is_nothing_to_decide() -> None:
    result = analyse(TRACE, METHOD, [MetricWanted("lost_motion")])
    assert result.metrics[0].verdict is None
    assert result.verdict is OPEN


def test_a_loop_the_wrong_way_round_is_invalid() -> None:
    assert TRACE.angle_out_rad is not None
    turned = type(TRACE)(
        torque_out_nm=TRACE.torque_out_nm,
        angle_out_rad=-TRACE.angle_out_rad,
        segment=TRACE.segment,
        segments=TRACE.segments,
    )
    result = analyse(turned, METHOD, [BACKLASH])
    assert result.verdict is OPEN
    assert "wrong_way" in result.reasons[0]


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        (MetricWanted("lost_motoin"), "did you mean lost_motion"),
        (MetricWanted("lost_motion", min=2.0, max=1.0), "min 2 is above max 1"),
        (MetricWanted("lost_motion", max=math.nan), "finite"),
        (MetricWanted("lost_motion", side="+"), "allowed: both"),
        (MetricWanted("lost_motion", band=1.5), "above 0, at most 1"),
        (MetricWanted("backlash_width_3pct", band=0.05), "fixed by the definition"),
        (MetricWanted("stiffness_at", torque_nm=-206.0), "above 0"),
        (MetricWanted("stiffness_50_100", branch="up"), "allowed: load, unload, mean"),
        (MetricWanted("spring_constant", variant="starting"), "allowed: ending, centred, from, direct"),
    ],
)
def test_what_cannot_be_asked_for(wanted: MetricWanted, said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        analyse(TRACE, METHOD, [wanted])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"ratio": 0.0}, "ratio"),
        ({"rated_torque_nm": math.nan}, "rated_torque_nm"),
        ({"loading": "both"}, "allowed are input, output"),
        ({"loading": "output", "output_torque": "calibrated"}, "choose 'reaction'"),
        ({"break_torque_nm": 500.0}, "break < reference"),
    ],
)
def test_methods_that_make_no_sense(change: dict[str, object], said: str) -> None:
    figures: dict[str, object] = {"ratio": 121.0, "rated_torque_nm": 412.0}
    with pytest.raises(AnalysisError, match=said):
        Method(**(figures | change))  # type: ignore[arg-type]


def test_decision_refuses_what_is_not_a_rule() -> None:
    with pytest.raises(AnalysisError, match="simple, guard_band"):
        Decision("strict")  # type: ignore[arg-type]
    with pytest.raises(AnalysisError, match="zero or more"):
        Decision("guard_band", -1.0)
