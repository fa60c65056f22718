"""Languages: every text of the operator's page has one in each, with the same place holders, and values keep theirs."""

from __future__ import annotations

import ast
import inspect
import itertools
import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, cast, get_args

import pytest
from station_support import PASSWORD, client_of, write_models
from test_start_permission import cases

from analysis.evaluation.evaluate import _because, judged_spread
from analysis.evaluation.metric_result import SideValue
from analysis.evaluation.verdict import Verdict
from analysis.line.capability import capability
from analysis.line.control_chart import SpreadKind, control_chart
from analysis.line.run_rules import RULES
from analysis.trace.errors import AnalysisError
from analysis.uncertainty import left_open
from analysis.uncertainty.budget import Budget, BudgetRow
from analysis.uncertainty.scatter import COVERAGES, coverage_of
from definitions.faults import FAULT_BY_NUMBER, Fault
from definitions.image import State
from definitions.jog import PHASES
from definitions.metrics import METRICS
from definitions.states import row_of
from recipes import MetricWanted
from station.documents.manifest import INJECTED, SIMULATED, STATES
from station.quality.bench_ability import due_on
from station.records.certificate_code import CodeError, check_code
from station.records.clocks import CLOCK_TEXTS
from station.records.data_folder import Store
from station.records.master_parts import AS_IT_SHOULD, GOOD_ONE_FAILED, NOT_AS_IT_SHOULD, NOT_MEASURED
from station.records.seal import NOT_READ
from station.reports.content import PASSED
from station.reports.headline import BENCH_FAULT, FAULTS_INJECTED, STOPPED_BY
from station.web.actions.jog import NO_JOG
from station.web.labels.outbox import NOT_MADE, PRINTED, SENT, TO_PRINT, Awaited
from station.web.labels.printer import TROUBLES
from station.web.languages import ENGLISH, HOLDER, LANGUAGES, Words, messages, words_of
from station.web.models import load_models
from station.web.pages import (
    certificates,
    frame,
    jog,
    loop_figure,
    maintenance,
    operator,
    operator_text,
    people,
    quality_figures,
    results,
    run,
    run_text,
    words,
)
from station.web.pages.operator import enter_page
from station.web.pages.quality import ability_text, batch, bench, parts, studies, trial, trial_html
from station.web.pages.quality import page as quality_page
from station.web.pages.recipes import diff, dry_run_html, editor, load_curve, revisions
from station.web.pages.recipes import page as recipes_page
from station.web.pages.words import Shown, attempts_said, on_page, reason_said, refusal_said
from station.web.people.accounts import ROLES, chosen_language
from station.web.people.accounts import WRONG as WRONG_PASSWORD
from station.web.people.badges import WRONG as WRONG_BADGE
from station.web.people.listed import CLOSED, FIRST, LOCKED, OPEN
from station.web.permission import Situation, Wanted, refusals, situation_of
from station.web.recipe_text.check import LookedAt
from station.web.scanner_test import CAPS_LOCK, LAYOUT, OTHER
from station.web.station import Station

OTHERS = [one for one in LANGUAGES if one != ENGLISH]
LOOKING_UP = ("say", "say.counted", "self._words", "self._words.counted")
READ_BY_THE_BROWSER = {"classes", "props", "style", "on", "run_javascript", "page", "element", "TypeVar"}
SHOWING = {"label", "button", "input", "number", "select", "tab", "link", "set_text", "set_content", "card"}
ALL_LOOKED_UP = (
    certificates, diff, dry_run_html, editor, load_curve, recipes_page, revisions, quality_figures, ability_text, batch,
    bench, parts, quality_page, studies, trial, trial_html,
)  # fmt: skip
"""Modules of pages in which every text is looked up."""


def shown() -> list[str]:
    """Return the texts of the tile: words and what to do, of each verdict, stage and state."""
    rows = [one for one in vars(words).values() if isinstance(one, Shown)]
    rows += [one for table in (words.VERDICTS, words.ENDINGS) for one in table.values()]
    texts = {text for row in rows for text in (row.word, row.to_do)}
    return sorted(texts | {row_of(state).words for state in State})


def said(module: object) -> list[str]:
    """Return the texts that a page gives to its words as they stand in its source."""
    calls = [node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.Call)]
    named = [one for one in calls if ast.unparse(one.func) in LOOKING_UP]
    return [text.value for one in named for text in one.args if isinstance(text, ast.Constant) and text.value]


def titles(module: object) -> list[str]:
    """Return the texts that a page gives to what it builds its fields, buttons and cards by."""
    calls = [node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.Call)]
    named = [one for one in calls if ast.unparse(one.func) in ("self._input", "self._button", "self._card")]
    return [one.args[0].value for one in named if isinstance(one.args[0], ast.Constant)]


def unsaid(node: ast.AST, *, shown: bool = False) -> Iterator[str]:
    """Yield the texts below a node that are not given to what looks them up; shown: it is given to what shows it."""
    if isinstance(node, ast.Constant | ast.JoinedStr):
        parts = getattr(node, "values", [node])
        text = "".join(str(part.value) if isinstance(part, ast.Constant) else "0" for part in parts)
        if _is_read(text, shown=shown) and isinstance(getattr(node, "value", ""), str):
            yield text
    called = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
    last = called.rpartition(".")[2]
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return  # a docstring
    unread = last in READ_BY_THE_BROWSER or (last == "replace" and "." in called)
    for child in [node.func] if isinstance(node, ast.Call) and unread else ast.iter_child_nodes(node):
        whole = isinstance(child, ast.Constant) and (called in LOOKING_UP or isinstance(node, ast.JoinedStr))
        if not whole:
            first = isinstance(node, ast.Call) and (child in node.args[:1] or getattr(child, "arg", "") == "label")
            kept = isinstance(node, ast.keyword | ast.IfExp) and shown
            yield from unsaid(child, shown=kept or (first and last in SHOWING))


def _is_read(text: str, *, shown: bool) -> bool:
    """Say whether a text has words for a person: between marks of HTML any, else more than one or a capital letter."""
    bare = re.sub(r"<[^>]*>?|^[^<]*>|&\w+;", " ", text)
    words = re.findall(r"(?<![\w.#-])[A-Za-z]{2,}(?![\w-])", bare)
    if not words or text.startswith(("/", "(params", "params =>")):
        return False
    return shown or bare != text or " " in text.strip() or re.match("[A-Z][a-z]", text) is not None


def of_a_jog() -> list[Fault]:
    """Return the faults that may come up while somebody jogs, from its begin to its end."""
    own = {"enabling_device_stuck", "jog_not_stopped", "drive_enable_timeout", "devices_not_ready"}
    return [one for one in FAULT_BY_NUMBER.values() if State.JOG in one.live_in or one.id in own]


TEXTS = [
    *shown(), *said(operator), *said(operator_text), *said(results), *said(frame),
    *(one["headerName"] for one in results.COLUMNS),
    *(name.capitalize() for name in frame.PAGES), *ROLES, *operator.RETEST_REASONS, operator.PUT_AWAY,
    operator.LABEL_READ, operator.LABEL_FIRST, operator.PRINT_AGAIN,
    operator.CONFIRMED_BY, operator.SCAN_NEXT, operator.SCAN_AGAIN, operator.NO_BAD_UNIT,
    operator.NOT_TAKEN, operator.TYPED, operator.STOP, operator.STOPPING,
    AS_IT_SHOULD, GOOD_ONE_FAILED, NOT_AS_IT_SHOULD, NOT_MEASURED,
    operator.CAPS_LOCK_ON, operator.SCANNER_TESTED, CAPS_LOCK, LAYOUT, OTHER, WRONG_BADGE, WRONG_PASSWORD,
    "torque", "wind-up", "time left",
    *said(run), *said(run_text), *said(loop_figure), *run.FILE_WORDS.values(), run_text.RESTORE, *CLOCK_TEXTS.values(),
    *PASSED.values(), *STOPPED_BY.values(), FAULTS_INJECTED, BENCH_FAULT,
    *said(maintenance), *maintenance.BUTTONS.values(), *maintenance.SAID, maintenance.LOADING, maintenance.NOBODY_SAW,
    *said(jog), *said(people), *titles(people), *people.COLUMNS, *people.DONE.values(),
    OPEN, FIRST, LOCKED, CLOSED, "yes", "no",
    *jog.KEYS.values(), *jog.TOLD, *jog.WORDS.values(), *jog.SHARES.values(), jog.MAY_JOG,
    *(text for one in (jog.NO_JOG, jog.STARTS) for text in (one.words, one.next_action)),
    "released", "pressed", "not known", "Fault", "Wait", "at most 2.5 rpm",
    *(text for row in PHASES for text in (row.words, row.next_action)), NO_JOG,
    *(text for fault in of_a_jog() for text in (fault.text, fault.next_action)),
    *(text for module in ALL_LOOKED_UP for text in said(module)),
    *(text for one in certificates.STANDINGS.values() for text in (one.word, one.to_do)),
    *(one["headerName"] for one in recipes_page.COLUMNS), *(word for _, word in diff.KINDS.values() if word),
    *(state.upper() for state in STATES if state not in ("recording", "complete")), *revisions.DID.values(),
    *quality_page.TREND_BY.values(), *(rule.text for rule in RULES.values()), *get_args(SpreadKind),
]  # fmt: skip


@pytest.fixture(scope="module")
def allowed(tmp_path_factory: pytest.TempPathFactory) -> Situation:
    data = tmp_path_factory.mktemp("languages") / "runs"
    write_models(data)
    return situation_of(data, load_models(data, None), Wanted("SN-1"), busy=False, confirmed=frozenset())


@pytest.mark.parametrize("language", OTHERS)
def test_what_stands_of_a_label_has_one_in_each_language(language: str) -> None:
    stages = [(stage, "") for stage in (TO_PRINT, SENT, PRINTED)]
    for stage, trouble in (*stages, (NOT_MADE, "why"), *((TO_PRINT, why) for why in TROUBLES.values())):
        text = str(Awaited("R", "SN-1", stage, trouble))
        said = words_of(language)(text)
        assert said != text, text
        assert "SN-1" in said
        assert trouble == "why" or not trouble or trouble not in said


@pytest.mark.parametrize("language", OTHERS)
def test_every_text_of_the_pages_has_one_in_each_language(language: str) -> None:
    there = messages(language)
    assert [text for text in TEXTS if not there.get(text) and words_of(language)(text) == text] == []
    parts = re.findall(r'say\("(.+?)"', (frame.HERE / "jog.html").read_text("utf-8"))
    assert len(parts) > 4
    assert [text for text in parts if not there.get(text)] == []
    parts = re.findall(r'say\("(.+?)"', (frame.HERE / "run.html").read_text("utf-8"))
    assert len(parts) > 12
    assert [text for text in parts if not there.get(text)] == []
    entered = re.findall(r"\{\{(.+?)\}\}", (frame.HERE / "enter.html").read_text("utf-8"))
    assert len(entered) > 8
    assert [text for text in entered if not there.get(text)] == []


@pytest.mark.parametrize("module", ALL_LOOKED_UP, ids=lambda module: module.__name__.removeprefix("station.web."))
def test_no_text_of_a_page_is_shown_without_being_looked_up(module: ModuleType) -> None:
    """What stands in a table of the module is looked up where it is shown: it has to have a translation."""
    body = ast.parse(inspect.getsource(module)).body
    tables = [one for one in body if isinstance(one, ast.Assign | ast.AnnAssign)]
    assert [text for one in body if one not in tables for text in unsaid(one)] == []
    there = set.intersection(*(set(messages(language)) for language in OTHERS))
    assert [text for one in tables for text in unsaid(one) if text not in there] == []


@pytest.mark.parametrize("language", OTHERS)
def test_every_reason_of_a_refused_start_has_one_in_each_language(
    allowed: Situation, monkeypatch: pytest.MonkeyPatch, language: str
) -> None:
    say = words_of(language)
    for name, situation in cases(allowed, monkeypatch).items():
        ((_, why),) = refusals(situation)
        assert say(why) != why, f"{name}: {why}"


@pytest.mark.parametrize("language", OTHERS)
def test_what_a_code_of_a_certificate_is_has_one_in_each_language(tmp_path: Path, language: str) -> None:
    with pytest.raises(CodeError) as found:
        check_code(tmp_path, "SN-1")
    for text in (str(found.value), check_code(tmp_path, f"LM1.{'0' * 64}.X").text):
        assert words_of(language)(text) != text


@pytest.mark.parametrize("language", OTHERS)
def test_every_refusal_of_a_jog_or_an_account_has_one_in_each_language(station: Station, language: str) -> None:
    """What the actions of the two pages refuse, asked for as anybody might."""
    say, said = words_of(language), list[str]()
    asked = (
        ("begin_jog", {"model": "no such"}), ("hold_jog", {"direction": 1}), ("release_jog", {}), ("end_jog", {}),
        ("press_device", {"down": True}), ("add_person", {"name": " x", "role": "operator", "password": "long enough"}),
        ("add_person", {"name": "x", "role": "operator", "password": "short"}),
        ("add_person", {"name": "the mes", "role": "operator", "password": "long enough"}),
        ("assign_badge", {"name": "nobody", "badge": "B-100001", "pin": "8305"}),
        ("assign_badge", {"name": "the mes", "badge": "B", "pin": "8305"}),
        ("assign_badge", {"name": "the mes", "badge": "B-100001", "pin": "1234"}),
        ("assign_badge", {"name": "the mes", "badge": "B-100001", "pin": "x"}),
        ("withdraw_badge", {"name": "the mes"}), ("disable_person", {"name": "the admin"}),
        ("reset_person", {"name": "the admin", "password": "long enough"}),
        ("disable_person", {"name": "nobody"}), ("change_pin", {"password": "wrong", "pin": "8305"}),
        ("change_pin", {"password": PASSWORD, "pin": "8305"}),
        ("change_password", {"old_password": "wrong", "new_password": "long enough"}),
    )  # fmt: skip
    found = client_of(station, "admin")
    for action, values in asked:
        answer = found.post(action, values)
        assert answer.status_code != 200, action
        said += [one["text"] for one in answer.json()["refused"]]
    refused = client_of(station, "operator").post("assign_badge", {"name": "x", "badge": "B-100001", "pin": "8305"})
    said += [refused.json()["refused"][0]["text"]]
    assert [text for text in said if say(text) == text] == []


def test_no_message_has_lost_or_invented_a_place_holder() -> None:
    catalogues = [messages(language) for language in OTHERS]
    assert len({tuple(one) for one in catalogues}) == 1, "all languages have the same messages"
    for there in catalogues:
        assert there
        for text, becomes in there.items():
            assert sorted(HOLDER.findall(text)) == sorted(HOLDER.findall(becomes)), text
            assert len(set(HOLDER.findall(text))) == len(HOLDER.findall(text)), text


def test_values_are_taken_over_as_they_are() -> None:
    say = Words("de")
    text = "No model has serial numbers like '{serial}'. Scan the label of the unit, or call the technician."
    filled = text.replace("{serial}", "a.*'{b}")
    assert "'a.*'{b}'" in say(filled)
    assert say(text, serial="SN-1") == say(text.replace("{serial}", "SN-1"))
    assert say("what nobody has translated") == "what nobody has translated"
    assert Words(ENGLISH)(filled) == filled
    assert Words("xx").language == ENGLISH
    assert [say("1 run."), say("26 runs."), say("Look at the runs.")] == [
        "1 Prüfung.", "26 Prüfungen.", "Look at the runs.",
    ]  # fmt: skip
    counted = ("{count} run.", "{count} runs.")
    assert [say.counted(number, *counted) for number in (1, 2)] == ["1 Prüfung.", "2 Prüfungen."]


@pytest.mark.parametrize("language", OTHERS)
def test_a_message_in_a_place_holder_is_said_too_and_a_name_is_not(language: str) -> None:
    say = words_of(language)
    record = "The record is not as it was when the run was concluded: {reason}."
    ways = (
        "was added after the run was concluded", NOT_READ,
        "was changed after the run was concluded: 7 bytes instead of 6",
    )  # fmt: skip
    for how in ways:
        said = say(record.format(reason=f"result.json: {how}"))
        assert "result.json" in said
        assert not re.search(r"\b(was|run|is|bytes)\b", said), said
    assert "measured" in say("Unit {serial} failed.".format(serial="measured"))


@pytest.mark.parametrize("language", OTHERS)
def test_what_a_lot_is_too_small_for_is_said_in_each_language(language: str) -> None:
    say = words_of(language)
    for values, make in itertools.product(([], [1.0], [1.0] * 10), (control_chart, partial(capability, upper=2.0))):
        with pytest.raises(AnalysisError) as found:
            make(values)
        assert say(str(found.value)) != str(found.value)


@pytest.mark.parametrize("language", OTHERS)
def test_a_cause_and_a_group_are_called_as_in_the_other_tables(language: str) -> None:
    say = words_of(language)
    side = say("side {side}", side="+")
    assert quality_figures.cause_title("backlash_width_3pct width side +", say) == say.whole(f"Backlash, {side}")
    assert quality_figures.cause_title("lost_motion mean side +", say) == say.whole(f"Lost motion, {side}")
    assert " to " not in say("14:00 to 22:00") + say("030° to 060°")


@pytest.mark.parametrize("language", OTHERS)
def test_one_day_one_verdict_and_one_value_are_not_many(language: str) -> None:
    say, day = words_of(language), datetime(2026, 1, 1, tzinfo=UTC)
    bench: Any = SimpleNamespace(bench=SimpleNamespace(name="B"), calibrations=(), master_parts=())
    bench.fixture = SimpleNamespace(curve=SimpleNamespace(id="F-1", due=day.date() + timedelta(days=1)))
    for moved in (0, 2):
        (due,) = due_on(Store(Path()), bench, day + timedelta(days=moved))
        assert re.search(r"\b1 day\b", due.text)
        assert not re.search(r"\b(day|Tagen)\b", say(due.text))
    for one, more in (trial_html.FLIP, trial_html.FLIP_BY_DEFINITION):
        assert messages("de")[one] != messages("de")[more]
    for limits, by in itertools.product(("no limit", "≤ 1 arcmin"), ("", " (recipe revision 2)")):
        text = f"Backlash: 1 of 5 values was tested by {limits}{by}"
        assert not re.search(r"\b(was|of|by)\b", say(text))


@pytest.mark.parametrize("language", OTHERS)
def test_a_reason_on_trial_is_said_to_its_end(language: str) -> None:
    reason = (
        "1 arcmin is too near to the limit of 1 arcmin for its uncertainty of 0.1 arcmin: it is neither PASS nor FAIL"
    )
    for more in ("and 1 further reason", "and 2 further reasons"):
        said = trial_html.why_said(f"Backlash: {reason}; measure more cycles; {more}", words_of(language))
        assert not re.search(r"\b(is|measure|and|further)\b", said), said


@pytest.mark.parametrize("language", LANGUAGES)
def test_what_a_study_is_refused_for_has_the_label_of_its_field(language: str) -> None:
    say = words_of(language)
    refused = {"parts": "List should have at least 1 item after validation, not 0"}
    refused |= {option: f"{option}: found 1; a gage study has 2 trials or more" for option in studies.OPTIONS}
    for name, text in refused.items():
        said = studies.refused_said(name, text, say)
        assert say(studies.FIELDS[studies.OPTIONS.get(name, name)]) in said
        assert not re.search("--|List should", said)
    assert "--" not in on_page("give one value for each --metric, in the same order")


def test_attempts_are_told_in_each_language_and_what_a_person_gave_as_a_reason_is_left() -> None:
    text = "attempt 4; attempt 1 FAIL Backlash, Lost motion; attempt 2 stopped; attempt 3 not concluded"
    assert attempts_said(text, words_of(ENGLISH)) == text
    assert attempts_said(f"{text}; measured again: seating; loose", words_of("de")) == (
        "Versuch 4; Versuch 1 NICHT IN ORDNUNG Backlash, Lost motion; Versuch 2 abgebrochen; "
        "Versuch 3 nicht abgeschlossen; erneut geprüft: seating; loose"
    )
    own = operator.RETEST_REASONS[0]
    assert attempts_said(f"attempt 2; measured again: {own}", words_of("de")).endswith(words_of("de")(own))
    for aside in (SIMULATED, INJECTED):
        assert aside not in attempts_said(f"attempt 1 {aside} PASS", words_of("zh"))
    for outcome in words.OUTCOMES:
        assert attempts_said(f"attempt 1 {outcome}", words_of("zh")) != f"attempt 1 {outcome}"
        assert outcome not in attempts_said(f"attempt 1 {outcome}", words_of("zh"))


@pytest.mark.parametrize("language", OTHERS)
def test_the_attempts_in_a_refused_retest_are_said_in_each_language(
    allowed: Situation, monkeypatch: pytest.MonkeyPatch, language: str
) -> None:
    for name in ("retest_reason", "attempts_left"):
        ((_, why),) = refusals(cases(allowed, monkeypatch)[name])
        said = refusal_said(why, words_of(language))
        assert "attempt" in why
        assert not re.search("attempt|FAIL|measured", said), said
        assert refusal_said(why, words_of(ENGLISH)) == why


def test_one_thing_has_one_name_in_a_catalogue_and_figures_have_the_sign_of_the_language() -> None:
    for language, others in (
        ("de", r"Abtrieb|Verdrehung|Zertifikat|Untergruppe|[Bb]ekannte\w* Wert|Kontrolle"),
        ("zh", "转矩|放行|标准件|样本值|已知值"),
    ):
        assert [text for text in messages(language).values() if re.search(others, text)] == []
    assert words_of("de").number("-1.25 N·m, ≥ 95") == "-1,25 N·m, ≥ 95"
    assert [words_of(one).number("1.25") for one in ("en", "zh")] == ["1.25", "1.25"]
    assert words_of("zh").whole("Backlash, + 侧: 受控。 平均值. 2.5; 3") == "Backlash, + 侧：受控。平均值。2.5; 3"
    assert [words_of(one).whole("a, b. c") for one in ("en", "de")] == ["a, b. c", "a, b. c"]
    assert [text for text in messages("zh").values() if re.search(r"[\u4e00-\u9fff] \(|\) [\u4e00-\u9fff]", text)] == []


@pytest.mark.parametrize("language", OTHERS)
def test_what_a_metric_out_of_its_limits_means_is_said_in_each_language(language: str) -> None:
    say = words_of(language)
    for meaning in {text for row in METRICS.values() for text in (row.bad.too_low, row.bad.too_high)}:
        for where in ("above", "below"):
            text = f"Backlash (loop width at ±3 % T_r), side +: 1.2 arcmin is {where} the limit of 1 arcmin: {meaning}"
            said = reason_said(text, say)
            assert "1.2 arcmin" in said
            assert meaning not in said, meaning
            assert where not in said


GAIN = "gain of the output torque sensor"
PLACES = [f"cycle {n}, {branch} branch, 1 to 2 N·m" for n in range(1, 4) for branch in ("rising", "falling")]
BUDGETS = [
    Budget((), 0.1, "budget"),
    *(
        Budget((BudgetRow(name, GAIN, "normal", 1.0, "1", 1.0, 0.1, 1.0),), 0.1, "budget")
        for name in ("x", left_open.OPEN)
    ),
    Budget((), 0.1, "budget", coverage=COVERAGES["interrupted"]),
    *(Budget((), 0.1, "budget", coverage=coverage_of(PLACES, holds)) for holds in (None, 0, 1, 2)),
    Budget((), 0.1, "budget", coverage=coverage_of([], 2)),
]


@pytest.mark.parametrize("language", OTHERS)
def test_a_reason_of_a_metric_is_in_one_language(language: str) -> None:
    """A contribution alone is named as in the report, and quoted."""
    row, wanted = METRICS["lost_motion"], MetricWanted(id="lost_motion", max=1.0, max_standard_deviation=0.1)
    texts = [f"lost_motion: {_because(wanted, 0.99, one, Verdict.NOT_DECIDABLE, 'max', '')}" for one in BUDGETS]
    beyond = f"lost_motion: {_because(wanted, 2.0, BUDGETS[0], Verdict.FAIL, 'max', '')}"
    fail = SideValue("both", 2.0, 0.1, 0.2, (1.0, 3.0), Verdict.FAIL, beyond)
    found = (fail, replace(fail, reason=""), replace(fail, standard_deviation=None, per_cycle=(1.0,)))
    texts += (judged_spread(wanted, row, one, invalid=False).reason for one in found)
    for text in texts:
        said = reason_said(text, words_of(language)).replace(GAIN, "")
        assert said.startswith("lost_motion")
        assert not re.search(r"\b(is|the|than|or|to|measure|ramp|branch|hold|ordered|cycles|above|needs)\b", said), said


def test_a_reason_of_a_failed_metric_is_said_in_both_forms() -> None:
    assert words_of("de")("Backlash: 1.2 arcmin, at most 1 arcmin") == "Backlash: 1.2 arcmin, höchstens 1 arcmin"


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_load_curve_has_room_for_the_word_at_its_line(language: str) -> None:
    say, looked = words_of(language), SimpleNamespace(job=object(), duration_s=60.0, peak_nm=453.2, rated_nm=412.0)
    assert re.search("110 %(?!%)", load_curve.load_text(cast("LookedAt", looked), say))
    options = load_curve.chart_options(say)
    width = sum(13 if ord(letter) > 255 else 8 for letter in options["series"][0]["markLine"]["label"]["formatter"])
    assert options["grid"]["right"] > width


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_page_for_logging_in_is_whole(language: str) -> None:
    page = enter_page(words_of(language))
    assert f'<html lang="{language}">' in page
    assert "{{" not in page
    assert "/* " not in page.partition("<script>")[0]
    for name in LANGUAGES.values():
        assert name in page
    assert "emitEvent" in page, "badges are scanned here too"


def test_a_person_keeps_the_language_they_chose(station: Station) -> None:
    assert client_of(station, "operator").post("choose_language", {"language": "zh"}).status_code == 200
    assert client_of(station, "operator").post("choose_language", {"language": "de"}).status_code == 200
    with station.database.reading() as connection:
        assert chosen_language(connection, "the operator") == "de"
        assert chosen_language(connection, "the quality") is None
