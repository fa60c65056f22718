"""Templates of labels: what one may hold, what is filled in, and never a command of the printer."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from label_setup import set_up
from stored_runs import metric, store_run
from zpl_printer import read_fields

from definitions.metrics import METRICS
from recipes import RecipeError
from station.documents.result import Result
from station.errors import StationError
from station.records.certificate_code import code_of
from station.records.run_record import RESULT
from station.web.labels.settings import FILE, load_labels
from station.web.labels.template import FIELDS, LabelError, Source, parse


@given(serial=st.text(st.characters(codec="utf-8"), min_size=1, max_size=24).filter(str.isprintable))
def test_no_value_is_a_command_of_the_printer(serial: str, plain_source: Source) -> None:
    manifest = dataclasses.replace(plain_source.manifest, serial=serial)
    text = "^XA^CI28^FO1,1^A0N,30^FH^FD{serial}^FS^FO1,50^FH^FDA_5F{verdict}^FS^XZ"
    template = parse(text, "t")
    label = template.fill(plain_source._replace(manifest=manifest))
    assert read_fields(label) == [serial, "A_PASS"]
    assert (label.count("^"), "~" in label) == (text.count("^"), False)


@pytest.fixture(scope="module")
def plain_source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    run = store_run(tmp_path_factory.mktemp("labels") / "runs", "SN-1", [metric(0.4)])
    return Source(run.manifest(), run.read(Result, RESULT), code_of(run))


def test_every_field_has_a_value(plain_source: Source) -> None:
    fields = "".join(f"^FH^FD{{{name}}}^FS" for name in (*FIELDS, "lost_motion"))
    found = read_fields(parse(f"^XA^CI28{fields}^XZ", "t").fill(plain_source))
    assert len(found) == len(FIELDS) + 1
    assert found[-1] == "0.4 arcmin"
    assert not set(FIELDS) & set(METRICS)


@pytest.mark.parametrize(
    ("template", "word"),
    [
        ("^XA^CI28^FH^FD{sirial}^FS^XZ", "sirial"),
        ("^XA^CI28^FD{serial}^FS^XZ", "^FH"),
        ("^XA^CI28^FH\\^FD{serial}^FS^XZ", "^FH"),
        ("^XA^CI28^FX{serial}^FH^FDx^FS^XZ", "^FD only"),
        ("^XA^CI28^FH^FDlot_ {serial}^FS^XZ", "_5F"),
        ("^XA^FH^FD{serial}^FS^XZ", "^CI28"),
        ("^XA^CI28^PQ2^FH^FD{serial}^FS^XZ", "^PQ"),
        ("^XA^CI28^Pq5^FH^FD{serial}^FS^XZ", "capitals"),
        ("^XA^CI28^PQ1,0,5^FH^FD{serial}^FS^XZ", "^PQ"),
        ("^XA^CI28^PQ01,1^FH^FD{serial}^FS^XZ", "^PQ"),
        ("^XA^CI28^CC+^FH^FD{serial}^FS^XZ", "^CC"),
        ("^XA^CI28^XFR:OLD^FS^XZ", "^XF"),
        ("~JA^XA^CI28^FH^FD{serial}^FS^XZ", "~"),
        ("^XA^CI28^FH^FD{serial}^FS", "^XZ"),
        ("^XA^CI28^FH^FD{serial}^FS^XZ^XA^XZ", "once"),
        ("^XA^CI28^FH^FD{serial}^FS^XZ rest", "after ^XZ"),
        ("^XA^CI28^FH^fd{serial}^FS^XZ", "capitals"),
        ("", "^XA"),
    ],
)
def test_a_template_that_could_print_something_else_is_refused(template: str, word: str) -> None:
    with pytest.raises(LabelError, match=r"label\.zpl") as refused:
        parse(template, "label.zpl")
    assert word in str(refused.value)


@pytest.mark.parametrize("quantity", ["", "1", "1,0", "1,0,1,Y", "1,,,N,Y"])
def test_a_template_may_say_that_it_is_one_label(quantity: str) -> None:
    assert parse(f"^XA^CI28^PQ{quantity}^FH^FD{{serial}}^FS^XZ", "t").parts


def test_what_a_bar_code_cannot_hold_is_refused(plain_source: Source) -> None:
    manifest = dataclasses.replace(plain_source.manifest, serial="SN>1")
    template = parse("^XA^CI28^BCN,80^FH^FD{serial}^FS^XZ", "t")
    with pytest.raises(LabelError, match="serial"):
        template.fill(plain_source._replace(manifest=manifest))


@pytest.mark.parametrize(
    "changes",
    [
        {"read_back": "{verdict}", "template": "^XA^CI28^BQN,2,4^FH^FDQA,{verdict}^FS^XZ"},
        {"read_back": "{serial}", "template": "^XA^CI28^BQN,2,4^FH^FDQA,{serial}^FS^XZ"},
        {"read_back": "{run}"},
        {"read_back": "{cote}", "template": "^XA^CI28^BQN,2,4^FH^FDQA,{code}^FS^XZ"},
        {"template": "^XA^XZ"},
    ],
)
def test_settings_that_are_refused_name_the_file(tmp_path: Path, changes: dict[str, str]) -> None:
    set_up(tmp_path, 9100, **changes)
    with pytest.raises(StationError, match=r"pass\.zpl|labels\.yaml"):
        load_labels(tmp_path)


def test_a_file_with_another_verdict_or_no_template_is_refused(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text("templates: {GOOD: pass.zpl}\n")
    with pytest.raises(RecipeError, match="GOOD"):
        load_labels(tmp_path)
    (tmp_path / FILE).write_text("templates: {PASS: nowhere.zpl}\n")
    with pytest.raises(StationError, match=r"nowhere\.zpl"):
        load_labels(tmp_path)
