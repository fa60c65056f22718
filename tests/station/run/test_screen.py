from __future__ import annotations

import io
from dataclasses import replace

import pytest
from closed_pipe import read_by_nobody
from hypothesis import given
from hypothesis import strategies as st
from made_documents import alarm, metric, result
from rich.console import Console
from station_samples import IMAGE, ORDERS

from definitions.faults import FAULTS
from definitions.image import State
from definitions.states import row_of
from drivers.servo_drive.emcy import DRIVE_ALARMS
from station.bench.request import load_job
from station.cli.terminal_plot import Canvas, nice_ceiling, plot
from station.documents.events import Alarm
from station.documents.result import Limits
from station.records.samples.scan_record import pack
from station.reports.metric_sides import all_rows, judging_rows
from station.reports.result_text import limits_text, metric_name, number, uncertainty_text
from station.reports.result_view import alarm_lines
from station.run.screen.live import LiveReader, LiveView, alarm_texts
from station.run.screen.progress import STATE_COLOURS, Progress, clock, panel, signed


def test_every_state_has_words_and_a_colour() -> None:
    assert set(STATE_COLOURS) == set(State)


def test_every_alarm_has_its_words() -> None:
    for fault in FAULTS:
        assert alarm_texts(1 << fault.number) == (f"{fault.text}. {fault.next_action}.",)


@pytest.mark.parametrize("state", list(State))
def test_the_panel_shows_state_torque_cycle_and_alarms(state: State) -> None:
    view = LiveView(state, row_of(state).words, -123.4, 1.25, 2, 3, 0.5, 75.0, 12.0, ("Guard opened. Close it.",))
    stream = io.StringIO()
    Console(file=stream, width=80).print(panel(view, "SN1"))
    text = stream.getvalue()
    for part in (state.name.replace("_", " "), "−123.4 N·m", "+1.250 ′", "2 of 3", "1:15", "Guard opened"):
        assert part in text


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("unit", ["SN[/1]", "SN[bold]", "SN:one:", "[SN]"])
def test_brackets_and_colons_of_a_unit_are_shown_as_they_are_and_end_no_run(unit: str) -> None:
    job, stream = load_job("rv-40e-121-quick", None), Terminal()
    with Progress(LiveReader(job.program, angle_out=True), unit, stream) as progress:
        progress.show(pack((0, 0, 0, 0), IMAGE, ORDERS))
        progress.say(f"record  /data/{unit}/run")
    assert f" {unit} " in stream.getvalue()
    assert f"/data/{unit}/run" in stream.getvalue()


def test_a_run_does_not_end_with_the_pipe_that_shows_it() -> None:
    job = load_job("rv-40e-121-quick", None)
    with read_by_nobody() as stream, Progress(LiveReader(job.program, angle_out=True), "SN1", stream) as progress:
        progress.say("SN1")
        progress.show(pack((0, 0, 0, 0), IMAGE, ORDERS))


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
    assert lines[4].startswith("−100")
    top, bottom = lines[0].split("┤")[1], lines[4].split("┤")[1]
    assert any(cell != blank for cell in top[:10])
    assert all(cell == blank for cell in top[10:])
    assert any(cell != blank for cell in bottom[10:])
    assert lines[-1].split() == ["N·m", "0", "1", "2", "3", "4", "s"]


def test_a_plot_fits_its_data_and_can_be_plain() -> None:
    text = plot([(0, 0), (80, 453.2), (160, -453.2)], ("s", "N·m"), plain=True)
    lines = text.splitlines()
    assert lines[0].startswith("+453.2")
    assert not any(ord(sign) >= 0x2800 for sign in text)
    assert lines[0].split("┤")[1].strip()
    assert lines[-1].split() == ["N·m", "0", "50", "100", "150", "s"]


@pytest.mark.parametrize(
    ("value", "text"), [(None, "–"), (0.94, "0.94"), (104.7049, "104.7"), (1234.6, "1235"), (0.0, "0")]
)
def test_numbers_are_short(value: float | None, text: str) -> None:
    assert number(value) == text


def test_limits_are_said_as_people_say_them() -> None:
    assert limits_text(Limits(min=None, max=1.0)) == "≤ 1"
    assert limits_text(Limits(min=108.0, max=None)) == "≥ 108"
    assert limits_text(Limits(min=25.0, max=31.0)) == "25 … 31"
    assert limits_text(Limits(min=None, max=None)) == ""


def test_values_are_rounded_to_their_uncertainty() -> None:
    assert number(0.94023678, 0.00067068) == "0.94024"
    assert number(-13.9512, 0.0793) == "−13.951"
    assert number(448.92, 12.0) == "449"
    assert number(0.5, 3.0) == "0.5"
    assert number(0.04507, 0.24) == "0.05"
    assert uncertainty_text(metric(uncertainty=0.00067068, value=1.0)) == "± 0.00067"
    assert uncertainty_text(metric(value=1.0, cycles=1)) == "no uncertainty: needs two cycles"
    assert uncertainty_text(metric(value=None, cycles=1)) == ""


def test_the_side_that_judges_is_shown_and_the_report_has_both() -> None:
    sides = {
        "+": {"value": 115.0, "uncertainty": None, "verdict": "PASS"},
        "-": {"value": 45.0, "uncertainty": None, "verdict": "FAIL"},
    }
    limits = {"min": 108.0, "max": None}
    found = metric(id="spring_constant", side="+", value=115.0, verdict="FAIL", sides=sides, limits=limits)
    (judging,) = judging_rows([found])
    assert (metric_name(judging), judging.value, judging.verdict) == ("spring_constant side −", 45.0, "FAIL")
    assert [row.side for row in all_rows([found])] == ["-", "+"]


def test_of_two_sides_in_order_the_one_nearer_to_its_limit_judges() -> None:
    sides = {side: {"value": value, "uncertainty": None, "verdict": "PASS"} for side, value in (("+", 0.8), ("-", 0.9))}
    found = metric(id="backlash_width_3pct", branch="width", side="+", value=0.8, verdict="PASS", sides=sides)
    assert judging_rows([replace(found, limits=Limits(max=1.0))])[0].side == "-"
    assert judging_rows([replace(found, limits=Limits(min=0.5))])[0].side == "+"
    assert judging_rows([replace(found, limits=Limits())])[0].side == "+"


def named(name: str, reaction: str, *, first: bool = False) -> Alarm:
    words = {"text": f"text of {name}", "cause": "cause", "next_action": f"mend {name}"}
    return alarm(id=name, reaction=reaction, first=first, t_s=1.0, **words)


def test_each_alarm_is_printed_once_and_the_first_cause_is_marked() -> None:
    alarms = [named("late", "hold"), named("guard", "quick_stop", first=True), named("late", "hold")]
    lines = alarm_lines(result(alarms=alarms))
    assert [line.plain for line in lines] == [
        "note   1.000 s  text of late, 2 times. mend late",
        "ALARM  1.000 s  text of guard  ◀ first cause",
    ]
    assert "red" not in str(lines[0].style)


def test_what_the_drive_says_stands_with_its_alarms() -> None:
    for fault in FAULTS:
        (text,) = alarm_texts(1 << fault.number, 0x7121)
        assert ("emergency code 0x7121: motor blocked" in text) == (fault.id in DRIVE_ALARMS)
    alarms = [replace(named("late", "quick_stop"), detail="emergency code 0x7121: motor blocked; check the unit")]
    (line,) = alarm_lines(result(alarms=alarms))
    assert line.plain.endswith("mend late. Emergency code 0x7121: motor blocked; check the unit")


def test_every_alarm_that_an_emergency_code_explains_is_one() -> None:
    assert {fault.id for fault in FAULTS} >= DRIVE_ALARMS


def test_ramps_are_named_by_where_they_go() -> None:
    program = load_job("recipes/rv-40e-121-quick.yaml", None).program
    index = next(one.index for one in program.segments if one.state is State.RAMP_NEG)
    orders = ORDERS._replace(state=int(State.RAMP_NEG), segment=index, cycle=1, alarms=1 << 39 | 1 << 2)
    view = LiveReader(program).read(pack((0, 0, 0, 0), IMAGE, orders))
    assert view.words == f"loading towards −{abs(program.segments[index].target_nm):.0f} N·m"
    assert [text.split(".")[0] for text in view.alarms] == ["Guard opened"]
    assert [text.split(".")[0] for text in view.notes] == ["Torque and angle samples are late"]


def test_a_torque_that_is_not_known_is_not_shown() -> None:
    program = load_job("recipes/rv-40e-121-quick.yaml", None).program
    stale = IMAGE._replace(sample_age_scans=program.limits.sample_stale_scans + 1)
    for image, known in ((IMAGE, True), (stale, False)):
        view = LiveReader(program).read(pack((0, 0, 0, 0), image, ORDERS))
        assert ((view.torque_nm is not None), (view.windup_arcmin is not None)) == (known, known)
    assert signed(None, 1) == "–"
    assert signed(-0.25, 1) == "−0.2"


def test_time_left_is_minutes_and_seconds() -> None:
    assert [clock(seconds) for seconds in (-1, 0, 59.6, 61, 3600)] == ["0:00", "0:00", "1:00", "1:01", "60:00"]
