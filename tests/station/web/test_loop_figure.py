"""What the page of a run draws: the loop, others over it, and the torques marked that a bad metric is read at."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from made_documents import metric

from analysis.loop.method import Method
from analysis.metrics.estimators import LSQ_BAND, SECANT_BAND
from definitions.metrics import METRICS
from station.errors import StationError
from station.reports.loop_curves import Line, LoopCurves
from station.reports.metric_torques import torque_spans
from station.web.pages import live
from station.web.pages.live import LIFTED, Looks, drawn_points
from station.web.pages.loop_figure import Drawn, Marked, close_range, loop_figure, stiffness_figure
from station.web.running import ENDED

METHOD = Method(ratio=121.0, rated_torque_nm=400.0)


def spans(name: str, side: str, **more: object) -> tuple[tuple[float, float], ...]:
    return torque_spans(metric(id=name, side=side, **more), METHOD)


@pytest.mark.parametrize(
    ("name", "side", "more", "expected"),
    [
        ("backlash_width_3pct", "+", {"band": 0.03}, ((12.0, 12.0),)),
        ("backlash_width_3pct", "-", {"band": 0.03}, ((-12.0, -12.0),)),
        ("backlash_width_zero", "both", {"band": 0.0}, ((0.0, 0.0),)),
        ("lost_motion", "both", {"band": 0.05}, ((20.0, 20.0), (-20.0, -20.0))),
        ("gear_clearance", "both", {}, ((0.0, 0.0),)),
        ("stiffness_lsq", "-", {}, ((-320.0, -80.0),)),
        ("stiffness_50_100", "+", {}, ((200.0, 400.0),)),
        ("stiffness_at", "+", {"torque_nm": 150.0}, ((150.0, 150.0),)),
        ("spring_constant", "+", {}, ((390.0, 400.0),)),
        ("spring_constant", "-", {"choices": ("from",)}, ((-410.0, -400.0),)),
        ("k2", "+", {}, ((80.0, 280.0),)),
        ("hysteresis_energy", "both", {}, ((-400.0, 400.0),)),
        ("torque_ratio_slope", "+", {}, ()),
        ("no_such_metric", "+", {}, ()),
    ],
)
def test_a_metric_is_marked_where_its_definition_reads_it(
    name: str, side: str, more: dict[str, object], expected: tuple[tuple[float, float], ...]
) -> None:
    known: dict[str, object] = {"band": None, "torque_nm": None, "choices": ()}
    assert list(spans(name, side, **known | more)) == [pytest.approx(one) for one in expected]


def test_every_metric_of_the_loop_has_its_torques() -> None:
    for name, row in METRICS.items():
        found = spans(name, row.sides[0], band=None, torque_nm=None, choices=())
        assert bool(found) is not row.calibration, name
        assert all(-410.0 <= low <= high <= 410.0 for low, high in found), name


def test_spans_are_those_that_the_estimators_read() -> None:
    assert METRICS["stiffness_lsq"].span == METRICS["stiffness_two_point"].span == LSQ_BAND
    assert METRICS["stiffness_50_100"].span == SECANT_BAND


CURVES = LoopCurves(
    400.0,
    (Line("torque rising", (-400.0, 0.0, 12.0, 400.0), (-4.0, -0.5, -0.4, 4.0)),
     Line("torque falling", (-400.0, 0.0, 12.0, 400.0), (-4.0, 0.5, 0.6, None))),
    (Line("side +", (10.0, 390.0), (60.0, 110.0)),), (),
)  # fmt: skip
BACKLASH = Marked("Backlash, side +", "FAIL", ((12.0, 12.0),))


def test_others_are_told_apart_by_dashes_and_not_by_colour_alone() -> None:
    found = loop_figure(Drawn("this run", CURVES), [Drawn("attempt 1", CURVES), Drawn("golden", CURVES)], [BACKLASH])
    by_run = {(trace["name"], trace["line"]["dash"]) for trace in found["data"]}
    assert len(by_run) == len({dash for _, dash in by_run}) == 3
    assert sum(trace["showlegend"] for trace in found["data"]) == 3, "a run stands once in the legend"


def test_what_failed_is_marked_and_can_be_looked_at_closely() -> None:
    found = loop_figure(Drawn("this run", CURVES), [], [BACKLASH], close=True)
    (band,), (name,) = found["layout"]["shapes"], found["layout"]["annotations"]
    assert band["x0"] < 12.0 < band["x1"]
    assert name["text"] == "Backlash, side +"
    low, high = found["layout"]["xaxis"]["range"]
    assert 0.0 < low < 12.0 < high < 24.0
    bottom, top = found["layout"]["yaxis"]["range"]
    assert bottom < -0.4 < 0.6 < top < 4.0
    assert close_range(400.0, []) is None
    assert "range" not in loop_figure(Drawn("this run", CURVES), [], [], close=True)["layout"]["xaxis"]


def test_the_width_that_is_allowed_stands_about_the_middle_of_the_loop() -> None:
    found = loop_figure(Drawn("this run", CURVES), [], [replace(BACKLASH, allowed_arcmin=1.0)])
    (bar,) = [trace for trace in found["data"] if "error_y" in trace]
    assert (bar["x"], bar["y"], bar["error_y"]["value"]) == ([12.0], [pytest.approx(0.1)], 0.5)


def test_metrics_read_at_the_same_torques_share_a_band() -> None:
    also = replace(BACKLASH, name="Lost motion")
    found = loop_figure(Drawn("this run", CURVES), [], [BACKLASH, also])
    assert [one["text"] for one in found["layout"]["annotations"]] == ["Backlash, side +, Lost motion"]


def test_stiffness_is_marked_by_stiffnesses_alone() -> None:
    stiff = Marked("Spring constant", "NOT DECIDABLE", ((390.0, 400.0),), stiffness=True)
    found = stiffness_figure(Drawn("this run", CURVES), [], [BACKLASH, stiff])
    assert [one["text"] for one in found["layout"]["annotations"]] == ["Spring constant"]


def test_the_legend_stands_below_the_title_of_the_axis_in_a_low_picture_too() -> None:
    legend = stiffness_figure(Drawn("this run", CURVES), [], [])["layout"]["legend"]
    assert (legend["yref"], legend["y"], legend["yanchor"]) == ("container", 0, "bottom")


def test_names_are_text_in_the_picture() -> None:
    name = "<b>{x}</b>&amp;"
    found = loop_figure(Drawn(name, CURVES), [], [replace(BACKLASH, name=name)])
    shown = [trace["name"] for trace in found["data"]] + [one["text"] for one in found["layout"]["annotations"]]
    assert not any("<" in text or "{" in text for text in shown)
    assert "<b>" not in found["data"][0]["hovertemplate"]


def test_a_stored_loop_is_drawn_without_a_line_from_one_branch_to_the_next() -> None:
    found = drawn_points(CURVES)
    assert found[3:6] == ((400.0, 4.0), LIFTED, (-400.0, -4.0))
    assert found[-1] == (400.0, None)
    assert drawn_points(replace(CURVES, loop=())) == ()


@pytest.mark.parametrize(("failing", "drawn", "asked"), [(1, True, 2), (99, False, 4)])
def test_a_loop_that_could_not_be_read_is_read_again_a_few_times(
    monkeypatch: pytest.MonkeyPatch, failing: int, asked: int, *, drawn: bool
) -> None:
    monkeypatch.setattr(live, "READ_AGAIN_S", (0.0, 0.0, 0.0))
    monkeypatch.setattr(live, "LOOK_EVERY_S", 0.002)
    reads: list[object] = []

    def loop(run: object) -> Any:
        reads.append(run)
        if len(reads) <= failing:
            raise StationError("The server is busy with other reports.")
        return SimpleNamespace(loop=(SimpleNamespace(torque_nm=(1.0,), values=(2.0,)),))

    now = SimpleNamespace(stage=ENDED, result=object(), altered=(), run="R1", loop=())
    station = SimpleNamespace(
        data=Path(), running=SimpleNamespace(now=lambda: now), evaluations=SimpleNamespace(loop=loop)
    )

    async def looked() -> list[live.Points]:
        looks = Looks(cast("Any", station))
        return [(await looks.next())[1] for _ in range(60)]

    found = asyncio.run(looked())
    assert (found[0], found[-1]) == ((), ((1.0, 2.0),) if drawn else ())
    assert len(reads) == asked
