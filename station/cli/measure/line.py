"""`lostmotion line`: scan, run, scan: the loop of an operator at a bench without a screen of its own.

What a scan leads to is a row of the table of actions, as on the pages: the same start conditions, asked anew for every
scan, and the same lines of the audit trail, of what was refused too.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from pydantic import JsonValue

from station.cli.measure.at_terminal import AtTerminal
from station.cli.measure.scans import Scans
from station.errors import StationError
from station.records.certificate_code import names_a_run
from station.records.data_folder import Store, check_operator
from station.records.master_parts import GOOD_ONE_FAILED
from station.reports.result_text import VERDICT_STYLES
from station.web.actions.perform import perform_here, refuse_here
from station.web.actions.row import BAD_INPUT, OK, Answer
from station.web.actions.runs import unconfirmed_run
from station.web.actions.values import LabelTold, Start
from station.web.bypasses import bypasses_now
from station.web.labels import outbox
from station.web.labels.settings import load_labels
from station.web.mes.settings import load_mes
from station.web.models import ModelsFile, load_models
from station.web.people.accounts import session_here
from station.web.people.badges import is_badge
from station.web.people.database import StationDatabase
from station.web.permission import likely_first
from station.web.scanner import IDENTIFIER, NOK, ScanError, is_nok, serial_of, without_identifier
from station.web.scanner_test import is_test_code
from station.web.settings import load_settings
from station.web.station import Station

PLACE = "lostmotion line"
"""Where an action was done, in the audit trail."""

LABEL = "LABEL"
"""What is scanned from a card, or typed, to have the newest label printed again."""

ENDINGS = {0: "PASS", 1: "FAIL", 3: "NOT DECIDABLE"}
"""Words for the exit codes of `lostmotion run` that say what the unit is."""

DO = {
    "PASS": "Scan the next unit.",
    "FAIL": f"Put the unit into the NOK box (bad units). Then scan the code on the box, or type {NOK}.",
    "NOT DECIDABLE": "The unit was not measured. Call the technician, or scan it again and say why.",
}
ELSE = "Call the technician to the bench."
DURING_A_RUN = "was scanned during a run. Scan it again"

A_BADGE = "This is a badge: nobody logs in here. Scan the unit on the bench"
"""A badge stands neither in the audit trail nor as a reason in a record: it is half of a log-in."""

LONGEST_NOTED = 200
"""Characters of a text that was refused, as the audit trail keeps it."""

Say = Callable[[str], None]


def to_do(own: str, verdict: str) -> str:
    """Return what is done with the unit: what its recipe says, and how a bad one is put away here."""
    if not own:
        return DO[verdict]
    return f"{own} Then scan the code on the NOK box, or type {NOK}." if verdict == "FAIL" else own


class Line:
    """The loop: takes what was scanned, one text at a time."""

    def __init__(self, station: Station, bench: AtTerminal, operator: str | None, say: Say) -> None:
        """Begin; bench: that of the station, whose runs are waited for. operator: who measures, as they say."""
        self._station, self._bench, self._say = station, bench, say
        self._session = session_here(operator, PLACE)
        self._needs_reason = ""
        self.has_run = False
        """Whether the newest scan has led to a run: what came meanwhile is refused, and not kept for later."""

    def begin(self) -> None:
        """Say what is to be done first."""
        with self._station.database.reading() as connection:
            bypasses = bypasses_now(connection)
        for one in bypasses:
            self._say(f"NOTE  {one}")
        bad = unconfirmed_run(self._station)
        self._say(f"The unit of run {bad} is bad. {DO['FAIL']}" if bad else DO["PASS"])

    def take(self, scanned: str) -> None:
        """Do what a scan asks for, or say why not; the loop goes on, also where its own database cannot be read now."""
        self.has_run = False
        with self._going_on():
            self._do(scanned)

    def _do(self, scanned: str) -> None:
        text = scanned.strip()
        if is_badge(self._station.settings, text):
            self._needs_reason = ""
            self._say(f"REFUSED  {A_BADGE}")
        elif self._needs_reason:
            unit, self._needs_reason = self._needs_reason, ""
            self._again(unit, text)
        elif is_nok(text):
            self._put_away()
        elif without_identifier(text).upper() == LABEL:
            self._print_again()
        elif self._is_test_code(scanned):
            if self._done("test_scanner", {"scanned": scanned}):
                self._say("The scanner works. Scan the unit.")
        elif self._is_label(text):
            if (answer := self._done("read_label", {"scanned": text})) and isinstance(answer.said, LabelTold):
                self._say(f"The label on unit {answer.said.serial} is the right one. Scan the next unit.")
        elif text:
            self._measure(scanned)

    def refuse(self, scanned: Sequence[str]) -> None:
        """Say that what was scanned during a run was not taken."""
        for text in scanned:
            if is_badge(self._station.settings, text.strip()):
                self._say(f"REFUSED  {A_BADGE}")
                continue
            with self._going_on():
                self._refused(text, "", [("bench_free", f"{text.strip()[:60]!r} {DURING_A_RUN}")])

    @contextmanager
    def _going_on(self) -> Iterator[None]:
        try:
            yield
        except StationError as error:
            self._say(f"REFUSED  {error}")

    def _put_away(self) -> None:
        bad = unconfirmed_run(self._station)
        if not bad:
            self._say(f"No unit is bad. {DO['PASS']}")
        elif self._done("confirm_nok", {"run": bad}):
            self._say(f"The unit of run {bad} is put away. {DO['PASS']}")

    def _print_again(self) -> None:
        """Have the label of the newest run printed once more: it goes on the unit in the operator's hand.

        That of an earlier run is another unit's, also where it is still awaited.
        """
        run = "".join(one.id for one in Store(self._station.data).newest(1))
        if (answer := self._done("print_label", {"run": run})) and isinstance(answer.said, LabelTold):
            self._say(f"The label of run {run} is printed again, as copy {answer.said.copy_number}. {self._awaited()}")

    def _awaited(self) -> str:
        labels = self._station.labels
        asked = labels is not None and labels.settings.read_back is not None
        return "Put it on the unit and scan it. Throw the old one away." if asked else "Throw the old one away."

    def _again(self, scanned: str, reason: str) -> None:
        """Measure the scanned unit again for a reason, or leave it alone."""
        serial = serial_of(scanned)
        if not reason:
            self._say(f"{serial} is not measured again. {DO['PASS']}")
        elif self._is_code(serial, reason):
            why = f"{reason[:60]!r} is no reason, so {serial} is not measured again. Scan the unit on the bench"
            self._refused(scanned, reason, [("retest_reason", why)])
        else:
            self._measure(scanned, reason)

    def _is_code(self, serial: str, scanned: str) -> bool:
        """Say whether what was scanned in place of a reason is the code of a unit, of the box or of a label.

        Another unit may be on the bench by now, and would be measured as the one before.
        """
        if without_identifier(scanned).upper() in {NOK, LABEL}:
            return True
        if self._is_test_code(scanned) or self._is_label(scanned):
            return True
        try:
            found = serial_of(scanned)
        except ScanError:
            return names_a_run(scanned) or IDENTIFIER.match(scanned) is not None
        digits = any(one.isdigit() for one in found)
        return found == serial or (" " not in found and digits and self._station.models.of(found) is not None)

    def _is_test_code(self, scanned: str) -> bool:
        test = self._station.settings.scanner_test
        return test is not None and is_test_code(test.code, scanned)

    def _is_label(self, text: str) -> bool:
        if self._station.labels is None or not text:
            return False
        with self._station.database.reading() as connection:
            return outbox.is_label(connection, text)

    def _measure(self, scanned: str, reason: str = "") -> None:
        answer = self._performed("start_run", {"scanned": scanned, "retest_reason": reason})
        if [one.id for one in answer.refused] == ["retest_reason"]:
            self._needs_reason = scanned
            self._say(f"{answer.refused[0].text} Scan or type it; an empty line leaves the unit alone.")
            return
        self._say_refused(answer)
        if answer.status != OK:
            return
        self.has_run, serial = True, serial_of(scanned)
        told = {verdict: self._to_do(serial, verdict) for verdict in DO}  # while it runs: as the recipe is now
        verdict = ENDINGS.get(self._bench.wait(), "")
        if verdict:
            self._say(f"{verdict}  {serial}  {told[verdict]}")
        else:
            self._say(f"NO RESULT  {serial}  {ELSE}")

    def _to_do(self, serial: str, verdict: str) -> str:
        of_part = self._bench.to_do_with_part(serial, verdict)
        if of_part and of_part != GOOD_ONE_FAILED:
            return of_part
        return to_do(of_part or self._bench.to_do_after(verdict), verdict)

    def _done(self, action: str, values: dict[str, JsonValue]) -> Answer | None:
        """Do an action; None where it was refused, which is said."""
        answer = self._performed(action, values)
        self._say_refused(answer)
        return answer if answer.status == OK else None

    def _performed(self, action: str, values: dict[str, JsonValue]) -> Answer:
        return perform_here(self._station, self._session, action, values)

    def _say_refused(self, answer: Answer) -> None:
        for one in answer.refused:
            place = f"{one.id}: " if answer.status == BAD_INPUT and one.id in Start.model_fields else ""
            self._say(f"REFUSED  {place}{one.text}")

    def _refused(self, scanned: str, reason: str, why: list[tuple[str, str]]) -> None:
        for _, text in why:
            self._say(f"REFUSED  {text}")
        refuse_here(
            self._station, self._session, "start_run",
            {"scanned": scanned[:LONGEST_NOTED], "retest_reason": reason[:LONGEST_NOTED]}, why,
        )  # fmt: skip


def line(data: Path, models: Path | None, operator: str | None, extra: Sequence[str] = ()) -> int:
    """Take scans from standard input until it ends; return 0.

    Raises:
        StationError, RecipeError: the folder cannot be made, or the table of models is wrong.

    """
    try:
        data.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StationError(f"--data {data}: cannot be made: {error.strerror}. Choose another folder") from error
    name = None if operator is None else check_operator(operator)
    models_file = ModelsFile(data, models)  # before it is read: a change while it is read is seen
    scans, table, settings = Scans(sys.stdin.fileno()), load_models(data, models), load_settings(data)
    settings.use_time_zone()
    bench = AtTerminal(data, likely_first(data, table))
    station = Station(
        data, StationDatabase(data), table, bench, tuple(extra), load_mes(data), settings, load_labels(data),
        models_file=models_file,
    )  # fmt: skip
    with closing(station), _printing(station):
        loop = Line(station, bench, name, _told)
        loop.begin()
        while True:
            bench.get_ready()
            try:
                scanned = scans.next()
            except KeyboardInterrupt:
                return 0
            if scanned is None:
                return 0
            with _for_the_run_alone():
                loop.take(scanned)
            if loop.has_run:
                loop.refuse(scans.dropped())


@contextmanager
def _for_the_run_alone() -> Iterator[None]:
    """Leave Ctrl-C to the run that is on, which alone is asked to stop by it."""
    # a handler, and not SIG_IGN, which the process would inherit
    before = signal.signal(signal.SIGINT, lambda *_: None)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _printing(station: Station) -> Iterator[None]:
    """Print the labels of a data folder meanwhile."""
    if station.labels is None:
        yield
        return
    with closing(outbox.Printing(station.database, station.data, station.labels)) as printing:
        printing.start()
        yield


def _told(text: str) -> None:
    word = next((word for word in VERDICT_STYLES if text.startswith(word)), "")
    shown = f"\x1b[1;7m {word} \x1b[0m{text[len(word) :]}" if word and sys.stdout.isatty() else text
    sys.stdout.write(f"{shown}\n")
    sys.stdout.flush()
