"""`lostmotion line`: what each scan leads to, and what is never taken."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import ROOT, here
from station_support import write_models
from stored_runs import metric, store_run

from station.cli.measure.at_terminal import AtTerminal
from station.cli.measure.line import DO, Line
from station.cli.measure.scans import Scans
from station.errors import StationError
from station.web.bypasses import add_bypass
from station.web.models import load_models
from station.web.people.audit import lines_of, problems_of
from station.web.people.database import StationDatabase
from station.web.scanner import NOK
from station.web.scanner_test import AS_GERMAN
from station.web.settings import ScannerTest, Settings
from station.web.station import Station

CODES = {"PASS": 0, "FAIL": 1, "NOT DECIDABLE": 3}


class Desk(AtTerminal):
    """A loop whose runs end as a test says, in records as real as those of a bench."""

    def __init__(self, data: Path, verdicts: Sequence[str]) -> None:
        write_models(data)
        super().__init__(data)
        self.data, self.verdicts, self.said = data, list(verdicts), []
        self.ran: list[list[str]] = []
        self.station = Station(data, StationDatabase(data), load_models(data, None), self)
        self.line = Line(self.station, self, "A. Tester", self.said.append)

    def start(self, options: Sequence[str], serial: str, likely: tuple[str, str] = ("", "")) -> None:
        self.likely = likely
        self.ran.append([*options, "--serial", serial])

    def wait(self) -> int:
        serial, verdict = self.ran[-1][-1], self.verdicts.pop(0)
        failed = "too wide" if verdict == "FAIL" else None
        reasons = ("the bench moved",) if verdict == "NOT DECIDABLE" else ()
        store_run(self.data, serial, [metric(0.4)], day=len(self.ran), failed=failed, reasons=reasons)
        return CODES[verdict]

    def audited(self) -> list[tuple[str, str, dict[str, Any]]]:
        """Return what stands in the audit trail, oldest first: action, outcome and the rest."""
        with self.station.database.reading() as connection:
            assert problems_of(connection) == []
            found = lines_of(connection, 50)[::-1]
        assert {(one.name, json.loads(one.detail)["at"]) for one in found} <= {("A. Tester", "lostmotion line")}
        return [(one.action, one.outcome, json.loads(one.detail)) for one in found]

    def scan(self, *texts: str) -> str:
        """Take scans; return what was said to the last of them."""
        for text in texts:
            self.said.clear()
            self.line.take(text)
        return "\n".join(self.said)


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path / "runs", ["PASS", "FAIL", "NOT DECIDABLE"])


def test_a_good_unit_is_one_scan(desk: Desk) -> None:
    assert desk.scan("SN-1\r").startswith("PASS  SN-1")
    (options,) = desk.ran
    assert "--no-report" not in options, "the recipe says whether a report is made"
    assert options[0].endswith("good.yaml")
    assert options[options.index("--operator") + 1] == "A. Tester"
    assert desk.line.has_run


def test_a_bad_unit_is_put_away_before_the_next(desk: Desk) -> None:
    assert desk.scan("SN-1", "SN-2").startswith("FAIL  SN-2")
    assert desk.scan("SN-3").startswith("REFUSED")
    assert "NOK" in desk.scan("SN-3")
    assert "put away" in desk.scan(NOK.lower())
    assert desk.scan("SN-3").startswith("NOT DECIDABLE  SN-3")
    assert [options[options.index("--serial") + 1] for options in desk.ran] == ["SN-1", "SN-2", "SN-3"]


def test_a_loop_that_begins_anew_asks_for_a_bad_unit_that_is_not_put_away(desk: Desk) -> None:
    desk.scan("SN-1", "SN-2")
    again = Desk(desk.data, ["PASS"])
    again.line.begin()
    assert "is bad" in again.said[0]
    assert again.scan("SN-3").startswith("REFUSED")
    again.scan(f"]C0{NOK}")
    third = Desk(desk.data, ["PASS"])
    third.line.begin()
    assert third.said == [DO["PASS"]], "it is in the box, whoever asks"
    assert third.scan("SN-3").startswith("PASS")


def test_what_is_done_and_refused_stands_in_the_audit_trail(desk: Desk) -> None:
    """Starts, those that were refused, reasons of a retest, units in the NOK box, and scans during a run."""
    desk.scan("SN-1", "SN-1", "loose", "SN-3", "NOK", "SN-1", "SN-2")
    desk.line.refuse(["SN-8\n"])
    told = [
        (action, outcome, detail.get("scanned"), detail.get("reasons")) for action, outcome, detail in desk.audited()
    ]
    assert told == [
        ("start_run", "done", "SN-1", None),
        ("start_run", "refused", "SN-1", ["retest_reason"]),
        ("start_run", "done", "SN-1", None),
        ("start_run", "refused", "SN-3", ["bad_unit_put_away"]),
        ("confirm_nok", "done", None, None),
        ("start_run", "refused", "SN-1", ["attempts_left"]),
        ("start_run", "done", "SN-2", None),
        ("start_run", "refused", "SN-8\n", ["bench_free"]),
    ]
    assert desk.audited()[2][2]["retest_reason"] == "loose"
    assert desk.audited()[4][2]["after"] == {"put_away_by": "A. Tester"}


def test_a_bypass_counts_here_too_and_stands_in_the_record(desk: Desk) -> None:
    desk.verdicts[:] = ["PASS", "PASS"]
    desk.scan("SN-1")
    with desk.station.database.writing() as connection:
        add_bypass(connection, "retest_reason", "Ada", "trial of the fixture", 2.0)
    desk.line.begin()
    assert any("bypassed by Ada" in one for one in desk.said)
    assert desk.scan("SN-1").startswith("PASS")
    assert "trial of the fixture" in desk.ran[1][desk.ran[1].index("--note") + 1]


def test_the_loop_goes_on_when_its_database_cannot_be_read_for_a_while(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def broken() -> Iterator[None]:
        raise StationError("station.sqlite3: disk I/O error")
        yield

    with monkeypatch.context() as patch:
        patch.setattr(desk.station.database, "reading", broken)
        patch.setattr(desk.station.database, "writing", broken)
        assert desk.scan("SN-1") == "REFUSED  station.sqlite3: disk I/O error"
        assert desk.scan(NOK) == "REFUSED  station.sqlite3: disk I/O error"
        desk.line.refuse(["SN-2"])
        assert desk.ran == []
    assert desk.scan("SN-1").startswith("PASS")


def test_the_test_code_of_the_scanner_is_asked_for_here_too(desk: Desk) -> None:
    settings = Settings(scanner_test=ScannerTest())
    asked = Desk(desk.data, ["PASS"])
    asked.line = Line(dataclasses.replace(asked.station, settings=settings), asked, "A. Tester", asked.said.append)
    assert "test code" in asked.scan("SN-1")
    assert "y and z" in asked.scan(ScannerTest().code.translate(AS_GERMAN))
    assert "The scanner works" in asked.scan(f"{ScannerTest().code}\r")
    assert asked.scan("SN-1").startswith("PASS")


def test_a_badge_is_no_reason_and_stands_nowhere(desk: Desk) -> None:
    """Scanned where the page logs somebody in: it is half of that, and a sealed record keeps its reason for good."""
    asked = Desk(desk.data, ["PASS", "PASS"])
    asked.line = Line(
        dataclasses.replace(asked.station, settings=Settings(badge=r"B-\d{6}")), asked, "A. Tester", asked.said.append
    )
    assert asked.scan("SN-1").startswith("PASS")
    assert "This is a badge" in asked.scan("SN-1", "B-100001\r")
    assert "This is a badge" in asked.scan("B-100001")
    asked.line.refuse(["B-100001\n"])
    assert len(asked.ran) == 1
    assert not any("B-100001" in json.dumps(detail) for _, _, detail in asked.audited())


def test_who_does_not_say_their_name_is_none_in_the_record(desk: Desk) -> None:
    Line(desk.station, desk, None, desk.said.append).take("SN-1")
    assert "--operator" not in desk.ran[0]
    with desk.station.database.reading() as connection:
        assert lines_of(connection, 1)[0].name == "lostmotion line"


def test_a_retest_needs_a_reason_and_an_empty_line_leaves_it(desk: Desk) -> None:
    desk.scan("SN-1")
    assert "needs a reason" in desk.scan("SN-1")
    assert not desk.line.has_run
    assert "not measured again" in desk.scan("")
    assert desk.scan("SN-1", "the coupling was loose").startswith("FAIL  SN-1")
    assert desk.ran[1][desk.ran[1].index("--retest-reason") + 1] == "the coupling was loose"


@pytest.mark.parametrize("scanned", ["SN-1", "SN-2", "BAD-7", "]d221SN-2", "]C0SN-2", "NOK", "nok", "]C0NOK"])
def test_a_code_is_no_reason_for_a_retest(desk: Desk, scanned: str) -> None:
    """The unit was scanned twice, or another one is on the bench by now: it would be measured as the one before."""
    desk.scan("SN-1", "SN-1")
    assert desk.scan(scanned).startswith("REFUSED")
    assert len(desk.ran) == 1
    assert desk.scan("SN-2").startswith("FAIL  SN-2"), "it is a scan like any other"


@pytest.mark.parametrize("reason", ["loose", "SEATING", "2nd try: Kupplung geprüft", "reason 7"])
def test_words_are_a_reason_for_a_retest(desk: Desk, reason: str) -> None:
    assert desk.scan("SN-1", "SN-1", reason).startswith("FAIL  SN-1")


@pytest.mark.parametrize("scanned", ["XX-1", "SN-1\x07", "]C10109501101530003"])
def test_what_is_no_serial_number_of_a_model_starts_nothing(desk: Desk, scanned: str) -> None:
    assert desk.scan(scanned).startswith("REFUSED")
    assert desk.ran == []
    assert desk.scan("   ") == ""


@pytest.mark.parametrize("sent", [b"SN-1\rSN-2\r", b"SN-1\nSN-2\n", b"SN-1\r\nSN-2\r\n"])
def test_scans_end_with_carriage_return_line_feed_or_both(sent: bytes) -> None:
    reader, writer = os.pipe()
    os.write(writer, sent)
    scans = Scans(reader)
    assert [scans.next(), scans.next()] == ["SN-1", "SN-2"]
    os.write(writer, sent + b"SN-3")
    assert scans.dropped() == ["SN-1", "SN-2", "SN-3"]
    os.close(writer)
    assert scans.next() is None
    os.close(reader)


@contextmanager
def in_a_terminal(data: Path) -> Iterator[Any]:
    """Start the loop as a process that reads what is written to it."""
    command = [sys.executable, "-m", "station", "line", "--data", str(data), "--operator", "A. Tester", "--fast"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command, cwd=ROOT, text=True, **pipes) as line:
        yield line


@pytest.mark.wires
def test_scans_become_runs_over_wires_and_those_during_a_run_are_refused(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    write_models(data)
    with in_a_terminal(data) as line:
        line.stdin.write("SN-7\n")
        line.stdin.flush()
        said = ""
        while "starting the virtual bench" not in said and not re.search("^(PASS|FAIL|NO)", said, re.MULTILINE):
            said += line.stdout.readline()
        line.stdin.write("SN-8\n")  # during the run
        line.stdin.close()
        said += line.stdout.read()
    assert line.returncode == 0
    assert re.search("^PASS  SN-7", said, re.MULTILINE), said
    assert re.search("^REFUSED  'SN-8' was scanned during a run", said, re.MULTILINE), said
    assert here("audit", "verify", "--data", str(data)).exit_code == 0
    (run,) = here("list", "--data", str(data), "--json").json
    assert (run["serial"], run["verdict"]) == ("SN-7", "PASS")


def test_the_table_of_models_is_read_again_when_it_has_changed(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    write_models(data)
    with in_a_terminal(data) as line:
        line.stdin.write("none-1\n")
        line.stdin.flush()
        while "No model has serial numbers like" not in (said := line.stdout.readline()):
            assert said, "it has ended"
        (data / "models.yaml").write_text("models: none\n", encoding="utf-8")
        line.stdin.write("none-2\n")
        line.stdin.close()
        said = line.stdout.read()
    assert "the table of models has changed and is wrong" in said
    assert line.returncode == 0
