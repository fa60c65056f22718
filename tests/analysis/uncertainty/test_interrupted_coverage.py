"""Of a run that was interrupted U is stated with k = 3: what is certain becomes less, and never more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from check_support import FACTS

from analysis.evaluation.pipeline import Result, analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.method import Decision, MetricWanted
from analysis.uncertainty.scatter import COVERAGES, USUAL, coverage_of, enlarged, student_factor
from benchmarks.simulated.kinds import KINDS
from benchmarks.simulated.loop_generator import Bench, Hold, course_of, figures_of, measured, method_of

RV40 = KINDS["RV-40E"]
SOUND = Bench(cycles=1, calibrate=False)
STIFF = MetricWanted("stiffness_50_100", branch="load", side="+", min=20.0)
INTERRUPTED = COVERAGES["interrupted"]


def judged(wanted: MetricWanted = STIFF, holds: int | None = 0, bench: Bench = SOUND) -> Result:
    trace = measured(RV40, course_of(RV40, bench), bench, np.random.default_rng(1))
    facts = replace(FACTS, holds=holds)
    return analyse(
        trace, method_of(RV40, bench), [wanted], Decision("guard_band"), facts=facts, figures=figures_of(RV40)
    )


def test_the_table_of_coverage() -> None:
    assert {name: (row.factor, round(row.confidence, 4)) for name, row in COVERAGES.items()} == {
        "through": (2.0, 0.9545),
        "interrupted": (3.0, 0.9973),
    }
    assert coverage_of((), 0) == coverage_of((), None) == USUAL
    assert {coverage_of(*one)[:2] for one in (((), 1), (("a rest",), 0), (("a rest",), None))} == {INTERRUPTED[:2]}


def test_few_cycles_are_enlarged_by_the_factor_of_their_own_confidence() -> None:
    assert student_factor(np.inf, INTERRUPTED) == pytest.approx(3.0)
    assert student_factor(1e9, INTERRUPTED) == pytest.approx(3.0)
    assert student_factor(2.0, INTERRUPTED) == pytest.approx(19.21, abs=0.01)  # GUM, table G.2, 99.73 %
    assert student_factor(2.0) == pytest.approx(4.53, abs=0.01)
    assert 3.0 * enlarged(0.0, 1.0, 2.0, INTERRUPTED) == pytest.approx(19.21, abs=0.01)


@pytest.mark.parametrize("holds", [1, 3])
def test_a_hold_that_the_record_knows_widens_u_and_changes_no_value(holds: int) -> None:
    plain, held = (judged(holds=count).metrics[0].to_dict() for count in (0, holds))
    assert (plain["coverage_factor"], held["coverage_factor"]) == (2.0, 3.0)
    assert held["value"] == plain["value"]
    assert held["budget"] == plain["budget"]
    assert held["uncertainty"] == pytest.approx(1.5 * plain["uncertainty"])  # type: ignore[operator]


def test_the_result_says_with_which_factor_and_why() -> None:
    said = [note for note in judged(holds=1).notes if note.startswith("uncertainty: ")]
    assert "k = 3 (99.7 %): interrupted ramp" in said[0]
    assert not any("k = 3" in note for note in judged().notes)


def test_an_interruption_that_only_the_trace_shows_widens_u_too() -> None:
    result = judged(bench=replace(SOUND, holds=(Hold(1, 0.3),)), wanted=replace(STIFF, min=20.0))
    assert any(stage.name == "interruptions" for stage in result.stages)
    assert result.metrics[0].to_dict()["coverage_factor"] == 3.0


@pytest.mark.parametrize("before", [Verdict.PASS, Verdict.FAIL])
def test_what_was_just_certain_is_not_decidable_of_an_interrupted_run(before: Verdict) -> None:
    """With k = 2 the limit is 1.25 guard bands away; with k = 3 the guard band is 1.5 times as wide."""
    found = judged().metrics[0].headline
    assert found.value is not None
    assert found.uncertainty is not None
    away = 1.25 * Decision("guard_band").guard_factor * found.uncertainty
    limited = replace(STIFF, min=found.value - (away if before is Verdict.PASS else -away))
    assert judged(limited).verdict is before
    held = judged(limited, holds=1)
    assert held.verdict is Verdict.NOT_DECIDABLE
    assert "U is stated with k = 3 because a ramp was interrupted" in held.reasons[0]
    assert "find the cause of the interruptions" in held.reasons[0]


@pytest.mark.parametrize("holds", [None, 0, 1])
def test_the_reason_says_where_and_whether_a_hold_was_ordered(holds: int | None) -> None:
    bench = replace(SOUND, holds=(Hold(1, 0.3),))
    found = judged(bench=bench).metrics[0].headline
    assert found.value is not None
    (reason,) = judged(replace(STIFF, min=found.value), holds=holds, bench=bench).reasons
    stage = next(stage for stage in judged(bench=bench).stages if stage.name == "interruptions")
    place = stage.text.split(": ")[1].rsplit(", step", 1)[0]
    assert place.startswith("cycle 1, ")
    assert place in reason
    assert ("no hold was ordered" in reason) == (holds == 0)
    assert ("one hold was ordered" in reason) == (holds == 1)


@pytest.mark.parametrize("off", [-4.0, -1.2, -0.5, 0.5, 1.2, 4.0])
def test_no_verdict_becomes_certain_by_an_interruption(off: float) -> None:
    found = judged().metrics[0].headline
    assert found.value is not None
    assert found.uncertainty is not None
    limited = replace(STIFF, min=found.value + off * found.uncertainty)
    assert judged(limited, holds=1).verdict in {judged(limited).verdict, Verdict.NOT_DECIDABLE}
