"""Labels: printed once when a run is sealed, awaited until a scan has read them, and never a command of the printer."""

from __future__ import annotations

import dataclasses
import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lostmotion_command import here
from sqlalchemy import select
from station_samples import SETUP
from station_support import client_of
from stored_runs import metric, store_run
from zpl_printer import PATIENCE_S, ZplPrinter, printing, read_fields

from definitions.metrics import METRICS
from recipes import RecipeError
from station.cli.measure.line import Line, PrintedLabels
from station.documents.result import Result
from station.errors import StationError
from station.records import seal
from station.records.certificate_code import code_of
from station.records.chain.chain_file import CHAIN
from station.records.data_folder import Store
from station.records.run_record import RESULT, RunRecord
from station.web.labels import outbox
from station.web.labels.outbox import SENT, Printing, awaited
from station.web.labels.printer import PrinterError, connected, parse_status
from station.web.labels.settings import FILE, SHIPPED, load_labels
from station.web.labels.template import FIELDS, LabelError, Source, parse
from station.web.models import load_models
from station.web.people.audit import lines_of, problems_of
from station.web.people.database import LABELS
from station.web.scanner import ScanError, serial_of
from station.web.server import Served, open_station
from station.web.station import Station

SETTINGS = """\
printer: {{port: {port}, timeout_s: 0.5}}
templates: {{PASS: pass.zpl}}
read_back: "{read_back}"
"""


def set_up(data: Path, port: int, read_back: str = "{code}", template: str | None = None) -> None:
    data.mkdir(parents=True, exist_ok=True)
    (data / FILE).write_text(SETTINGS.format(port=port, read_back=read_back))
    (data / "pass.zpl").write_text(template or SHIPPED.read_text())


@pytest.fixture
def printer() -> Iterator[ZplPrinter]:
    with printing() as found:
        yield found


@pytest.fixture
def plant(station: Station, printer: ZplPrinter) -> Station:
    set_up(station.data, printer.port)
    found = dataclasses.replace(station, labels=load_labels(station.data))
    outbox.begin_here(found.database, found.data)
    return found


def thread_of(plant: Station) -> Printing:
    assert plant.labels is not None
    return Printing(plant.database, plant.data, plant.labels)


def stand(plant: Station) -> outbox.Awaited | None:
    assert plant.labels is not None
    with plant.database.reading() as connection:
        return awaited(connection, plant.labels)


def due_now(plant: Station) -> None:
    """Let the wait before a printer is asked again be over."""
    with plant.database.writing() as connection:
        connection.execute(LABELS.update().values(next_s=0.0))


def released_text(data: Path) -> bytes:
    return (data.parent / "recipes" / "good.yaml").read_bytes()


def good_run(plant: Station, serial: str = "SN-1", **words: object) -> str:
    run = store_run(plant.data, serial, [metric(0.4)], **{"text": released_text(plant.data)} | words)
    return code_of(run)


def test_a_label_is_printed_once_and_read_back_before_the_next_unit(
    plant: Station, printer: ZplPrinter, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plant.running, "start", lambda *_: None)
    operator = client_of(plant, "operator")
    code, thread = good_run(plant), thread_of(plant)
    refused = operator.post("start_run", {"scanned": "SN-2"}).json()["refused"]
    assert [one["id"] for one in refused] == ["label_read"], "before anybody has looked at the run that was sealed"
    thread.look()
    thread.look()
    assert len(printer.printed) == 1
    fields = read_fields(printer.printed[0])
    assert (fields[0], fields[1], fields[2]) == (f"QA,{code}", "PASS", "SN-1")
    assert operator.http.get("/api/now").json()["label"]["stage"] == "printed"
    assert operator.post("start_run", {"scanned": "SN-2"}).status_code == 409
    assert operator.post("read_label", {"scanned": f"{code}\r"}).json()["serial"] == "SN-1"
    assert operator.http.get("/api/now").json()["label"] is None
    assert operator.post("start_run", {"scanned": "SN-2"}).status_code == 200
    again = operator.post("read_label", {"scanned": code}).json()["refused"][0]["text"]
    assert "was read before" in again


@pytest.mark.usefixtures("printer")
def test_the_label_of_another_unit_is_refused_and_told(plant: Station) -> None:
    first, thread = good_run(plant), thread_of(plant)
    operator = client_of(plant, "operator")
    thread.look()
    assert operator.post("read_label", {"scanned": first}).status_code == 200
    second = good_run(plant, "SN-2")
    thread.look()
    answer = operator.post("read_label", {"scanned": first})
    assert answer.status_code == 409
    assert "SN-1" in answer.json()["refused"][0]["text"]
    assert "SN-2" in answer.json()["refused"][0]["text"]
    line = client_of(plant, "quality").http.get("/api/audit", params={"newest": 1}).json()["newest"][0]
    assert (line["action"], line["outcome"]) == ("read_label", "refused")
    assert operator.post("read_label", {"scanned": "LM1.of.nobody"}).status_code == 409
    assert operator.post("read_label", {"scanned": second}).status_code == 200
    assert stand(plant) is None


@pytest.mark.parametrize(
    "words",
    [{"failed": "too wide"}, {"master": "PASS"}, {"scenario": "s"}, {"state": "stopped"}, {"text": b"of nobody\n"}],
)
def test_units_that_get_no_label(plant: Station, printer: ZplPrinter, words: dict[str, str]) -> None:
    good_run(plant, **words)
    thread_of(plant).look()
    assert (stand(plant), printer.printed) == (None, [])


def test_runs_from_before_labels_were_set_up_get_none(station: Station, printer: ZplPrinter) -> None:
    good_run(station)
    set_up(station.data, printer.port)
    plant = dataclasses.replace(station, labels=load_labels(station.data))
    thread_of(plant).look()
    assert (stand(plant), printer.printed) == (None, [])


@pytest.mark.parametrize(("trouble", "word"), [("paper_out", "roll"), ("head_open", "head"), ("silent", "answer")])
def test_a_printer_that_cannot_print_is_told_and_prints_when_it_can(
    plant: Station, printer: ZplPrinter, trouble: str, word: str
) -> None:
    setattr(printer, trouble, True)
    good_run(plant)
    thread = thread_of(plant)
    thread.look()
    found = stand(plant)
    assert found is not None
    assert (found.stage, word in str(found)) == ("to print", True)
    setattr(printer, trouble, False)
    due_now(plant)
    thread.look()
    assert len(printer.printed) == 1
    assert stand(plant).stage == "printed"


def test_a_printer_that_is_not_there_is_told(station: Station) -> None:
    with printing() as gone:
        port = gone.port
    set_up(station.data, port)
    plant = dataclasses.replace(station, labels=load_labels(station.data))
    thread = thread_of(plant)
    good_run(plant)
    thread.look()
    assert f":{port} cannot be reached" in str(stand(plant))


@pytest.mark.parametrize("how", ["cut", "holds"])
def test_a_label_of_which_nobody_knows_is_never_sent_again_by_itself(
    plant: Station, printer: ZplPrinter, how: str
) -> None:
    """A second PASS that nobody asked for could be put on another unit."""
    setattr(printer, how, True)
    code, thread = good_run(plant), thread_of(plant)
    thread.look()
    assert stand(plant).stage == SENT
    setattr(printer, how, False)
    for _ in range(3):
        due_now(plant)
        thread_of(plant).look()  # as after a kill
    if how == "holds":
        printer.wait_for(1)
    assert len(printer.printed) == (how == "holds")
    operator, run = client_of(plant, "operator"), stand(plant).run
    if how == "holds":
        assert operator.post("read_label", {"scanned": code}).status_code == 200
        return
    assert operator.post("print_label", {"run": run}).json()["copy_number"] == 2
    assert operator.post("print_label", {"run": run}).status_code == 409, "it waits for the printer already"
    assert operator.post("read_label", {"scanned": code}).status_code == 409, "it is not printed yet"
    thread.look()
    assert "copy 2" in read_fields(printer.printed[0])
    assert operator.post("read_label", {"scanned": code}).status_code == 200


def end_in_sending(*, sends: bool) -> None:
    """Have this process end as it sends a label: before its first byte, or behind its last one."""
    send = outbox.Line.send

    def end(line: outbox.Line, label: str) -> None:
        if sends:
            send(line, label)
        os._exit(9)

    outbox.Line.send = end


def test_a_kill_at_the_moment_of_sending_leaves_it_open(plant: Station, printer: ZplPrinter) -> None:
    """The process ends between the note that a label is sent and its first byte, and behind its last one."""
    for serial, sends in (("SN-1", False), ("SN-2", True)):
        good_run(plant, serial)
        thread = thread_of(plant)
        pid = os.fork()
        if pid == 0:
            end_in_sending(sends=sends)
            thread.look()
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 9
        thread_of(plant).look()
        found = stand(plant)
        assert (found.serial, found.stage) == (serial, SENT)
        asked = {"run": found.run, "reason": "of a test"}
        assert client_of(plant, "technician").post("set_label_aside", asked).status_code == 200
    printer.wait_for(1)
    assert ["SN-2" in one for one in printer.printed] == [True], "the one that was sent as a whole"


def test_a_unit_goes_without_a_label_by_those_in_charge_alone(plant: Station, printer: ZplPrinter) -> None:
    printer.head_open = True
    good_run(plant)
    thread_of(plant).look()
    asked = {"run": stand(plant).run, "reason": "the printer is broken"}
    assert client_of(plant, "operator").post("set_label_aside", asked).status_code == 403
    assert client_of(plant, "technician").post("set_label_aside", asked).status_code == 200
    assert client_of(plant, "technician").post("set_label_aside", asked).status_code == 409
    printer.head_open = False
    due_now(plant)
    thread_of(plant).look()
    assert (stand(plant), printer.printed) == (None, []), "it is not printed behind everybody's back"
    with plant.database.reading() as connection:
        assert connection.execute(select(LABELS.c.why)).scalar_one() == "the printer is broken"


def test_a_label_that_cannot_be_made_stops_the_line_and_says_why(station: Station, printer: ZplPrinter) -> None:
    template = SHIPPED.read_text().replace("{serial}", "{backlash_width_3pct}")
    set_up(station.data, printer.port, template=template)
    plant = dataclasses.replace(station, labels=load_labels(station.data))
    outbox.begin_here(plant.database, plant.data)
    good_run(plant)
    thread_of(plant).look()
    assert "backlash_width_3pct" in str(stand(plant))
    assert printer.printed == []


def test_a_changed_record_gets_no_label(plant: Station, printer: ZplPrinter) -> None:
    run = store_run(plant.data, "SN-1", [metric(0.4)], text=released_text(plant.data))
    (run.folder / "result.json").write_text("{}")
    thread_of(plant).look()
    found = stand(plant)
    assert found is None or found.stage == "not made"
    assert printer.printed == []


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


@pytest.mark.parametrize(
    "answer", [b"", b"HTTP/1.1 400", b"\x02x,y\x03\r\n\x02\x03\r\n\x02\x03\r\n", b"\x02\xff\x03" * 3]
)
def test_what_is_no_printer_is_told(answer: bytes) -> None:
    with pytest.raises(PrinterError, match="ZPL"):
        parse_status(answer)


def test_two_labels_that_wait_in_the_printer_are_not_taken_for_ours(plant: Station, printer: ZplPrinter) -> None:
    printer.holds = True
    with connected("127.0.0.1", printer.port, 1.0) as line:
        line.send("^XA^FDof somebody else^FS^XZ")
        assert line.status().waiting == 1
    good_run(plant)
    thread_of(plant).look()
    assert "other labels" in str(stand(plant))
    assert len(printer.waiting) == 1


@pytest.mark.usefixtures("printer")
def test_the_loop_in_a_terminal_asks_for_the_label_too(plant: Station) -> None:
    said: list[str] = []
    ran: list[str] = []

    def run(options: list[str]) -> int:
        ran.append(options[options.index("--serial") + 1])
        good_run(plant, ran[-1])
        return 0

    labels = PrintedLabels(plant.database, plant.data, plant.labels, "A. Tester")
    loop = Line(plant.data, load_models(plant.data, None), "A. Tester", run, said.append, labels=labels)
    loop.take("SN-1")
    thread_of(plant).look()
    loop.take("SN-2")
    assert (ran, said[-1].startswith("REFUSED")) == (["SN-1"], True)
    loop.take(code_of(next(iter(Store(plant.data).newest(1)))))
    assert "SN-1" in said[-1]
    loop.take("SN-2")
    assert ran == ["SN-1", "SN-2"]


def test_the_commands_show_what_is_printed_and_print_nothing(plant: Station, printer: ZplPrinter) -> None:
    code = good_run(plant)
    shown = here("labels", "preview", "SN-1", "--data", str(plant.data))
    assert read_fields(shown.out)[0] == f"QA,{code}"
    assert code in shown.err
    assert parse(here("labels", "template").out, "t").holds("{code}")
    status = here("labels", "status", "--json", "--data", str(plant.data))
    assert json.loads(status.out) == {"printer": {"trouble": "", "waiting": 0}, "label": None}
    printer.paper_out = True
    status = here("labels", "status", "--data", str(plant.data))
    assert (status.exit_code, "roll" in status.out) == (1, True)
    assert here("labels", "status", "--data", str(plant.data.parent)).exit_code == 2
    assert printer.printed == []


def test_a_run_between_its_line_and_its_name_gets_its_label(
    plant: Station, printer: ZplPrinter, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The chain has the run as sealed before its run.json has its name: who looks in that moment looks again."""
    thread, put = thread_of(plant), seal._put_in_place
    seen: list[str] = []

    def look_first(record: RunRecord) -> None:
        with suppress(StationError):
            thread.look()
        with plant.database.reading() as connection:
            seen.append(outbox.why_not_next(connection, plant.data, plant.labels))
        put(record)

    monkeypatch.setattr(seal, "_put_in_place", look_first)
    code = good_run(plant)
    assert "Wait a moment" in seen[0], "the next unit waits for it"
    thread.look()
    assert [read_fields(one)[0] for one in printer.printed] == [f"QA,{code}"]


def test_a_unit_that_failed_when_measured_again_gets_no_label_of_before(plant: Station, printer: ZplPrinter) -> None:
    """Its label with PASS waits for the printer; a bypass lets the unit be measured again, and it fails."""
    printer.paper_out = True
    good_run(plant)
    thread = thread_of(plant)
    thread.look()
    first = stand(plant).run
    good_run(plant, failed="too wide")
    printer.paper_out = False
    due_now(plant)
    for _ in range(2):
        thread.look()
        due_now(plant)
    assert (stand(plant), printer.printed) == (None, [])
    asked = client_of(plant, "operator").post("print_label", {"run": first})
    assert (asked.status_code, "measured again" in asked.json()["refused"][0]["text"]) == (409, True)


def test_no_label_of_before_comes_while_its_unit_is_measured_again(plant: Station, printer: ZplPrinter) -> None:
    printer.paper_out = True
    good_run(plant)
    thread = thread_of(plant)
    thread.look()
    Store(plant.data).create("SN-1", SETUP, {"recipe.yaml": b"r\n", "bench.yaml": b"b\n"})
    printer.paper_out = False
    due_now(plant)
    thread.look()
    assert (printer.printed, "measured again" in str(stand(plant))) == ([], True)


def test_the_old_label_of_a_unit_that_was_measured_again_is_told(plant: Station, printer: ZplPrinter) -> None:
    first, thread = good_run(plant), thread_of(plant)
    thread.look()
    second = good_run(plant)
    thread.look()
    operator = client_of(plant, "operator")
    assert "old label" in operator.post("read_label", {"scanned": first}).json()["refused"][0]["text"]
    assert operator.post("read_label", {"scanned": second}).status_code == 200
    assert len(printer.printed) == 2
    good_run(plant, failed="too wide")
    thread.look()
    for code in (first, second):
        assert "old label" in operator.post("read_label", {"scanned": code}).json()["refused"][0]["text"]


def test_runs_that_nobody_looked_at_get_no_labels_by_themselves_but_the_newest(
    plant: Station, printer: ZplPrinter
) -> None:
    """Measured by `lostmotion run` while no server was there: the units have left, and a PASS would go elsewhere."""
    runs = [good_run(plant, f"SN-{number}") for number in range(1, 4)]
    thread = thread_of(plant)
    for _ in range(3):
        thread.look()
    assert [read_fields(one)[0] for one in printer.printed] == [f"QA,{runs[-1]}"]
    operator = client_of(plant, "operator")
    assert operator.post("read_label", {"scanned": runs[-1]}).status_code == 200
    asked = operator.post("print_label", {"run": Store(plant.data).runs()[0].id})
    assert (asked.status_code, asked.json()["copy_number"]) == (200, 1)
    thread.look()
    assert read_fields(printer.printed[-1])[0] == f"QA,{runs[0]}"


def test_labels_that_are_set_up_again_leave_what_waited_before(plant: Station, printer: ZplPrinter) -> None:
    printer.paper_out = True
    good_run(plant)
    thread_of(plant).look()
    plant.database.close()
    (plant.data / FILE).rename(plant.data / "labels.off")
    served, _ = open_station(Served(plant.data, "127.0.0.1", 0))
    good_run(plant, "SN-2")
    with served.database.reading() as connection:
        (line,) = lines_of(connection, 1)
    assert (line.action, "taken away" in line.detail) == ("set_label_aside", True)
    served.close()
    (plant.data / "labels.off").rename(plant.data / FILE)
    printer.paper_out = False
    thread = thread_of(plant)
    for _ in range(3):
        thread.look()
    assert (stand(plant), printer.printed) == (None, [])


def test_labels_of_which_no_scan_was_asked_are_not_awaited_later(plant: Station, printer: ZplPrinter) -> None:
    without = (plant.data / FILE).read_text().partition("read_back")[0]
    (plant.data / FILE).write_text(without)
    before = dataclasses.replace(plant, labels=load_labels(plant.data))
    good_run(plant)
    thread_of(before).look()
    assert (len(printer.printed), stand(before), stand(plant)) == (1, None, None)
    assert client_of(plant, "operator").post("read_label", {"scanned": ""}).status_code == 409
    with plant.database.reading() as connection:
        assert connection.execute(select(LABELS.c.label)).scalar_one() == "", "nobody needs its text any more"


def test_an_empty_scan_reads_no_label(plant: Station, printer: ZplPrinter) -> None:
    without = (plant.data / FILE).read_text().partition("read_back")[0]
    (plant.data / FILE).write_text(without)
    plant = dataclasses.replace(plant, labels=load_labels(plant.data))
    printer.cut = True
    good_run(plant)
    thread_of(plant).look()
    assert stand(plant).stage == SENT
    assert client_of(plant, "operator").post("read_label", {"scanned": " "}).status_code == 409


def test_a_virtual_unit_gets_a_label_where_that_is_asked_for_alone(plant: Station, printer: ZplPrinter) -> None:
    good_run(plant, virtual="nominal")
    thread_of(plant).look()
    assert (stand(plant), printer.printed) == (None, [])
    assert here("labels", "preview", "SN-1", "--data", str(plant.data)).exit_code == 2
    (plant.data / FILE).write_text((plant.data / FILE).read_text() + "virtual_units: true\n")
    plant = dataclasses.replace(plant, labels=load_labels(plant.data))
    good_run(plant, "SN-2", virtual="nominal")
    thread_of(plant).look()
    assert len(printer.printed) == 1


def test_a_printer_that_answers_a_little_at_a_time_is_told(plant: Station) -> None:
    """Each piece comes in time, and the answer never."""
    assert plant.labels is not None
    with socket.create_server(("127.0.0.1", 0)) as listener:
        stop = Event()

        def drip() -> None:
            connection, _ = listener.accept()
            with connection, suppress(OSError):
                while not stop.wait(0.1):
                    connection.sendall(b"0")

        thread = Thread(target=drip, daemon=True)
        thread.start()
        began_s = time.monotonic()
        with (
            connected("127.0.0.1", listener.getsockname()[1], 0.5) as line,
            pytest.raises(PrinterError, match="does not answer"),
        ):
            line.status()
        stop.set()
        thread.join()
    assert time.monotonic() - began_s < PATIENCE_S


def test_a_printer_whose_name_no_computer_can_have_is_told() -> None:
    with pytest.raises(PrinterError, match="cannot be reached"), connected("printer..local", 9100, 0.5):
        pass


def test_a_chain_that_is_no_chain_stops_the_line_and_not_the_thread(plant: Station, printer: ZplPrinter) -> None:
    with (plant.data / CHAIN).open("ab") as chain:
        chain.write(b"{half\n")
    with plant.database.reading() as connection, pytest.raises(StationError, match="a line after byte"):
        outbox.why_not_next(connection, plant.data, plant.labels)
    with pytest.raises(StationError, match="a line after byte"):
        thread_of(plant).look()
    assert printer.printed == []


@pytest.mark.usefixtures("printer")
def test_a_scan_of_a_label_at_a_terminal_is_a_line_of_the_audit_trail(plant: Station) -> None:
    code = good_run(plant)
    thread_of(plant).look()
    labels = PrintedLabels(plant.database, plant.data, plant.labels, "A. Tester")
    labels.read(code)
    labels.read(code)
    with plant.database.reading() as connection:
        lines = lines_of(connection, 2)
        assert problems_of(connection) == []
    assert [(one.name, one.action, one.outcome) for one in lines] == [
        ("A. Tester", "read_label", "refused"),
        ("A. Tester", "read_label", "done"),
    ]


def test_the_code_of_a_label_is_no_serial_number(plant: Station) -> None:
    """Where labels are not set up any more, or the label is of another bench, and any text is a serial number."""
    code = good_run(plant)
    for scanned in (code, f"]Q1{code}", code.split(".", 2)[2], f"PASS {code}"):
        with pytest.raises(ScanError, match="label"):
            serial_of(scanned)


@pytest.mark.usefixtures("printer")
def test_a_scanner_that_says_how_a_code_is_printed_reads_a_label(plant: Station) -> None:
    """GS1 codes need it of a scanner, and it then says it of every code."""
    code = good_run(plant)
    thread_of(plant).look()
    with pytest.raises(ScanError, match="label"):
        serial_of(f"]Q1{code}")
    with plant.database.reading() as connection:
        assert outbox.is_label(connection, f"]Q1{code}")
    assert client_of(plant, "operator").post("read_label", {"scanned": f"]Q1{code}\r"}).status_code == 200


@pytest.mark.parametrize("quantity", ["", "1", "1,0", "1,0,1,Y", "1,,,N,Y"])
def test_a_template_may_say_that_it_is_one_label(quantity: str) -> None:
    assert parse(f"^XA^CI28^PQ{quantity}^FH^FD{{serial}}^FS^XZ", "t").parts


def test_a_clock_that_is_set_back_holds_no_label_up(plant: Station, printer: ZplPrinter) -> None:
    printer.paper_out = True
    good_run(plant)
    thread = thread_of(plant)
    thread.look()
    printer.paper_out = False
    with plant.database.writing() as connection:
        connection.execute(LABELS.update().values(next_s=time.time() + 3600.0))
    thread.look()
    assert len(printer.printed) == 1
