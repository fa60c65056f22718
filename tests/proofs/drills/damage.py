"""A data folder of twenty runs of every kind, one of which is damaged: what the commands say of the others must stay.

`damage_drill.py` does it often. A damage is one entry of a JSON file replaced or removed, or one byte of any file.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

TESTS = Path(__file__).parents[2]
sys.path[:0] = [str(TESTS), str(TESTS / "station")]

from lostmotion_command import Ran, here  # noqa: E402 - after the path of a script run by hand
from run_copies import desert  # noqa: E402
from run_samples import as_recorded  # noqa: E402
from stored_runs import store_lot  # noqa: E402

from station.own_place import own_place  # noqa: E402
from station.records.ring.ring import W_PID, W_READ, W_WRITTEN, create  # noqa: E402
from station.records.ring.writer import RingWriter  # noqa: E402
from station.records.run_record import RunRecord, process_birth  # noqa: E402
from station.records.samples.scan_record import RECORD_BYTES, unpack  # noqa: E402
from station.run.way_back.recover import recover  # noqa: E402

CUT_AT = 1800
"""Record at which a run was torn off: it is under torque there."""

OWN = "own"
"""Keys and heads of chains, below the folder of the drill."""

WAITING = 200
REPLACEMENTS: tuple[Any, ...] = (
    None, 0, 5, -1, 130, 10**30, 0.5, True, "", "x", "\0", "../../x", [], [1], {}, {"a": None}, ["x", 2],
)  # fmt: skip
GONE = "removed"
NOT_EVIDENCE = frozenset({"report.html", "report.pdf", "loop.png", "time.png", "log.jsonl", ".owner"})
"""Files of a run that no verdict rests on (docs/records.md)."""

OTHERS = ("show", "analyze", "replay", "export", "report")
"""What is asked of a run that is not damaged, beside what is asked of the folder."""

FOLDER: dict[str, tuple[str, ...]] = {
    "capability": ("capability", "--metric", "lost_motion", "--recipe", "inverse"),
    "units": ("units", "--metric", "lost_motion", "--recipe", "inverse"),
}
CRASHED = 70


@dataclass(frozen=True)
class Damage:
    """What was done to which run: file, and the place in it."""

    run: str
    file: str
    place: str
    what: str

    def __str__(self) -> str:
        return f"{self.run}/{self.file} {self.place}: {self.what}"


@dataclass
class Outcome:
    """What one damage did: `wrong` must be empty; `named` by which command it is told."""

    damage: Damage
    wrong: list[str] = field(default_factory=list)
    named: str = ""


class Folder:
    """The data folder and an untouched copy of it, from which everything is put back after each damage."""

    def __init__(self, place: Path, golden: Path, *, report: bool) -> None:
        """Make the runs from `golden`, a record of the golden recipe in virtual time; `report`: reports are asked for.

        A report takes longer than all other commands together.
        """
        self.commands = [one for one in OTHERS if report or one != "report"]
        self.place, self.data, self.kept = place, place / "runs", place / "kept"
        self.own = place / OWN
        assert own_place() == self.own, "whoever asks sets it: what this computer remembers is put back as well"
        self._golden(golden)
        store_lot(self.data)
        self.rings = sorted((place / "rings").glob("*"))
        shutil.copytree(self.data, self.kept, symlinks=True)
        self.ids = sorted(path.parent.name for path in self.data.glob("*/run.json"))
        shutil.copytree(place / "rings", place / "kept-rings")
        shutil.copytree(self.own, place / "kept-own")
        self.way_back = next(one for one in self.ids if one.endswith("-waits"))
        self.deserted = [one for one in self.ids if one.endswith(("-waits", "-ended"))]
        self.sealed = [one for one in self.ids if "files" in json.loads((self.data / one / "run.json").read_bytes())]
        self.expected = {name: self.said(name) for name in self.ids}
        self.folder_without: dict[str, dict[str, Any]] = {}

    def _golden(self, golden: Path) -> None:
        rings = self.place / "rings"
        rings.mkdir()
        kinds = ("complete", "passed", "again", "cut", "torn", "left", "ended", "waits", "going", "early")
        runs = []
        for number, kind in enumerate(kinds):  # all of them before one is concluded: a chain begins behind them
            run = RunRecord(Path(shutil.copytree(golden, self.data / f"20260301T00000{number}.000Z-{kind}")))
            clock = "real" if kind in ("left", "waits") else "virtual"
            manifest = run.read_json("run.json") | {"id": run.id, "serial": kind, "attempt": 1, "clock": clock}
            del manifest["chain"]
            run.write_json("run.json", manifest)
            runs.append(run)
        for run, kind in zip(runs, kinds, strict=True):
            folder = run.folder
            content = as_recorded(run)
            written = run.records()
            if kind in ("cut", "torn", "left", "waits"):
                run.samples.write_bytes(content[: CUT_AT * RECORD_BYTES])
            report = {"state": "finished", "written": written, "lost": 0, "realtime": {"details": {}}}
            torn = kind in ("cut", "torn", "left", "waits", "early")
            ring = rings / "gone"
            if kind == "waits":
                ring = self._ring(rings, folder, content)
            desert(run, ring=ring, report=None if torn else report)
            if kind == "early":
                run.samples.write_bytes(b"")
            if kind == "going":
                run.update(desk={"pid": os.getpid(), "birth": process_birth(os.getpid())}, ring=None)
            elif kind not in ("waits", "ended"):
                recover(run)

    def _ring(self, rings: Path, run: Path, content: bytes) -> Path:
        """Return a ring in which the records after the cut wait, as a scan process left it that was killed as well."""
        import station.records.ring.ring as module  # noqa: PLC0415 - patched for this one call

        before, module.SHARED_MEMORY = module.SHARED_MEMORY, rings
        try:
            path = create(rings, 4 * WAITING, run=run)
        finally:
            module.SHARED_MEMORY = before
        writer = RingWriter(path)
        writer.sequence = writer._words[W_WRITTEN] = writer._words[W_READ] = CUT_AT
        for number in range(CUT_AT, CUT_AT + WAITING):
            scan, image, orders = unpack(content[number * RECORD_BYTES :][:RECORD_BYTES])
            assert writer.append(scan, 0, 0, image, orders)
        writer._words[W_PID] = 0  # its process is dead
        writer.close()
        return path

    # --- asking

    def said(self, name: str) -> dict[str, Any]:
        """Return what every command says of one run, with what differs from call to call left out."""
        return {command: self.ask(command, name) for command in self.commands}

    def ask(self, command: str, name: str) -> tuple[int, Any]:
        out = self.place / "out"
        words = [command, name, "--data", str(self.data), "--json"]
        words += ["--out", str(out / "x.parquet" if command == "export" else out)] if command in OUT else []
        out.mkdir(exist_ok=True)
        return plain(self.run(*words))

    def of_the_folder(self, damaged: str | None) -> dict[str, Any]:
        """Return what is said of the folder as a whole: the statistics, and the recovery, which concludes its run."""
        found = {name: plain(self.run(*words, "--data", str(self.data), "--json")) for name, words in FOLDER.items()}
        found["recover"] = plain(self.run("recover", "--data", str(self.data), "--yes"))
        if damaged != self.way_back:
            self.put_back(self.way_back)
        return found

    def rows(self) -> dict[str, Any]:
        listed = self.run("list", "--data", str(self.data), "--json")
        return {row["run"]: row for row in listed.json}

    def run(self, *words: str) -> Ran:
        ran = here(*words)
        if ran.exit_code == CRASHED:
            message = f"{' '.join(words)}: exit 70: {ran.err}"
            raise AssertionError(message)
        return ran

    # --- damaging

    def damages(self, seed: int, count: int) -> Iterator[Damage]:
        """Draw damages, and do each when it is yielded; everything is put back behind it."""
        drawn = random.Random(seed)  # noqa: S311 - to be drawn again
        for number in range(count):
            name = drawn.choice(self.ids)
            damage = self._field(drawn, name) if number % 2 else self._byte(drawn, name)
            try:
                yield damage
            finally:
                self.put_back(name)

    def put_back(self, name: str) -> None:
        shutil.rmtree(self.data / name)
        shutil.copytree(self.kept / name, self.data / name)
        for path in self.data.glob("store.sqlite3*"):
            path.unlink()
        for path in self.kept.iterdir():
            if path.is_file() and not path.name.startswith("store.sqlite3"):
                shutil.copy2(path, self.data / path.name)
        shutil.rmtree(self.own)
        shutil.copytree(self.place / "kept-own", self.own)
        for path in (self.place / "kept-rings").glob("*"):
            shutil.copy2(path, self.place / "rings" / path.name)

    def _field(self, drawn: random.Random, name: str) -> Damage:
        files = [path for path in sorted((self.data / name).glob("*.json")) if path.stat().st_size]
        # Half of them in the manifest: it is read by every command, of every run.
        path = self.data / name / "run.json" if drawn.random() < 0.5 else drawn.choice(files)
        content = json.loads(path.read_bytes())
        places = list(_places(content))
        holder, key, place = drawn.choice(places)
        value = drawn.choice((*REPLACEMENTS, GONE))
        if value is GONE:
            del holder[key]
        else:
            holder[key] = value
        path.write_text(json.dumps(content))
        return Damage(name, path.name, place, f"{value!r}"[:40])

    def _byte(self, drawn: random.Random, name: str) -> Damage:
        files = [path for path in sorted((self.data / name).rglob("*")) if path.is_file() and path.stat().st_size]
        path = self.data / name / "run.json" if drawn.random() < 0.3 else drawn.choice(files)
        content = bytearray(path.read_bytes())
        at, bit = drawn.randrange(len(content)), 1 << drawn.randrange(8)
        content[at] ^= bit
        path.write_bytes(content)
        return Damage(name, str(path.relative_to(self.data / name)), f"byte {at}", f"bit {bit} flipped")

    # --- judging

    def judge(self, damage: Damage, drawn: random.Random, *, others: int) -> Outcome:
        """Ask everything with one run damaged, and compare what is said of the others with what was said before."""
        found, name = Outcome(damage), damage.run
        self._guarded(found, lambda: self._judge_list(found))
        self._guarded(found, lambda: self._judge_folder(found))
        left = [one for one in self.ids if one != name]
        for other in drawn.sample(left, others):
            for command in self.commands:
                self._guarded(found, lambda command=command, other=other: self._same(found, command, other))
        for one in self.deserted:
            if one != name:
                self._guarded(found, lambda one=one: self._judge_resume(found, one))
        self._judge_own(found)
        return found

    def _guarded(self, found: Outcome, step: Any) -> None:
        try:
            step()
        except AssertionError as error:
            found.wrong.append(" ".join(str(error).split())[:400])

    def _same(self, found: Outcome, command: str, other: str) -> None:
        now, before = self.ask(command, other), self.expected[other][command]
        if now != before:
            found.wrong.append(f"{command} {other}: {_first_difference(before, now)}")

    def _judge_list(self, found: Outcome) -> None:
        if not self.folder_without:
            self.folder_without[""] = self.rows_kept()
        rows, before = self.rows(), self.folder_without[""]
        for other in self.ids:
            if other != found.damage.run and rows.get(other) != before[other]:
                found.wrong.append(f"list: {other}: {_first_difference(before[other], rows.get(other))}")
        own = rows.get(found.damage.run)
        if own != before[found.damage.run]:
            found.named = "list"

    def rows_kept(self) -> dict[str, Any]:
        """Return the rows of the untouched copy, as if it lay in the data folder."""
        listed = self.run("list", "--data", str(self.kept), "--json")
        return {row["run"]: row for row in listed.json}

    def _judge_folder(self, found: Outcome) -> None:
        """Statistics are those with the run, or those without it: it is left out where it is damaged."""
        name = found.damage.run
        now = self.of_the_folder(name)
        possible = [self._of_copy(None), self._of_copy(name)]
        for what, said in now.items():
            if what == "recover" and name == self.way_back:
                continue  # it goes by this very run
            if all(_figures(said) != _figures(one[what]) for one in possible):
                found.wrong.append(f"{what}: {_first_difference(possible[0][what], said)}")

    def _of_copy(self, without: str | None) -> dict[str, Any]:
        key = without or "with all"
        if key not in self.folder_without:
            aside = self.place / "aside"
            damaged = self.place / "damaged"
            self.data.rename(damaged)
            shutil.copytree(self.kept, self.data)
            try:
                if without is not None:
                    (self.data / without).rename(aside)
                self.folder_without[key] = self.of_the_folder(without)
            finally:
                shutil.rmtree(self.data)
                shutil.rmtree(aside, ignore_errors=True)
                damaged.rename(self.data)
        return self.folder_without[key]

    def _judge_resume(self, found: Outcome, name: str) -> None:
        ran = self.run("resume", name, "--data", str(self.data), "--no-report", "--json")
        state = json.loads((self.data / name / "run.json").read_bytes())["state"]
        if state == "recording":
            found.wrong.append(f"resume {name}: left as it was: {ran.err.strip()[:200]}")
        self.put_back(name)

    def _judge_own(self, found: Outcome) -> None:
        """Ask of the damaged run itself: nothing crashes, and some command names the damage."""
        name = found.damage.run
        for command in [*self.commands, "show to a person", "conclude", "resume"]:
            words = [command.split()[0], name, "--data", str(self.data)]
            words += [] if " " in command else ["--json"]
            words += ["--out", str(self.place / "out" / "own.parquet")] if command == "export" else []
            words += ["--out", str(self.place / "out")] if command == "report" else []
            words += ["--no-report"] if command == "resume" else []
            try:
                ran = self.run(*words)
            except AssertionError as error:
                found.wrong.append(" ".join(str(error).split())[:400])
                continue
            told = ran.out + ran.err
            names = found.damage.file in told or Path(found.damage.file).name in told
            if not found.named and (names or any(word in told for word in TOLD)):
                found.named = command


OUT = ("export", "report")
TOLD = ("damaged", "altered", "CRC", "not sound", "another program")


def plain(ran: Ran) -> tuple[int, Any]:
    """Return code and output without what differs from call to call."""
    try:
        said = ran.json
    except ValueError:
        said = ran.out + ran.err
    if isinstance(said, dict):
        said = {key: value for key, value in said.items() if key not in ("seconds", "scans_per_s", "bytes")}
    return ran.exit_code, said


def _figures(said: tuple[int, Any]) -> Any:
    code, what = said
    if isinstance(what, dict):
        what = {key: value for key, value in what.items() if key not in ("left_out", "notes")}
    elif isinstance(what, str):
        what = "\n".join(line for line in what.splitlines() if not line.startswith("WARNING  run "))
    return code, what


def _places(content: Any, path: str = "") -> Iterator[tuple[Any, Any, str]]:
    """Yield every entry of a JSON document: its holder, its key, its place in words."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in pairs:
        place = f"{path}.{key}" if path else str(key)
        yield content, key, place
        yield from _places(value, place)


def _first_difference(before: Any, now: Any) -> str:
    if isinstance(before, dict) and isinstance(now, dict):
        for key in before.keys() | now.keys():
            if before.get(key) != now.get(key):
                return f"{key}: {_first_difference(before.get(key), now.get(key))}"
    return f"was {str(before)[:150]}, is {str(now)[:150]}"
