"""`python -m benchmarks.live_browsers [--browsers 20] [--pairs 4] [--sockets]`: who looks must not disturb.

Runs by the wall clock in pairs, with and without browsers that show the live page; the browsers share the computer
with scan, virtual bench and server, which they do not at a real bench. Told are missed periods and lateness of the
scan, the processor time of each, and how old the newest point on the pages is. `--sockets`: clients of the page's
socket instead of browsers, which draw nothing, as if the browsers were on computers of their own.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from benchmarks.browser_memory import descendants, processes_of, used_s
from benchmarks.live_ages import NOTE_DRAWINGS, Ages, ages_of, keep_samples, samples_of
from benchmarks.operator_times import SUPPORT, open_page, started_browser

SERVE = """import sys, pathlib; from station.web.server import Served, serve
serve(Served(pathlib.Path(sys.argv[1]), "127.0.0.1", 0, run_options=("--wall-clock",)))"""
LOAD = {
    "recipe": {"name": "live"},
    "sequence": [
        {"home": {"tare_time": "100 ms", "torque_in_tare": "0.05 N·m", "torque_out_tare": "5 N·m"}},
        {"lock": {"holding_torque": "600 N·m", "proof_torque": "5 %", "max_motion": "0.2 arcmin"}},
        {"calibrate": {"peak_torque": "30 %", "torque_rate": "80 N·m/s", "dwell": "40 ms"}},
        {"torque_cycles": {"count": 3, "peak_torque": "30 %", "torque_rate": "80 N·m/s", "dwell": "40 ms"}},
        {"unload": {"torque_rate": "300 N·m/s"}},
        {"release": {"max_torque": "3 %"}},
    ],
    "metrics": [{"id": "torque_ratio_slope"}],
}
KINDS = {"scan_process": "scan", "virtual_bench_process": "virtual bench", "station.scan": "scan"}
OLDEST_MS = 150.0


class Measured(NamedTuple):
    """One run: missed periods, lateness [µs], and shares of one core by who used them."""

    missed: int
    p99_us: float
    longest_us: float
    shares: dict[str, float]


class Meter:
    """Who has used how much processor time: server, the processes of the run, and whoever looks."""

    def __init__(self, server: int, others: Callable[[], dict[int, str]]) -> None:
        self._server, self._others = server, others
        self._first: dict[int, tuple[str, float]] = {}
        self._last: dict[int, float] = {}
        self._began_s = time.monotonic()

    def look(self) -> None:
        """Look at all processes that are there."""
        for pid in descendants(self._server):
            self._note(pid, "server" if pid == self._server else _kind(pid))
        for pid, kind in self._others().items():
            self._note(pid, kind)

    def _note(self, pid: int, kind: str) -> None:
        used = used_s(pid)
        self._first.setdefault(pid, (kind, used))
        self._last[pid] = max(used, self._last.get(pid, 0.0))

    def shares(self) -> dict[str, float]:
        """Return the share of one core that each kind has used since the first look."""
        lasted_s, found = time.monotonic() - self._began_s, Counter[str]()
        for pid, (kind, used) in self._first.items():
            found[kind] += (self._last[pid] - used) / lasted_s
        return dict(found)


def _kind(pid: int) -> str:
    try:
        words = Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return "supervisor"
    return next((kind for name, kind in KINDS.items() if name in words), "supervisor")


class Station:
    """A server whose runs are by the wall clock, and what is measured of one run."""

    def __init__(self, server: Any, folder: Path) -> None:
        self.server, self._folder, self._count = server, folder, 0
        server.log_in("operator")

    def run(self, others: Callable[[], dict[int, str]]) -> tuple[Measured, Path, Path]:
        """Measure a unit; return its timing, its folder, and its samples as they came."""
        self._count += 1
        serial, kept = f"SN-{self._count}", self._folder / f"samples-{self._count}"
        answer = self.server.post("start_run", {"scanned": serial}, f"run {self._count}")
        assert answer.status_code == 200, answer.text  # noqa: S101 - nothing to measure else
        self.server.wait("running")
        (folder,) = self.server.data.glob(f"2*-{serial}")
        while not keep_samples(folder, kept):
            time.sleep(0.1)
        meter = Meter(self.server.process.pid, others)
        while self.server.now()["stage"] == "running":
            meter.look()
            time.sleep(0.5)
        shares = meter.shares()
        told = json.loads((folder / "result.json").read_bytes())["timing"]
        late = told["lateness_us"]
        return Measured(told["missed"], late["p99"], late["max"], shares), folder, kept


class Pages:
    """Browsers that show the live page while they are asked to."""

    def __init__(self, url: str, password: str, count: int, browser: Any) -> None:
        self._browser = browser
        self._pages = [open_page(browser, url, password) for _ in range(count)]
        self._url = url
        for page in self._pages:
            page.add_init_script(NOTE_DRAWINGS)
            page.on("console", lambda told: print(f"  the page says: {told.text}"))

    def look(self) -> None:
        """Show the page, and note each drawing."""
        for page in self._pages:
            page.goto(f"{self._url}/")
            page.wait_for_selector(".lm-word")
            page.wait_for_function("() => document.querySelector('.nicegui-echart canvas')").dispose()

    def leave(self) -> None:
        """Show nothing."""
        for page in self._pages:
            page.goto("about:blank")

    def processes(self) -> dict[int, str]:
        """Return the processes of the browser."""
        return dict.fromkeys(processes_of(self._browser), "browsers")

    def ages(self, folder: Path, kept: Path) -> list[Ages]:
        """Return how old the newest point was on each page."""
        shown, at_ms = samples_of(folder, kept)
        return [ages_of(page.evaluate("window.seen"), shown, at_ms) for page in self._pages]


class Sockets:
    """As many clients of the page's socket, in one process."""

    def __init__(self, url: str, password: str, count: int) -> None:
        self._words, self._said = [sys.executable, "-m", "benchmarks.page_sockets", url, str(count)], password
        self._process: subprocess.Popen[str] | None = None

    def look(self) -> None:
        """Open the sockets."""
        self._process = subprocess.Popen(self._words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)  # noqa: S603
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None and stdout is not None  # noqa: S101, PT018 - both are pipes
        stdin.write(f"the operator\t{self._said}\n")
        stdin.flush()
        if stdout.readline() != "open\n":
            raise SystemExit("the sockets were not opened: see above")

    def leave(self) -> None:
        """Close the sockets."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def ages(self, folder: Path, kept: Path) -> list[Ages]:
        """Close the sockets; return how old the newest point was that each of them had."""
        assert self._process is not None  # noqa: S101 - they looked
        told = json.loads(self._process.communicate("tell\n")[0])
        self._process = None
        print(f"  {told['rate'] / 1000.0:.1f} kB/s came to all sockets together")
        shown, at_ms = samples_of(folder, kept)
        return [ages_of(one, shown, at_ms) for one in told["seen"]]

    def processes(self) -> dict[int, str]:
        """Return the process of the sockets."""
        return {} if self._process is None else {self._process.pid: "sockets"}


@contextmanager
def lookers(url: str, password: str, count: int, *, sockets: bool) -> Iterator[Pages | Sockets]:
    """Yield who looks."""
    if sockets:
        yield Sockets(url, password, count)
        return
    with started_browser() as browser:
        yield Pages(url, password, count, browser)


def recipe_of(folder: Path) -> tuple[Path, Path]:
    """Write a recipe of half a minute at 1 ms and a bench that a busy computer does not trip."""
    from patient import OPEN_GATES, PATIENT_INTERLOCKS, patient_bench, write_changed  # noqa: PLC0415
    from station_support import GOLDEN  # noqa: PLC0415

    changes = (LOAD, {"sampling": {"period": "1 ms"}}, PATIENT_INTERLOCKS, OPEN_GATES)
    return write_changed(GOLDEN, folder / "live.yaml", *changes), patient_bench(folder)


def told(title: str, runs: list[Measured]) -> None:
    """Print the runs of one kind."""
    kinds = sorted({kind for one in runs for kind in one.shares})
    missed = ", ".join(str(one.missed) for one in runs)
    shares = ", ".join(f"{kind} {statistics.median(one.shares.get(kind, 0.0) for one in runs):.2f}" for kind in kinds)
    print(f"{title}: missed periods {missed}; lateness p99 ", end="")
    print(f"{statistics.median(one.p99_us for one in runs):.0f} µs (", end="")
    print(", ".join(f"{one.p99_us:.0f}" for one in runs) + ") longest ", end="")
    print(", ".join(f"{one.longest_us / 1000.0:.1f}" for one in runs) + f" ms; cores: {shares}", flush=True)


def main() -> None:
    """Measure pairs, and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--browsers", type=int, default=20)
    parser.add_argument("--pairs", type=int, default=4)
    parser.add_argument("--sockets", action="store_true", help="clients of the page's socket, which draw nothing")
    asked = parser.parse_args()
    sys.path[:0] = SUPPORT
    from served import prepared, served_by  # noqa: PLC0415 - the same server and accounts as in the tests
    from station_support import PASSWORD, released  # noqa: PLC0415

    runs: dict[bool, list[Measured]] = {False: [], True: []}
    ages: list[Ages] = []
    with TemporaryDirectory(prefix="lostmotion-live-") as place:
        folder = Path(place)
        data = prepared(folder / "runs")
        recipe, bench = recipe_of(folder)
        released(data, recipe.read_bytes())
        row = f'{{model: P1, serial: "SN-[0-9]+", recipe: {recipe}, bench: {bench}}}'
        (data / "models.yaml").write_text(f"models:\n  - {row}\n", encoding="utf-8")
        command = [sys.executable, "-c", SERVE, str(data)]
        with (
            served_by(command, data) as server,
            lookers(server.url, PASSWORD, asked.browsers, sockets=asked.sockets) as who,
        ):
            station = Station(server, folder)
            for pair in range(asked.pairs):
                for looks in (False, True) if pair % 2 else (True, False):
                    (who.look if looks else who.leave)()
                    time.sleep(2.0)
                    one, run, kept = station.run(who.processes)
                    runs[looks].append(one)
                    if looks:
                        ages += who.ages(run, kept)
                    print(f"  pair {pair + 1} {'with' if looks else 'without'} {one}", flush=True)
            who.leave()
    print(f"{asked.pairs} pairs, {asked.browsers} {'sockets' if asked.sockets else 'browsers'}, {os.cpu_count()} cores")
    told("with   ", runs[True])
    told("without", runs[False])
    for name, values in (
        ("when drawn", [one.drawn_ms for one in ages]),
        ("at any moment", [one.any_ms for one in ages]),
    ):
        if values and np.concatenate(values).size:
            p50, p95, p99 = np.percentile(np.concatenate(values), (50, 95, 99))
            within = "" if name == "when drawn" else f" ({'within' if p95 <= OLDEST_MS else 'over'} {OLDEST_MS:.0f} ms)"
            print(f"newest point {name}: {p50:.0f} ms, 95th percentile {p95:.0f} ms{within}, 99th {p99:.0f} ms")
    if ages:
        print(f"drawings a page and run: {statistics.median(one.drawings for one in ages):.0f}")


if __name__ == "__main__":
    main()
