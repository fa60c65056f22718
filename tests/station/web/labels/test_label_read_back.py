"""Labels are awaited until a scan has read them, or somebody in charge has set them aside."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Sequence

import pytest
from label_setup import due_now, good_run, stand, thread_of
from lostmotion_command import here
from sqlalchemy import select
from station_support import PASSWORD, client_of
from zpl_printer import ZplPrinter, read_fields

from station.cli.measure.at_terminal import AtTerminal
from station.cli.measure.line import Line
from station.records.certificate_code import code_of
from station.records.data_folder import Store
from station.web.labels import outbox
from station.web.labels.outbox import SENT
from station.web.labels.settings import FILE, load_labels
from station.web.people.audit import lines_of, problems_of
from station.web.people.database import LABELS
from station.web.scanner import ScanError, serial_of
from station.web.station import Station


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


class Bench(AtTerminal):
    """A terminal whose units are all good."""

    def __init__(self, plant: Station) -> None:
        super().__init__(plant.data)
        self.ran: list[str] = []
        self.said: list[str] = []
        self.plant = dataclasses.replace(plant, running=self)
        self.line = Line(self.plant, self, "A. Tester", self.said.append)

    def start(self, options: Sequence[str], serial: str, likely: tuple[str, str] = ("", "")) -> None:  # noqa: ARG002
        self.ran.append(serial)

    def wait(self) -> int:
        good_run(self.plant, self.ran[-1])
        return 0

    def scan(self, text: str) -> str:
        self.line.take(text)
        return self.said[-1]


@pytest.mark.usefixtures("printer")
def test_the_loop_in_a_terminal_asks_for_the_label_too(plant: Station) -> None:
    bench = Bench(plant)
    bench.scan("SN-1")
    thread_of(plant).look()
    assert bench.scan("SN-2").startswith("REFUSED")
    assert bench.ran == ["SN-1"]
    assert "SN-1" in bench.scan(code_of(next(iter(Store(plant.data).newest(1)))))
    bench.scan("SN-2")
    assert bench.ran == ["SN-1", "SN-2"]


def test_the_loop_in_a_terminal_prints_a_label_again(plant: Station, printer: ZplPrinter) -> None:
    bench, thread = Bench(plant), thread_of(plant)
    assert bench.scan("LABEL").startswith("REFUSED")
    bench.scan("SN-1")
    thread.look()
    assert "copy 2" in bench.scan("label")
    assert "waits for the printer" in bench.scan("LABEL"), "a card that is scanned twice gives one label"
    thread.look()
    assert len(printer.printed) == 2
    assert "right one" in bench.scan(code_of(next(iter(Store(plant.data).newest(1)))))
    assert "copy 3" in bench.scan("LABEL"), "one that was read and is damaged now"
    thread.look()
    assert "right one" in bench.scan(code_of(next(iter(Store(plant.data).newest(1)))))
    good_run(plant, "SN-3")
    thread.look()
    good_run(plant, "SN-2", failed="too wide")
    assert "has no label" in bench.scan("LABEL"), "the good unit's label does not go on the bad one"
    with plant.database.reading() as connection:
        told = [(one.action, one.outcome) for one in lines_of(connection, 9) if one.action == "print_label"]
    assert told == [("print_label", one) for one in ("refused", "done", "refused", "done", "refused")]


@pytest.mark.usefixtures("printer")
def test_labels_are_printed_again_and_set_aside_by_command(plant: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    good_run(plant)
    thread_of(plant).look()

    def as_the(role: str, *words: str) -> int:
        monkeypatch.setattr("sys.stdin", io.StringIO(f"{PASSWORD}\n"))
        return here("labels", *words, "--as", f"the {role}", "--data", str(plant.data)).exit_code

    assert as_the("operator", "again", "SN-1") == 0
    assert stand(plant).stage == "to print"
    assert as_the("operator", "aside", "SN-1", "--reason", "printer broken") == 2
    assert as_the("technician", "aside", "SN-1", "--reason", "printer broken") == 0
    assert stand(plant) is None


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


@pytest.mark.usefixtures("printer")
def test_a_scan_of_a_label_at_a_terminal_is_a_line_of_the_audit_trail(plant: Station) -> None:
    code = good_run(plant)
    thread_of(plant).look()
    bench = Bench(plant)
    bench.scan(code)
    bench.scan(code)
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
