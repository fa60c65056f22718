"""The printer of labels: what it says of itself is told, and what it may have printed is never sent again."""

from __future__ import annotations

import dataclasses
import os
import socket
import time
from contextlib import suppress
from threading import Event, Thread

import pytest
from label_setup import due_now, good_run, set_up, stand, thread_of
from station_support import client_of
from zpl_printer import PATIENCE_S, ZplPrinter, printing, read_fields

from station.web.labels import outbox
from station.web.labels.outbox import SENT
from station.web.labels.printer import PrinterError, connected, parse_status
from station.web.labels.settings import load_labels
from station.web.station import Station


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
