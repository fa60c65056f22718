"""Two browsers scan at once and are closed in mid-run: one run, finished and stored."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from browser import needs_browser, opened
from lostmotion_command import here
from served import LONGEST_S, prepared, served

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]

SCAN = """text => [...text, "Enter"].forEach(
    key => document.body.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true, cancelable: true})))"""


def test_two_browsers_that_scan_at_once_and_close_in_mid_run_make_one_run_that_is_finished_and_stored(
    tmp_path: Path,
) -> None:
    with served(prepared(tmp_path / "runs")) as station:
        station.log_in("operator")
        with opened(station.url) as enter:
            pages = [enter("operator"), enter("technician")]
            for number, one in enumerate(pages):
                one.evaluate(f"setTimeout(() => ({SCAN})('SN-{number}'), {1500 - 500 * number} )")
            running = station.wait("running")
            until = time.monotonic() + LONGEST_S
            while not any("A run is in progress" in one.inner_text("body") for one in pages):
                assert time.monotonic() < until, "one of the two is told that the other was first"
                time.sleep(0.1)
        # The browser is closed now, with both of its pages.
        ended = station.wait("ended")
        assert (ended["run"], ended["verdict"]) == (running["run"], "PASS")
        listed = here("list", "--data", str(station.data), "--json").json
        assert [(one["run"], one["verdict"]) for one in listed] == [(running["run"], "PASS")]
        until = time.monotonic() + LONGEST_S
        while station.http.get("/api/runs").json()["total"] != 1:
            assert time.monotonic() < until, "it comes into the store"
            time.sleep(0.2)
        assert here("verify", "--data", str(station.data)).exit_code == 0
