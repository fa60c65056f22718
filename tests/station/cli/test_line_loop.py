"""`lostmotion line`: what each scan leads to, and what is never taken."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from lostmotion_command import ROOT, here
from station_support import write_models
from stored_runs import metric, store_run

from station.cli.measure.line import NOK, Line, Scans
from station.web.models import load_models

CODES = {"PASS": 0, "FAIL": 1, "NOT DECIDABLE": 3}


class Desk:
    """A loop whose runs end as a test says, in records as real as those of a bench."""

    def __init__(self, data: Path, verdicts: Sequence[str]) -> None:
        write_models(data)
        self.data, self.verdicts, self.said = data, list(verdicts), []
        self.ran: list[list[str]] = []
        self.line = Line(data, load_models(data, None), "A. Tester", self.run, self.said.append)

    def run(self, options: Sequence[str]) -> int:
        self.ran.append(list(options))
        serial, verdict = options[options.index("--serial") + 1], self.verdicts.pop(0)
        failed = "too wide" if verdict == "FAIL" else None
        reasons = ("the bench moved",) if verdict == "NOT DECIDABLE" else ()
        store_run(self.data, serial, [metric(0.4)], day=len(self.ran), failed=failed, reasons=reasons)
        return CODES[verdict]

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


def test_a_loop_that_begins_anew_asks_for_the_bad_unit_again(desk: Desk) -> None:
    desk.scan("SN-1", "SN-2", NOK)
    again = Desk(desk.data, [])
    again.line.begin()
    assert "is bad" in again.said[0]
    assert again.scan("SN-3").startswith("REFUSED")


def test_a_retest_needs_a_reason_and_an_empty_line_leaves_it(desk: Desk) -> None:
    desk.scan("SN-1")
    assert "needs a reason" in desk.scan("SN-1")
    assert not desk.line.has_run
    assert "not measured again" in desk.scan("")
    assert desk.scan("SN-1", "the coupling was loose").startswith("FAIL  SN-1")
    assert desk.ran[1][desk.ran[1].index("--retest-reason") + 1] == "the coupling was loose"


@pytest.mark.parametrize("scanned", ["SN-1", "SN-2", "BAD-7", "]d221SN-2", "NOK", "nok"])
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


@pytest.mark.wires
def test_scans_become_runs_over_wires_and_those_during_a_run_are_refused(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    write_models(data)
    command = [sys.executable, "-m", "station", "line", "--data", str(data), "--operator", "A. Tester", "--fast"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command, cwd=ROOT, text=True, **pipes) as line:
        assert line.stdin is not None
        assert line.stdout is not None
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
    (run,) = here("list", "--data", str(data), "--json").json
    assert (run["serial"], run["verdict"]) == ("SN-7", "PASS")
