from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from made_documents import alarm, metric, timing

from analysis.evaluation.pipeline import Curves, Result
from analysis.evaluation.verdict import Verdict
from analysis.loop.branches import Branch
from analysis.loop.method import Decision
from definitions.image import State
from definitions.program import Program
from recipes import shipped_recipes
from station.bench.request import load_job
from station.records.samples.history import History, history_of
from station.records.samples.layout import CURRENT
from station.records.samples.table import Table
from station.reports.figures.loop_plot import in_lines, loop_figure, png
from station.reports.figures.stiffness_plot import stiffness_figure
from station.reports.figures.time_plot import BANDS, time_figure
from station.reports.figures.timing_plot import timing_figure
from station.results.evaluation import method_of

JOB = load_job(str(shipped_recipes()["rv-40e-121-quick"]), None)
PROGRAM: Program = JOB.program


def history(alarm_s: float | None = 7.0) -> History:
    time_s = np.arange(0.0, 8.0, 0.001)
    state = np.where(time_s < 7.0, int(State.CALIBRATE), int(State.FAULT))
    torque = np.where(time_s < 7.0, 60.0 * time_s, -5.0)
    return History(time_s, torque, torque / 100, torque * 1e-4, state, alarm_s, "Guard opened")


def test_the_history_goes_on_to_the_last_scan() -> None:
    rows = np.zeros(6, dtype=CURRENT.dtype)
    table = Table(rows)
    rows["scan"] = range(6)
    rows["orders"]["state"] = [State.HOME, State.LOCK, State.RAMP_POS, State.UNLOAD, State.FAULT, State.FAULT]
    rows["image"]["sample_counter"] = [1, 2, 3, 4, 5, 5]
    rows["image"]["torque_out_nm"] = [0, 1, 2, 3, 4, 4]
    rows["orders"]["torque_out_tare_nm"] = 0.5
    rows["image"]["angle_out_rad"] = 1e-4
    found = history_of(table, PROGRAM, angle_out=True, alarm=alarm(t_s=0.004))
    assert found is not None
    assert found.torque_nm.tolist() == [0.5, 1.5, 2.5, 3.5]
    assert found.state.tolist()[-1] == State.FAULT
    assert found.alarm_index == 3
    assert found.locked_arcmin == pytest.approx([1e-4 * 10800 / np.pi] * 4)
    assert history_of(table[:1], PROGRAM, angle_out=True, alarm=None) is None


def test_thinning_keeps_every_sample_around_the_alarm() -> None:
    kept = history().thinned(100)
    assert set(range(6990, 7090)) <= set(kept.tolist())
    assert kept.size < 400
    assert history(None).thinned(100).size == 100


def test_every_state_has_a_band() -> None:
    assert set(BANDS) == set(State)


def test_the_time_picture_shows_the_alarm_and_its_surroundings() -> None:
    figure = time_figure(history(), "SN1")
    assert len(figure.axes) == 4
    assert "Guard opened" in [text.get_text() for axes in figure.axes for text in axes.texts]
    assert len(time_figure(history(None), "SN1").axes) == 2


def test_the_words_of_the_alarm_stay_below_the_curve_and_within_the_picture() -> None:
    text = "Locked shaft moves more than allowed while the lock is closed"
    long = dataclasses.replace(history(2.5), alarm_text=text)
    figure = time_figure(long, "SN1")
    whole = figure.axes[0]
    (words,) = [one for one in whole.texts if "Locked shaft" in one.get_text()]
    figure.draw_without_rendering()
    box = words.get_window_extent().transformed(whole.transData.inverted())
    assert words.get_text().split() == text.split()
    assert box.y1 < long.torque_nm.min()
    assert box.x1 <= whole.get_xlim()[1]


def test_the_loop_without_an_analysis_shows_all_samples_and_the_alarm() -> None:

    figure = loop_figure(history(), None, method_of(JOB.recipe, JOB.bench), "SN1")
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert labels == ["all samples", "alarm", "last scan"]
    torque = figure.axes[0].lines[0].get_xdata()
    assert min(torque) == -5.0


def test_the_picture_of_stiffness_shows_metrics_where_they_hold() -> None:
    torque = np.linspace(-450.0, 450.0, 901)
    branches = Branch(torque, torque / 100.0 - 0.2), Branch(torque, torque / 100.0 + 0.2)
    curves = Curves((branches[0],), (branches[1],), Branch(torque, torque / 100.0), None, ((torque[:0], torque[:0]),))
    result = Result((), Verdict.PASS, (), Decision(), curves, None, (), ())
    sides = {side: {"value": 100.0, "uncertainty": 0.5} for side in ("+", "-")}
    shown = [
        metric(id=name, side="+", limits={"min": 95.0}, sides=sides) for name in ("stiffness_lsq", "spring_constant")
    ]
    method = method_of(JOB.recipe, JOB.bench)
    figure = stiffness_figure(result, method, shown)
    assert figure is not None
    lines = {tuple(np.round(line.get_xdata(), 3)) for line in figure.axes[0].lines}
    assert {(82.4, 329.6), (-82.4, -329.6), (412.0,), (-412.0,)} <= lines
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert "stiffness_lsq\n100.00 and 100.00   (≥ 95)" in labels


def test_timing_is_drawn_where_it_was_measured() -> None:
    rows = [(1.0, 900), (20.5, 99), (1500.0, 1)]
    figure = timing_figure(timing(histograms_us={"lateness": rows, "work": rows}))
    assert figure is not None
    assert [sum(bar.get_height() for bar in axes.patches) for axes in figure.axes] == [1000, 1000]
    assert timing_figure(timing()) is None


@pytest.mark.parametrize("serial", ["SN $\\q$", "SN $x$", "N" * 128, "齿" * 128])
def test_a_unit_of_any_name_has_its_pictures_with_that_name(serial: str) -> None:
    told = dataclasses.replace(history(), alarm_text=f"{serial} stopped")
    loop, time = loop_figure(told, None, method_of(JOB.recipe, JOB.bench), serial), time_figure(told, serial)
    assert png(loop)
    assert png(time)
    shown = loop.axes[0].get_title(loc="left")
    assert shown.replace("\n", "") == serial
    assert time.get_suptitle() == shown
    for figure in (loop, time):
        assert figure.axes[0].get_window_extent().width > 0.3 * figure.bbox.width, "the title leaves no room"


def test_a_title_that_has_room_stays_as_it_is() -> None:
    for title in ("PASS\nSN 1  rv-40e-121-quick revision 2", " a  b ", "N" * 84, "齿" * 42):
        assert in_lines(title) == title
