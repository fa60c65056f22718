from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from controller.faults import FAULTS
from controller.image import State
from station.live import STATE_WORDS, LiveView, alarm_texts
from station.progress import STATE_COLOURS, clock, panel
from station.result_view import limits_text, metric_name, number, shown_rows
from station.terminal_plot import Canvas, nice_ceiling, plot


def test_every_state_has_words_and_a_colour() -> None:
    assert set(STATE_WORDS) == set(STATE_COLOURS) == set(State)


def test_every_alarm_has_its_words() -> None:
    for fault in FAULTS:
        assert alarm_texts(1 << fault.number) == (f"{fault.text}. {fault.next_action}.",)


@pytest.mark.parametrize("state", list(State))
def test_the_panel_shows_state_torque_cycle_and_alarms(state: State) -> None:
    view = LiveView(state, STATE_WORDS[state], -123.4, 1.25, 2, 3, 0.5, 75.0, 12.0, ("Guard opened. Close it.",))
    stream = io.StringIO()
    Console(file=stream, width=80).print(panel(view, "SN1"))
    text = stream.getvalue()
    for part in (state.name.replace("_", " "), "-123.4 N·m", "+1.250 ′", "2 of 3", "1:15", "Guard opened"):
        assert part in text


@given(value=st.floats(min_value=1e-6, max_value=1e9))
def test_axis_ends_are_not_below_the_value_and_not_far_above(value: float) -> None:
    top = nice_ceiling(value)
    assert value * (1 - 1e-8) <= top <= 2.51 * value


def test_braille_dots_stand_where_they_are_set() -> None:
    canvas = Canvas(2, 1)
    canvas.dot(0, 0)
    canvas.dot(3, 3)
    canvas.dot(9, 9)
    assert canvas.rows() == ["⠁⢀"]


def test_a_plot_shows_peaks_on_their_sides() -> None:
    lines = plot([(0, 0), (1, 100), (3, -100), (4, 0)], ("s", "N·m"), columns=20, rows=5).splitlines()
    blank = chr(0x2800)
    assert lines[0].startswith("+100")
    assert lines[4].startswith("-100")
    top, bottom = lines[0].split("┤")[1], lines[4].split("┤")[1]
    assert any(cell != blank for cell in top[:10])
    assert all(cell == blank for cell in top[10:])
    assert any(cell != blank for cell in bottom[10:])
    assert "4 s" in lines[-1]


@pytest.mark.parametrize(
    ("value", "text"), [(None, "–"), (0.94, "0.94"), (104.7049, "104.7"), (1234.6, "1235"), (0.0, "0")]
)
def test_numbers_are_short(value: float | None, text: str) -> None:
    assert number(value) == text


def test_limits_are_said_as_people_say_them() -> None:
    assert limits_text({"min": None, "max": 1.0}) == "≤ 1"
    assert limits_text({"min": 108.0, "max": None}) == "≥ 108"
    assert limits_text({"min": 25.0, "max": 31.0}) == "25 … 31"
    assert limits_text({"min": None, "max": None}) == ""


def test_a_side_that_fails_beside_one_that_passes_is_shown() -> None:
    sides = {
        "+": {"value": 115.0, "uncertainty": None, "verdict": "PASS"},
        "-": {"value": 45.0, "uncertainty": None, "verdict": "FAIL"},
    }
    metric = {"id": "spring_constant", "branch": "mean", "side": "+", "value": 115.0, "verdict": "FAIL", "sides": sides}
    rows = shown_rows([metric])
    assert [(metric_name(row), row["value"], row["verdict"]) for row in rows] == [
        ("spring_constant +", 115.0, "PASS"),
        ("spring_constant −", 45.0, "FAIL"),
    ]


def test_time_left_is_minutes_and_seconds() -> None:
    assert [clock(seconds) for seconds in (-1, 0, 59.6, 61, 3600)] == ["0:00", "0:00", "1:00", "1:01", "60:00"]
