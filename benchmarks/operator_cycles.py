"""`python -m benchmarks.operator_cycles [--cycles 5000] [--minutes M] [--restarts 6]`: what grows on an operator page.

A cycle is a scan on one page, its run, and the verdict on the page; every 20th unit is a bad one, which is put away by
a click. The runs are forks of one loaded process (`benchmarks.forked_runs`), most of them in virtual time. Memory of
server and browser is that after the page has collected its garbage, with a line fitted to what follows the first
tenth. Then a station is served as it comes, and its server killed again and again, idle and in the middle of runs.
"""

from __future__ import annotations

import argparse
import json
import signal
import socket
import statistics
import sys
import time
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.browser_memory import Memory, memory_of, processes_of, used_s
from benchmarks.operator_times import SUPPORT, operator_page

if TYPE_CHECKING:
    from playwright.sync_api import Page

BAD_ONE_IN = 20
FIRST_TENTH = 0.1
LOOKS = 50
"""How often memory is looked at."""

MOST_GROWTH = 0.05
AWAY_S = (0.0, 1.0, 4.0, 15.0)
"""For how long a server that was killed is away before it is started again [s]."""

SHOWS = """([serial, words]) => {
  const word = document.querySelector('.lm-word'), unit = document.querySelector('.lm-serial');
  return word && unit && unit.innerText.split(' ')[0] === serial && words.includes(word.innerText); }"""
CONNECTED = "() => window.marked === undefined && window.socket && window.did_handshake && window.socket.connected"
VERDICTS = ["PASS", "FAIL", "NOT DECIDABLE"]
PUT_AWAY = "button.lm-nok"
PUT_AWAY_SHOWN = "() => document.querySelector('.lm-tile.lm-put-away')"


def wait_for(page: Page, condition: str, given: Any = None) -> None:
    """Wait for a condition of the page, and keep nothing of it in the page."""
    page.wait_for_function(condition, arg=given, polling=50).dispose()


def scan(page: Page, serial: str) -> None:
    """Scan a unit as a scanner with a prefix types it."""
    page.keyboard.type(f"]d221{serial}")
    page.keyboard.press("Enter")


def cycle(page: Page, number: int, after_bad: bool) -> bool:  # noqa: FBT001 - what the cycle before says
    """Scan a unit and wait for its verdict on the page; return whether it was a bad one."""
    bad = number % BAD_ONE_IN == 0
    serial = f"{'BAD' if bad else 'SN'}-{number}"
    if after_bad:
        page.click(PUT_AWAY)
        wait_for(page, PUT_AWAY_SHOWN)
    scan(page, serial)
    wait_for(page, SHOWS, [serial, ["FAIL" if bad else "PASS"]])
    return bad


def grown(cycles: list[int], values: list[float]) -> tuple[float, float]:
    """Return the growth of a fitted line per 1 000 cycles, and as a share from the first tenth to the end."""
    first = FIRST_TENTH * cycles[-1]
    chosen = [(at, value) for at, value in zip(cycles, values, strict=True) if at >= first]
    slope, at_zero = np.polyfit([at for at, _ in chosen], [value for _, value in chosen], 1)
    start = at_zero + slope * first
    return 1000.0 * slope, slope * (cycles[-1] - first) / start


def told(looks: dict[int, Memory]) -> bool:
    """Print memory over the cycles, and whether it grows less than it may."""
    print(f"\n{'cycles':>8}" + "".join(f"{name:>14}" for name in Memory._fields))
    shown = list(looks)
    for at in shown[:: max(1, len(shown) // 12)] + shown[-1:]:
        print(f"{at:8}" + "".join(f"{value:14.1f}" for value in looks[at]))
    well = True
    print("from the first tenth on, by a fitted line:")
    for index, name in enumerate(Memory._fields):
        per_1000, share = grown(shown, [float(one[index]) for one in looks.values()])
        well &= share < MOST_GROWTH
        print(f"  {name:14}{per_1000:+10.3f} per 1 000 cycles{100.0 * share:+9.2f} %")
    return well


def endure(data: Path, cycles: int, minutes: float, wires_one_in: int) -> bool:
    """Let one page go through its cycles; return whether little enough has grown."""
    from served import served_by  # noqa: PLC0415 - the same server and recipes as in the tests
    from station_support import PASSWORD  # noqa: PLC0415

    command = [sys.executable, "-m", "benchmarks.forked_runs", str(data), "--wires-one-in", str(wires_one_in)]
    until = time.monotonic() + 60.0 * minutes
    looks: dict[int, Memory] = {}
    lasted: list[float] = []
    with served_by(command, data) as server, operator_page(server.url, PASSWORD) as page:
        browser, after_bad, looked_s = page.context.browser, False, 0.0
        every_s = 60.0 * minutes / LOOKS
        for number in range(1, cycles + 1):
            began = time.monotonic()
            after_bad = cycle(page, number, after_bad)
            lasted.append(time.monotonic() - began)
            last = number == cycles or time.monotonic() > until
            if last or number % max(1, cycles // LOOKS) == 0 or time.monotonic() - looked_s > every_s:
                looks[number], looked_s = memory_of(server.process.pid, browser, page), time.monotonic()
                print(f"{number:6} {statistics.median(lasted[-100:]):.2f} s {looks[number]}", flush=True)
            if last:
                break
    ordered = sorted(lasted)
    print(f"{len(lasted)} of {cycles} cycles; one takes {statistics.median(ordered):.2f} s", end=", ")
    print(f"95th percentile {ordered[int(0.95 * len(ordered)) - 1]:.2f} s")
    return told(looks)


def on_port(data: Path, port: int) -> AbstractContextManager[Any]:
    """Serve as it comes: a paced bench, a process for each run."""
    from served import served_by  # noqa: PLC0415

    found: AbstractContextManager[Any] = served_by(
        [sys.executable, "-m", "station", "serve", "--port", str(port), "--data", str(data)], data
    )
    return found


def restarts(data: Path, count: int) -> bool:
    """Kill and start the server again and again under one page; return whether the page was soon back and right."""
    from station_support import PASSWORD  # noqa: PLC0415

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    longest, most_s, well = 0.0, 0.0, True
    with ExitStack() as servers:
        server = servers.enter_context(on_port(data, port))
        page = servers.enter_context(operator_page(server.url, PASSWORD))
        for number in range(count):
            serial, away_s = f"SN-{90000 + number}", AWAY_S[number // 2 % len(AWAY_S)]
            in_run = number % 2 == 0
            if in_run:
                scan(page, serial)
                wait_for(page, SHOWS, [serial, ["TESTING"]])
            page.evaluate("window.marked = true")
            server.kill()
            time.sleep(away_s)
            server = servers.enter_context(on_port(data, port))
            started, used = time.monotonic(), work_s(server, page)
            wait_for(page, CONNECTED)
            now = server_now(server)
            words = ["TESTING"] if now["stage"] == "running" else VERDICTS
            wait_for(page, SHOWS, [serial if in_run else now["serial"], words])
            back_s, worked_s = time.monotonic() - started, work_s(server, page) - used
            if in_run:
                wait_for(page, SHOWS, [serial, ["PASS", "FAIL", "NOT DECIDABLE"]])
            word, unit = page.inner_text(".lm-word"), page.inner_text(".lm-serial").split()[0]
            sealed = verdict_of(data, unit)
            well &= word == sealed and back_s < 5.0
            longest, most_s = max(longest, back_s), max(most_s, worked_s)
            print(f"  killed {'in a run' if in_run else 'at rest '}  away {away_s:4.1f} s  shown again after", end=" ")
            print(f"{back_s:.2f} s ({worked_s:.1f} s of work, {now['stage']}); then {unit} {word}", end=", ")
            print(f"its record says {sealed}", flush=True)
    print(f"{count} restarts: the page showed the true state {longest:.2f} s after the server listened, at the latest,")
    print(f"with {most_s:.1f} s of processor time of server and browser at most: what an idle computer takes")
    return well


def work_s(server: Any, page: Page) -> float:
    """Return the processor time of server and browser up to now [s]."""
    browser = page.context.browser
    return used_s(server.process.pid) + sum(used_s(pid) for pid in processes_of(browser))


def server_now(server: Any) -> dict[str, Any]:
    """Return what the bench does by the server's own word."""
    if not server.csrf:
        server.log_in("operator")
    found: dict[str, Any] = server.now()
    return found


def verdict_of(data: Path, serial: str) -> str:
    """Return the verdict in the sealed record of a unit."""
    (folder,) = data.glob(f"2*-{serial}")
    return str(json.loads((folder / "result.json").read_bytes())["verdict"])


def main() -> int:
    """Go through the cycles, then through the restarts; 1 where something grows or is late."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", type=int, default=5000)
    parser.add_argument("--minutes", type=float, default=600.0, help="longest time of the cycles")
    parser.add_argument("--restarts", type=int, default=8)
    parser.add_argument("--wires-one-in", type=int, default=20, help="one run of so many by processes and sockets")
    asked = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the server and the browser end with it
    sys.path[:0] = SUPPORT
    from served import prepared  # noqa: PLC0415

    well = True
    with TemporaryDirectory(prefix="lostmotion-cycles-") as place:
        if asked.cycles:
            well &= endure(prepared(Path(place) / "cycles" / "runs"), asked.cycles, asked.minutes, asked.wires_one_in)
        if asked.restarts:
            well &= restarts(prepared(Path(place) / "restarts" / "runs"), asked.restarts)
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
