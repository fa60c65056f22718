"""The study of wrong passes: its unit is bad, a size that passes is found, and its table has every defect."""

from __future__ import annotations

from pathlib import Path

import pytest

from analysis.evaluation.verdict import Verdict
from benchmarks import wrong_pass
from benchmarks.page import put
from benchmarks.simulated.truth import truth
from benchmarks.wrong_pass import (
    BUDGET,
    CASES,
    METRICS,
    PEAK_NM,
    SHOWN,
    UNIT,
    Case,
    Passed,
    found_of,
    largest_passing,
    limited,
    table,
)


@pytest.mark.parametrize("metric", METRICS)
def test_unit_is_beyond_its_limit_and_fails_without_a_defect(metric: str) -> None:
    wanted = limited(metric)
    for side in (1, -1):
        exact = truth(UNIT, metric, side, PEAK_NM)
        assert exact / wanted.max > 1.149 if wanted.max is not None else exact / wanted.min < 0.851
    result = wrong_pass._judged(Case("none", "", 1.0), 0.0, "whole run", [wanted])
    assert result.verdict is Verdict.FAIL


def test_largest_size_is_searched_from_above_in_both_signs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sizes of either sign have an end of their own: -0.3 passes and 0.2 does, so it is the first."""
    case = Case("made", "1", 1.0)
    monkeypatch.setattr(
        wrong_pass, "_passes", lambda _, size, __: (["m"] if -0.3 <= size <= 0.2 and size else [], True)
    )
    found = largest_passing(case, "whole run")
    assert found.size == pytest.approx(-0.3, rel=0.1)
    assert (found.metric, found.disguises) == ("m", True)
    monkeypatch.setattr(wrong_pass, "_passes", lambda *_: ([], False))
    assert largest_passing(case, "whole run") == Passed(None, "", disguises=False)


def test_what_passes_by_an_error_that_the_checks_leave_open_does_not_with_it_in_the_budget() -> None:
    """A sensor hysteresis of −4 N·m, of the 6 N·m that are left open, hides a lost motion 15 % beyond its limit."""
    case, wanted = CASES["hysteresis"], [limited("lost_motion")]
    assert wrong_pass._judged(case, -4.0, "whole run", wanted).verdict is Verdict.PASS
    assert wrong_pass._judged(case, -4.0, BUDGET, wanted).verdict is Verdict.NOT_DECIDABLE


@pytest.mark.parametrize(("metric", "size"), [("backlash_width_3pct", 4.0), ("lost_motion", -12.0)])
def test_a_hysteresis_alike_at_every_load_is_told_and_in_the_budget(metric: str, size: float) -> None:
    """Of a lost motion, which follows the more of it the less there is, all of it is tried at once."""
    case, wanted = CASES["even hysteresis"], [limited(metric)]
    told = wrong_pass._judged(case, size, "whole run", wanted)
    assert told.verdict is Verdict.PASS
    (left,) = [check.left_open for check in told.checks if check.id == "torque_out_zero"]
    assert left is not None
    assert abs(size) < left.figure < abs(size) + 1.5
    assert wrong_pass._judged(case, size, BUDGET, wanted).verdict is Verdict.NOT_DECIDABLE


@pytest.mark.parametrize("shown", SHOWN)
def test_a_hysteresis_beyond_what_friction_may_be_is_refused(shown: str) -> None:
    result = wrong_pass._judged(CASES["even hysteresis"], -30.0, shown, [limited("lost_motion")])
    assert "torque_out_zero" in [check.id for check in result.checks if check.passed is False]
    assert result.verdict is Verdict.NOT_DECIDABLE


def test_a_delay_of_the_angle_within_the_ramps_is_seen_by_the_drive() -> None:
    """In each ramp alike, so no branch differs from another of its direction: only rising from falling."""
    result = wrong_pass._judged(CASES["angle late within"], 0.05, "whole run", [limited("lost_motion")])
    assert [check.id for check in result.checks if check.passed is False] == ["drive_angle_direction"]


def test_with_the_budget_no_larger_size_is_tried_than_passes_without(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[float] = []

    def passes(_: Case, size: float, shown: str) -> tuple[list[str], bool]:
        if shown == BUDGET:
            tried.append(abs(size))
        return (["m"] if abs(size) <= (0.1 if shown == BUDGET else 0.3) else []), True

    monkeypatch.setattr(wrong_pass, "_passes", passes)
    found = found_of(Case("made", "1", 1.0))
    assert set(found) == set(SHOWN)
    assert max(tried) <= abs(found["whole run"].size)
    assert found[BUDGET].size == pytest.approx(0.1, rel=0.1)
    monkeypatch.setattr(wrong_pass, "_passes", lambda *_: ([], False))
    assert found_of(Case("made", "1", 1.0))[BUDGET] == Passed(None, "", disguises=False)


def test_table_has_every_defect_and_goes_into_its_place(tmp_path: Path) -> None:
    now = {name: dict.fromkeys(SHOWN, Passed(None, "", disguises=True)) for name in CASES}
    page = tmp_path / "page.md"
    page.write_text("above\n<!-- wrong passes -->\nold\n<!-- end of wrong passes -->\nbelow\n", encoding="utf-8")
    put(page, "wrong passes", table(now, {}))
    found = page.read_text(encoding="utf-8")
    assert found.startswith("above\n")
    assert found.endswith("below\n")
    assert "old" not in found
    for case in CASES.values():
        assert f"| {case.text} |" in found
    with pytest.raises(ValueError, match=r"page\.md"):
        put(page, "another", "")
