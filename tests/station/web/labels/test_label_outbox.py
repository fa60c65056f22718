"""Which runs get a label: each once when it is sealed, and none that is of before."""

from __future__ import annotations

import dataclasses
import json
import time
from contextlib import suppress

import pytest
from label_setup import due_now, good_run, released_text, set_up, stand, thread_of
from lostmotion_command import here
from station_samples import SETUP
from station_support import client_of
from stored_runs import metric, store_run
from zpl_printer import ZplPrinter, read_fields

from station.errors import StationError
from station.records import seal
from station.records.chain.chain_file import CHAIN
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.web.labels import outbox
from station.web.labels.settings import FILE, SHIPPED, load_labels
from station.web.labels.template import parse
from station.web.people.audit import lines_of
from station.web.people.database import LABELS
from station.web.server import Served, open_station
from station.web.station import Station


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


def test_a_chain_that_is_no_chain_stops_the_line_and_not_the_thread(plant: Station, printer: ZplPrinter) -> None:
    with (plant.data / CHAIN).open("ab") as chain:
        chain.write(b"{half\n")
    with plant.database.reading() as connection, pytest.raises(StationError, match="a line after byte"):
        outbox.why_not_next(connection, plant.data, plant.labels)
    with pytest.raises(StationError, match="a line after byte"):
        thread_of(plant).look()
    assert printer.printed == []


@pytest.mark.parametrize(
    "torn",
    [
        pytest.param(b'{"kind":"sealed","counter":3,"run":"2026', id="half of an entry"),
        pytest.param(b'{"kin\0\0\0\0', id="its first bytes, then zeros"),
        pytest.param(bytes(300), id="zeros alone"),
        pytest.param(b'{"kind":"sealed"}\n', id="no entry, of another hand"),
        pytest.param(b'{"kind":"sealed","run":"..","serial":1}\n', id="names no run"),
    ],
)
def test_a_line_that_is_no_entry_keeps_no_later_run_from_its_label(
    plant: Station, printer: ZplPrinter, torn: bytes
) -> None:
    with (plant.data / CHAIN).open("ab") as chain:
        chain.write(torn)
    good_run(plant)
    with plant.database.reading() as connection:
        assert "being made" in outbox.why_not_next(connection, plant.data, plant.labels)
    thread_of(plant).look()
    assert len(printer.printed) == 1


@pytest.mark.parametrize(
    "line", [b'{"kind":"sealed","run":"2026\x00}"}', b"[" * 100_000, b'{"kind":"sealed"\xff"}', b"0"]
)
def test_a_line_that_no_power_failure_has_torn_stops_the_line(plant: Station, line: bytes) -> None:
    with (plant.data / CHAIN).open("ab") as chain:
        chain.write(line + b"\n")
    with pytest.raises(StationError, match="a line after byte"):
        thread_of(plant).look()


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
