"""`lostmotion line`: scan, run, scan: the loop of an operator at a bench without a screen of its own.

The conditions of a start are those of the station, asked anew for every scan. A bad unit has to be confirmed as put
away before the next one; whoever starts the loop anew confirms it again.
"""

from __future__ import annotations

import os
import select
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

from station.errors import StationError
from station.records.certificate_code import names_a_run
from station.reports.result_text import VERDICT_STYLES
from station.run.next_run import NextRun
from station.web.labels import outbox
from station.web.labels.settings import Labels, load_labels
from station.web.mes.previous_step import PreviousStep, previous_step
from station.web.mes.settings import load_mes
from station.web.models import Models, load_models
from station.web.people import audit
from station.web.people.database import StationDatabase
from station.web.permission import Situation, Wanted, likely_first, refusals, situation_of, unconfirmed, unverified_note
from station.web.scanner import SYMBOLOGIES, ScanError, serial_of

NOK = "NOK"
"""What is scanned from the box for bad units, or typed, once a bad unit is in it."""

ENDINGS = {0: "PASS", 1: "FAIL", 3: "NOT DECIDABLE"}
"""Words for the exit codes of `lostmotion run` that say what the unit is."""

DO = {
    "PASS": "Scan the next unit.",
    "FAIL": f"Put the unit into the NOK box (bad units). Then scan the code on the box, or type {NOK}.",
    "NOT DECIDABLE": "The unit was not measured. Call the technician, or scan it again and say why.",
}
ELSE = "Call the technician to the bench."
READ_BYTES = 4096

Run = Callable[[Sequence[str]], int]
Say = Callable[[str], None]
AskMes = Callable[[str], PreviousStep | None]


def _to_do(now: Situation, verdict: str) -> str:
    """Return what is done with the unit: what its recipe says, and how a bad one is put away here."""
    own = "" if now.job is None else now.job.recipe.what_to_do.after(verdict)
    if not own:
        return DO[verdict]
    return f"{own} Then scan the code on the NOK box, or type {NOK}." if verdict == "FAIL" else own


class NoLabels:
    """A bench without labels."""

    def awaited(self) -> str:
        """Return why the next unit has to wait for a label, in words; '' where it has not."""
        return ""

    def knows(self, scanned: str) -> bool:  # noqa: ARG002 - as below
        """Say whether a scanned text is that of a label."""
        return False

    def read(self, scanned: str) -> str:  # noqa: ARG002 - a bench with labels looks at it
        """Take a scanned text as a label; return what became of it, '' where it is none."""
        return ""


class PrintedLabels(NoLabels):
    """The labels of a data folder."""

    def __init__(self, database: StationDatabase, data: Path, labels: Labels, operator: str | None) -> None:
        self._database, self._data, self._labels = database, data, labels
        self._operator = operator or "line"

    def awaited(self) -> str:
        """Return why the next unit has to wait for a label."""
        with self._database.reading() as connection:
            return outbox.why_not_next(connection, self._data, self._labels)

    def knows(self, scanned: str) -> bool:
        """Say whether a scanned text is that of a label."""
        with self._database.reading() as connection:
            return outbox.is_label(connection, scanned.strip())

    def read(self, scanned: str) -> str:
        """Note that the awaited label was read on its unit, or say which one was scanned."""
        text = scanned.strip()
        with self._database.writing() as connection:
            if not outbox.is_label(connection, text):
                return ""
            told = {"scanned": text, "at": "lostmotion line"}
            try:
                found = outbox.read_back(connection, self._data, self._labels, text, self._operator)
            except outbox.WrongLabelError as error:
                audit.write(connection, self._operator, "read_label", audit.REFUSED, told | {"reasons": [str(error)]})
                return f"REFUSED  {error}"
            told |= {"run": found.run, "serial": found.serial}
            audit.write(connection, self._operator, "read_label", audit.DONE, told)
        return f"The label on unit {found.serial} is the right one. Scan the next unit."


class Line:
    """The loop: takes what was scanned, one text at a time."""

    def __init__(  # noqa: PLR0917 - where it works, and whom it asks and tells
        self,
        data: Path,
        models: Models,
        operator: str | None,
        run: Run,
        say: Say,
        mes: AskMes = lambda _serial: None,
        labels: NoLabels | None = None,
    ) -> None:
        """Begin; `run` measures a unit by options of `lostmotion run` and returns its exit code.

        mes: what the MES says of the previous process step of a serial number. labels: those of the bench, if any.
        """
        self._mes, self._labels = mes, labels or NoLabels()
        self._data, self._models, self._operator = data, models, operator
        self._run, self._say = run, say
        self._confirmed: frozenset[str] = frozenset()
        self._needs_reason = ""
        self.likely = likely_first(data, models)
        """Recipe and bench of the unit that is likely to come next: those of the newest one."""
        self.has_run = False
        """Whether the newest scan has led to a run: what came meanwhile is refused, and not kept for later."""

    def begin(self) -> None:
        """Say what is to be done first."""
        bad = unconfirmed(self._data, self._confirmed)
        self._say(f"The unit of run {bad} is bad. {DO['FAIL']}" if bad else DO["PASS"])

    def take(self, scanned: str) -> None:
        """Do what a scan asks for, or say why not."""
        self.has_run = False
        if self._needs_reason:
            serial, self._needs_reason = self._needs_reason, ""
            self._again(serial, scanned.strip())
            return
        if not scanned.strip():
            return
        bad = unconfirmed(self._data, self._confirmed)
        if scanned.strip().upper() == NOK:
            self._confirmed |= {bad} if bad else frozenset()
            self._say(f"The unit of run {bad} is put away. {DO['PASS']}" if bad else f"No unit is bad. {DO['PASS']}")
            return
        if told := self._labels.read(scanned):
            self._say(told)
            return
        try:
            serial = serial_of(scanned)
        except ScanError as error:
            self._say(f"REFUSED  {error}")
            return
        self._measure(Wanted(serial))

    def _again(self, serial: str, reason: str) -> None:
        """Measure a unit again for a reason, or leave it alone."""
        if not reason:
            self._say(f"{serial} is not measured again. {DO['PASS']}")
        elif self._is_code(serial, reason):
            self._say(
                f"REFUSED  {reason[:60]!r} is no reason, so {serial} is not measured again. Scan the unit on the bench"
            )
        else:
            self._measure(Wanted(serial, reason))

    def _is_code(self, serial: str, scanned: str) -> bool:
        """Say whether what was scanned in place of a reason is the code of a unit, of the box or of a label.

        Another unit may be on the bench by now, and would be measured as the one before.
        """
        if scanned.upper() == NOK or self._labels.knows(scanned):
            return True
        try:
            found = serial_of(scanned)
        except ScanError:
            return names_a_run(scanned) or scanned.startswith(SYMBOLOGIES)
        digits = any(one.isdigit() for one in found)
        return found == serial or (" " not in found and digits and self._models.of(found) is not None)

    def refuse(self, scanned: Sequence[str]) -> None:
        """Say that what was scanned during a run was not taken."""
        for text in scanned:
            self._say(f"REFUSED  {text.strip()[:60]!r} was scanned during a run. Scan it again")

    def _measure(self, wanted: Wanted) -> None:
        now = situation_of(
            self._data, self._models, wanted, busy=False, confirmed=self._confirmed,
            previous_step=self._mes(wanted.serial), label=self._labels.awaited(),
        )  # fmt: skip
        why = refusals(now)
        if [name for name, _ in why] == ["retest_reason"]:
            self._needs_reason = wanted.serial
            self._say(f"{why[0][1]} Scan or type it; an empty line leaves the unit alone.")
            return
        if why:
            for _, text in why:
                self._say(f"REFUSED  {text}")
            return
        self.has_run, self.likely = True, now.likely
        verdict = ENDINGS.get(self._run(self._options(now)), "")
        if verdict:
            self._say(f"{verdict}  {wanted.serial}  {_to_do(now, verdict)}")
        else:
            self._say(f"NO RESULT  {wanted.serial}  {ELSE}")

    def _options(self, now: Situation) -> list[str]:
        wanted, note = now.wanted, unverified_note(now)
        options = [*now.run_options(), "--serial", wanted.serial, "--data", str(self._data)]
        options += ["--operator", self._operator] if self._operator else []
        options += ["--note", note] if note else []
        return options + (["--retest-reason", wanted.retest_reason] if wanted.retest_reason else [])


class Scans:
    """Lines of a scanner on standard input; what ends them is a carriage return, a line feed or both."""

    def __init__(self, handle: int) -> None:
        self._handle = handle
        self._kept = b""

    def next(self) -> str | None:
        """Wait for a line and return it without its end; None when there will be no more."""
        while not any(end in self._kept for end in (b"\r", b"\n")):
            read = os.read(self._handle, READ_BYTES)
            if not read:
                return None
            self._kept += read
        return self._cut()

    def dropped(self) -> list[str]:
        """Return what has come meanwhile, without waiting, and forget it."""
        while select.select([self._handle], [], [], 0.0)[0]:
            read = os.read(self._handle, READ_BYTES)
            if not read:
                break
            self._kept += read
        kept, self._kept = self._kept, b""
        return [text for text in kept.decode(errors="replace").replace("\r", "\n").split("\n") if text.strip()]

    def _cut(self) -> str:
        at = min(place for place in (self._kept.find(b"\r"), self._kept.find(b"\n")) if place >= 0)
        line, self._kept = self._kept[:at], self._kept[at + 1 :]
        if self._kept[:1] == b"\n":
            self._kept = self._kept[1:]
        return line.decode(errors="replace")


def line(data: Path, models: Path | None, operator: str | None, extra: Sequence[str] = ()) -> int:
    """Take scans from standard input until it ends; return 0.

    Raises:
        StationError, RecipeError: the folder cannot be made, or the table of models is wrong.

    """
    try:
        data.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StationError(f"--data {data}: cannot be made: {error.strerror}. Choose another folder") from error
    scans, table = Scans(sys.stdin.fileno()), load_models(data, models)
    with closing(NextRun(own_session=False)) as next_run, _labels_of(data, operator) as labels:
        run = partial(_ran, next_run, extra)
        loop = Line(data, table, operator, run, _told, _mes_of(data), labels)
        loop.begin()
        while True:
            next_run.get_ready(*loop.likely)
            try:
                scanned = scans.next()
            except KeyboardInterrupt:
                return 0
            if scanned is None:
                return 0
            loop.take(scanned)
            if loop.has_run:
                loop.refuse(scans.dropped())


def _mes_of(data: Path) -> AskMes:
    """Return what asks for the word of the MES; one of a folder without `mes.yaml` has none."""
    settings = load_mes(data)
    if settings is None:
        return lambda _serial: None
    database = StationDatabase(data)

    def ask(serial: str) -> PreviousStep:
        with database.reading() as connection:
            return previous_step(connection, settings, serial)

    return ask


@contextmanager
def _labels_of(data: Path, operator: str | None) -> Iterator[NoLabels]:
    """Yield the labels of a data folder, and print them meanwhile."""
    settings = load_labels(data)
    if settings is None:
        yield NoLabels()
        return
    database = StationDatabase(data)
    with closing(database), closing(outbox.Printing(database, data, settings)) as printing:
        printing.start()
        yield PrintedLabels(database, data, settings, operator)


def _ran(next_run: NextRun, extra: Sequence[str], options: Sequence[str]) -> int:
    """Run as a process of its own, which alone is asked to stop by Ctrl-C."""
    # a handler, and not SIG_IGN, which the process would inherit
    before = signal.signal(signal.SIGINT, lambda *_: None)
    try:
        return next_run.start([*options, *extra], stdout=sys.stdout.fileno(), stderr=sys.stderr.fileno()).wait()
    finally:
        signal.signal(signal.SIGINT, before)


def _told(text: str) -> None:
    word = next((word for word in VERDICT_STYLES if text.startswith(word)), "")
    shown = f"\x1b[1;7m {word} \x1b[0m{text[len(word) :]}" if word and sys.stdout.isatty() else text
    sys.stdout.write(f"{shown}\n")
    sys.stdout.flush()
