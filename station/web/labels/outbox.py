"""Labels of sealed runs: printed once each, by a thread of the server, and awaited until a scan has read them.

The chain of runs is the source, as for the MES: each entry that seals a run with a verdict that gets a label becomes a
row, in the transaction that notes how far the chain was read. A label is noted as sent before it is sent. So it never
comes twice by itself: a second label with PASS could be put on another unit. Where nobody knows whether it came out, a
person looks, and scans it or has it printed again.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from threading import Event, Thread
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Connection, delete, insert, select, update

from station.errors import StationError
from station.records.chain.entries import Fields
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.results.sealed_runs import result_of, sealed_since
from station.wall_clock import WALL_CLOCK, now_text
from station.web.labels.of_run import NotYetError, label_for, label_of
from station.web.labels.printer import Line, PrinterError, connected
from station.web.labels.settings import Labels
from station.web.labels.template import LabelError
from station.web.people.database import LABELS, LABELS_READ, StationDatabase
from station.web.people.read_chain import begin_at_the_end, read_on
from station.web.scanner import without_identifier

LOOK_EVERY_S = 0.3
WAIT_S = 2.0
"""Wait before a printer that could not print is asked again."""

LONGEST_END_S = 5.0
"""For how long the end of the server waits for the printer's answer."""

ASK_EVERY_S = 0.1
"""How often a printer is asked whether the label has come out."""

TO_PRINT, SENT, PRINTED, NOT_MADE = "to print", "sent", "printed", "not made"

NOT_SET_UP, MEASURED_AGAIN = "labels.yaml was taken away", "measured again"
NOT_ASKED = "labels.yaml does not ask for a scan of the labels"
NOBODY_PRINTED = "the run was concluded while no labels were printed, and it is not the newest run"
"""Why a label is not awaited that nobody has read or set aside."""


class Awaited(NamedTuple):
    """The oldest label that is not on its unit yet: of which run and unit, how far it is, and what is in its way."""

    run: str
    serial: str
    stage: str
    trouble: str = ""

    def __str__(self) -> str:
        label = f"The label of unit {self.serial}"
        if self.stage == NOT_MADE:
            return f"{label} cannot be made: {self.trouble}. Call the technician."
        if self.stage == TO_PRINT and self.trouble == MEASURED_AGAIN:
            return f"{label} is not printed: the unit is being measured again."
        if self.stage == TO_PRINT and self.trouble:
            return f"{label} is not printed. {self.trouble}. Then it is printed by itself."
        if self.stage == TO_PRINT:
            return f"{label} is being printed."
        if self.stage == SENT:
            found = "If it is there, put it on the unit and scan it. If not, print it again."
            return f"{label} may be printed or not. {found}"
        return f"{label} was not read yet. Put it on the unit and scan it."


def begin_here(database: StationDatabase, data: Path, labels: Labels | None = None) -> None:
    """Note where the chain ends when labels are set up: earlier runs get none.

    labels: as they are set up now. Where no scan is asked for, none is later of those that are printed by now.
    """
    with database.writing() as connection:
        if labels is not None and labels.settings.read_back is None:
            printed = LABELS.c.done_at.is_(None) & LABELS.c.printed_at.is_not(None)
            connection.execute(update(LABELS).where(printed).values(done_at=now_text(), why=NOT_ASKED, label=""))
        begin_at_the_end(connection, LABELS_READ, data)


def not_set_up(connection: Connection) -> list[str]:
    """Forget where the chain was read, as labels are set up no more; return the runs whose labels are not awaited now.

    Else whoever sets them up again gets labels of units that have long left, one after the other.
    """
    connection.execute(delete(LABELS_READ))
    left = LABELS.c.done_at.is_(None)
    runs = list(connection.execute(select(LABELS.c.run).where(left).order_by(LABELS.c.number)).scalars())
    connection.execute(update(LABELS).where(left).values(done_at=now_text(), why=NOT_SET_UP, label=""))
    return runs


def collect(database: StationDatabase, data: Path, labels: Labels, *, at_start: bool = False) -> int:
    """Make a label for each run that was sealed since the last look and gets one; return how many.

    A label of the same unit from before counts no more. at_start: nobody has looked for a while, so only the newest run
    can be of a unit that is still at the bench; the labels of others are printed by whoever asks for them.

    Raises:
        StationError: the chain or the database cannot be read.

    """

    def put(connection: Connection, made: Sequence[tuple[Fields, Any]]) -> None:
        for fields, row in made:
            run = str(fields["run"])
            before = (LABELS.c.serial == fields["serial"]) & (LABELS.c.run < run) & LABELS.c.done_at.is_(None)
            again = {"done_at": now_text(), "why": f"{MEASURED_AGAIN}: {run}", "label": ""}
            connection.execute(update(LABELS).where(before).values(**again))
            if row is None or connection.execute(select(LABELS.c.number).where(LABELS.c.run == run)).first():
                continue
            left = at_start and fields is not made[-1][0]
            gone = {"done_at": now_text(), "why": NOBODY_PRINTED, "label": ""} if left else {}
            new = {**row._asdict(), "copy": 1, "next_s": 0.0, "done_by": "", "why": ""}
            connection.execute(insert(LABELS).values(**new | gone))

    made = read_on(database, data, LABELS_READ, lambda fields: label_for(data, fields, labels), put)
    return sum(row is not None for _, row in made)


def awaited(connection: Connection, labels: Labels) -> Awaited | None:
    """Return the oldest label that is not on its unit, as far as it is known; None where there is none.

    Without `read_back` a label that was printed is done.
    """
    row = _oldest(connection, labels)
    return None if row is None else Awaited(row.run, row.serial, _stage(row), row.trouble)


def why_not_next(connection: Connection, data: Path, labels: Labels) -> str:
    """Return why the next unit has to wait for a label, in words; '' where it has not.

    Raises:
        StationError: the chain cannot be read.

    """
    found = awaited(connection, labels)
    if found is not None:
        return str(found)
    offset = connection.execute(select(LABELS_READ.c.offset)).scalar()
    if offset is None or sealed_since(data, offset)[0]:
        return "The label of the last unit is being made. Wait a moment, then scan again."
    return ""


def _oldest(connection: Connection, labels: Labels) -> Any:
    left: ColumnElement[bool] = LABELS.c.done_at.is_(None)
    if labels.settings.read_back is None:
        left = left & LABELS.c.printed_at.is_(None)
    return connection.execute(select(LABELS).where(left).order_by(LABELS.c.number).limit(1)).first()


def _stage(row: Any) -> str:
    if not row.label:
        return NOT_MADE
    if row.printed_at is not None:
        return PRINTED
    return TO_PRINT if row.sent_at is None else SENT


class WrongLabelError(StationError):
    """What was scanned is a label, and not the one that is awaited."""


def is_label(connection: Connection, scanned: str) -> bool:
    """Say whether a scanned text is that of a label of this station."""
    text = without_identifier(scanned)
    found = select(LABELS.c.number).where(LABELS.c.reads_as == text, LABELS.c.reads_as != "").limit(1)
    return connection.execute(found).first() is not None


def read_back(connection: Connection, data: Path, labels: Labels, scanned: str, name: str) -> Awaited:
    """Note that the awaited label was read on its unit; return it.

    Raises:
        WrongLabelError: it is the label of another unit, one that was read before, or none is awaited.

    """
    scanned, now = without_identifier(scanned), _oldest(connection, labels)
    if now is not None and scanned and now.reads_as == scanned:
        if now.sent_at is None:
            raise WrongLabelError(
                f"The label of unit {now.serial} is not printed yet, so this is an old one. Throw it away."
            )
        values = {"done_at": now_text(), "done_by": name, "printed_at": now.printed_at or now_text(), "label": ""}
        connection.execute(update(LABELS).where(LABELS.c.number == now.number).values(**values))
        return Awaited(now.run, now.serial, PRINTED)
    same = select(LABELS).where(LABELS.c.reads_as == scanned, LABELS.c.reads_as != "").order_by(LABELS.c.number.desc())
    found = connection.execute(same.limit(1)).first()
    if found is None:
        raise WrongLabelError("This is no label of this bench. Scan the label that was printed for the unit.")
    serial = found.serial
    if measured_again(data, found):
        raise WrongLabelError(f"Unit {serial} was measured again, so this is an old label. Take it off.")
    if now is None:
        raise WrongLabelError(f"The label of unit {serial} was read before. Scan the next unit.")
    raise WrongLabelError(
        f"This is the label of unit {serial}, but the label of unit {now.serial} comes first. Check that each unit has "
        "its own label."
    )


def print_again(connection: Connection, data: Path, labels: Labels, run: str) -> int:
    """Have a label printed once more, as the next copy; return which copy it is.

    Raises:
        StationError: the run has no label, it waits for the printer already, or its record cannot be read.

    """
    row = connection.execute(select(LABELS).where(LABELS.c.run == run)).first()
    if row is None:
        raise LabelError(f"Run {run[:80]!r} has no label.")
    if row.label and row.sent_at is None:
        raise LabelError(f"The label of unit {row.serial} waits for the printer already. {row.trouble}".strip())
    if measured_again(data, row):
        raise LabelError(f"Unit {row.serial} was measured again. This label does not count any more.")
    altered, result = result_of(data, run)
    if result is None:
        raise LabelError(f"No label can be made of run {run}: {altered[0] if altered else 'it has no result'}.")
    copy = row.copy + (row.sent_at is not None)
    label, reads_as = label_of(data, RunRecord(data / run).manifest(), result, labels, copy)
    anew = {"label": label, "reads_as": reads_as, "copy": copy, "next_s": 0.0, "trouble": ""}
    anew |= {"sent_at": None, "printed_at": None, "done_at": None, "done_by": "", "why": ""}
    connection.execute(update(LABELS).where(LABELS.c.number == row.number).values(**anew))
    return int(copy)


def measured_again(data: Path, row: Any) -> bool:
    """Whether a run of the same unit was begun after that of a label, which says nothing of the unit then."""
    return any(one.run > row.run for one in Store(data).attempts_of(row.serial))


def set_aside(connection: Connection, run: str, name: str, why: str) -> None:
    """Note that a unit goes without a label that was read; LabelError where none is awaited of it."""
    values = {"done_at": now_text(), "done_by": name, "why": why, "label": ""}
    asked = (LABELS.c.run == run) & LABELS.c.done_at.is_(None)
    if not connection.execute(update(LABELS).where(asked).values(**values)).rowcount:
        raise LabelError(
            f"Run {run[:80]!r} has no label that waits to be scanned: it was scanned or set aside. Scan the next unit."
        )


class Printing:
    """A thread of the server that prints what is to be printed."""

    def __init__(self, database: StationDatabase, data: Path, labels: Labels) -> None:
        """Prepare it."""
        self._database, self._data, self._labels = database, data, labels
        self._end, self._at_start = Event(), True
        self._thread = Thread(target=self._loop, name="labels", daemon=True)
        begin_here(database, data, labels)

    def start(self) -> None:
        """Begin to print."""
        self._thread.start()

    def close(self) -> None:
        """End: what is not printed is kept for the next start."""
        self._end.set()
        if self._thread.ident is not None:
            # Whoever ends the server does not wait for a slow printer: what it was sent is noted as sent.
            self._thread.join(timeout=min(self._labels.settings.printer.timeout_s, LONGEST_END_S) + LOOK_EVERY_S)

    def _loop(self) -> None:
        told = ""
        while not self._end.wait(LOOK_EVERY_S):
            try:
                self.look()
                why = ""
            except NotYetError:
                why = ""
            except (StationError, ValueError, LookupError, OSError) as error:
                why = f"labels  none is printed: {error}\n"  # it is looked at again
            if why != told:
                sys.stderr.write(why)
            told = why

    def look(self) -> None:
        """Collect what is new, and print the oldest label that is due."""
        collect(self._database, self._data, self._labels, at_start=self._at_start)
        self._at_start = False
        due = LABELS.c.sent_at.is_(None) & LABELS.c.done_at.is_(None) & (LABELS.c.label != "")
        with self._database.reading() as connection:
            row = connection.execute(select(LABELS).where(due).order_by(LABELS.c.number).limit(1)).first()
        # By no more than the wait: a clock that was set back meanwhile holds no label up.
        if row is None or 0.0 < row.next_s - WALL_CLOCK.now().timestamp() <= WAIT_S:
            return
        try:
            self._print(row)
        except PrinterError as error:
            self._note(row, trouble=str(error), next_s=WALL_CLOCK.now().timestamp() + WAIT_S)

    def _print(self, row: Any) -> None:
        printer = self._labels.settings.printer
        with connected(printer.host, printer.port, printer.timeout_s) as line:
            status = line.status()
            if status.trouble:
                raise PrinterError(status.trouble)
            if status.waiting:
                raise PrinterError("The printer still has other labels to print. Wait, or switch it off and on")
            if measured_again(self._data, row):
                raise PrinterError(MEASURED_AGAIN)
            if not self._taken(row):
                return
            line.send(row.label)
            self._wait_for(line, row, printer.timeout_s)

    def _taken(self, row: Any) -> bool:
        """Note that a label is sent; False where somebody else has sent it, or asked for another copy."""
        with self._database.writing() as connection:
            free = _same(row) & LABELS.c.sent_at.is_(None) & LABELS.c.done_at.is_(None)
            return connection.execute(update(LABELS).where(free).values(sent_at=now_text(), trouble="")).rowcount > 0

    def _wait_for(self, line: Line, row: Any, timeout_s: float) -> None:
        """Note that the label has come out, once the printer says that it has nothing left to print."""
        end_s = time.monotonic() + timeout_s
        while True:
            status = line.status()
            if status.idle:
                done = {} if row.reads_as else {"done_at": now_text(), "label": ""}  # nobody is asked to read it
                self._note(row, printed_at=now_text(), trouble="", **done)
                return
            self._note(row, trouble=status.trouble)
            if time.monotonic() > end_s or self._end.wait(ASK_EVERY_S):
                return

    def _note(self, row: Any, **values: object) -> None:
        with self._database.writing() as connection:
            connection.execute(update(LABELS).where(_same(row)).values(**values))


def _same(row: Any) -> ColumnElement[bool]:
    same: ColumnElement[bool] = (LABELS.c.number == row.number) & (LABELS.c.copy == row.copy)
    return same
