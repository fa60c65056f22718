"""`python -m benchmarks.operator_times [--runs 20]`: how long an operator waits, on the page and on the command line.

Each pair is a run that a scan on the operator's page starts, in a real browser, and one that a shell starts, one after
the other on the same machine. Scan to motion: from the last key of the scan, or from the start of the command, until
the drive of the virtual bench is enabled, by the bench's own log, with the tare before it (100 ms in this recipe). End
of motion to verdict: from when that drive is disabled until the page shows the verdict, or the record is sealed.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from playwright.sync_api import Browser, Page, sync_playwright

from station.records.run_record import MANIFEST, RunRecord
from station.records.seal import is_sealed
from station.run.next_run import SUPERVISOR

ROOT = Path(__file__).parents[1]
SUPPORT = [str(ROOT / "tests" / name) for name in ("", "station", "station/web")]
LONGEST_S = 120.0
ENABLED = "operation enabled"

WATCH = """() => { const seen = window.seen = {}; const word = () => document.querySelector('.lm-word');
new MutationObserver(() => {
  const text = word() && word().innerText; if (text && !(text in seen)) seen[text] = Date.now();
}).observe(document.querySelector('.lm-tile'), {childList: true, subtree: true}); }"""


class Waits(NamedTuple):
    """Two times of one run, both in seconds."""

    to_motion_s: float
    to_verdict_s: float


def motion(folder: Path) -> tuple[float, float]:
    """Return when the drive was enabled and disabled, in seconds since 1970, by the log of the virtual bench."""
    rows = [json.loads(line) for line in (folder / "virtual-bench.jsonl").read_text("utf-8").splitlines()]
    told = [row for row in rows if row["event"] == "drive_state" and ENABLED in row["text"]]
    return told[0]["t_s"], told[-1]["t_s"]


def by_page(page: Page, data: Path, serial: str) -> Waits:
    """Scan a unit on the page; return what the operator waited."""
    before = {path.name for path in data.glob("2*")}
    page.evaluate(WATCH)
    page.keyboard.type(f"]d221{serial}")
    scanned = time.time()
    page.keyboard.press("Enter")
    page.wait_for_function("() => ['PASS', 'FAIL', 'NOT DECIDABLE'].some(word => word in window.seen)")
    shown = page.evaluate("() => Math.max(...Object.values(window.seen))") / 1000.0
    (name,) = {path.name for path in data.glob("2*")} - before
    enabled, disabled = motion(data / name)
    return Waits(enabled - scanned, shown - disabled)


def by_command(recipe: Path, data: Path, serial: str) -> Waits:
    """Run a unit by the command line; return what the operator waited."""
    before = {path.name for path in data.glob("2*")}
    command = [sys.executable, "-m", "station", "run", str(recipe), "--serial", serial, "--data", str(data)]
    started = time.time()
    subprocess.run([*command, "--no-report", "--pace", "fast"], cwd=ROOT, stdout=subprocess.DEVNULL, check=True)  # noqa: S603
    (name,) = {path.name for path in data.glob("2*")} - before
    run = RunRecord(data / name)
    assert is_sealed(run.manifest())  # noqa: S101 - what the second time ends with
    enabled, disabled = motion(run.folder)
    return Waits(enabled - started, (run.folder / MANIFEST).stat().st_mtime - disabled)


def wait_until_ready(server: int) -> None:
    """Wait until the process of the next run waits, as it does when an operator has changed the unit."""
    until = time.monotonic() + LONGEST_S
    while time.monotonic() < until:
        children = [pid for file in Path(f"/proc/{server}/task").glob("*/children") for pid in file.read_text().split()]
        with suppress(OSError):  # one that has ended meanwhile
            waiting = [pid for pid in children if SUPERVISOR.encode() in Path(f"/proc/{pid}/cmdline").read_bytes()]
            if waiting and all(_waits(pid) for pid in waiting):
                return
        time.sleep(0.1)


def _waits(pid: str) -> bool:
    """Say whether a process has used no processor time for half a second: it has loaded all it needs."""

    def used() -> list[str]:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]

    before = used()
    time.sleep(0.5)
    return before == used()


@contextmanager
def started_browser() -> Iterator[Browser]:
    """Yield Chromium, without a screen."""
    browser_path = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=browser_path, args=["--no-sandbox"])
        yield browser
        browser.close()


def open_page(browser: Browser, url: str, password: str) -> Page:
    """Return the operator's page in a context of its own, with an operator logged in."""
    page = browser.new_context(viewport={"width": 1920, "height": 1080}).new_page()
    page.set_default_timeout(LONGEST_S * 1000)
    page.goto(f"{url}/")
    page.fill("#name", "the operator")
    page.fill("#password", password)
    page.keyboard.press("Enter")
    page.wait_for_selector(".lm-word")
    return page


@contextmanager
def operator_page(url: str, password: str) -> Iterator[Page]:
    """Yield the operator's page with an operator logged in."""
    with started_browser() as browser:
        yield open_page(browser, url, password)


def row(title: str, values: list[float]) -> str:
    """Return one line: median, 95th percentile and maximum."""
    ordered = sorted(values)
    p95 = ordered[min(len(ordered) - 1, round(0.95 * len(ordered)) - 1)]
    return f"  {title:44}{statistics.median(ordered):8.2f}{p95:8.2f}{ordered[-1]:8.2f}"


def main() -> None:
    """Measure pairs, and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    count = parser.parse_args().runs
    sys.path[:0] = SUPPORT
    from served import prepared, served  # noqa: PLC0415 - the same server and recipes as in the tests
    from station_support import PASSWORD  # noqa: PLC0415

    page_waits, command_waits = [], []
    with TemporaryDirectory(prefix="lostmotion-operator-") as place:
        data, other = prepared(Path(place) / "runs"), Path(place) / "by-command"
        recipe = data.parent / "recipes" / "good.yaml"
        with served(data) as server, operator_page(server.url, PASSWORD) as page:
            for number in range(count):
                wait_until_ready(server.process.pid)
                page_waits.append(by_page(page, data, f"SN-{number}"))
                wait_until_ready(server.process.pid)
                command_waits.append(by_command(recipe, other, f"SN-{number}"))
                print(f"  {number + 1:3} page {page_waits[-1]}  command line {command_waits[-1]}", flush=True)
    print(f"\n{count} pairs, in s{'':36}{'p50':>8}{'p95':>8}{'max':>8}")
    print(row("scan to motion, page", [one.to_motion_s for one in page_waits]))
    print(row("start to motion, command line", [one.to_motion_s for one in command_waits]))
    print(row("end of motion to verdict, page", [one.to_verdict_s for one in page_waits]))
    print(row("end of motion to sealed, command line", [one.to_verdict_s for one in command_waits]))


if __name__ == "__main__":
    main()
