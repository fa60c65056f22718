"""Objects of a CANopen device before the scan: each is read, written where it holds something else, and read back."""

from __future__ import annotations

import time
from collections.abc import Sequence

from drivers.errors import DriveSetupError, Problem
from drivers.servo_drive.comparison import SILENCES_IN_A_ROW
from drivers.servo_drive.objects import SetupRow, Treatment, number_text
from drivers.servo_drive.sdo import OBJECT_MISSING, SUBINDEX_MISSING, SdoFailure, SdoNode

NODE_NEXT = "check power, node id, bit rate, cable and termination of the device"
_WRITTEN = (Treatment.WRITE, Treatment.STEP, Treatment.WRITE_IF_THERE)
_READ_BACK = (Treatment.WRITE, Treatment.WRITE_IF_THERE)
_NEVER_COMPARED = (Treatment.STEP, Treatment.CHECK)
"""Rows of a group that say nothing of whether it must be written."""
_MISSING = (OBJECT_MISSING, SUBINDEX_MISSING)


class ObjectSetup:
    """One pass over the objects of a node, with its findings and its log.

    The methods raise DriveSetupError with all findings when the node is silent, or the pass takes too long.
    """

    def __init__(self, node: SdoNode, who: str, timeout_s: float) -> None:
        """`who`: the node as a person would look for it. `timeout_s`: for the whole pass."""
        self.node, self.who, self._timeout_s = node, who, timeout_s
        self.deadline = time.monotonic() + timeout_s
        self.log: list[str] = []
        self.problems: list[Problem] = []
        self._silences = 0
        self._absent: set[tuple[int, int]] = set()
        self._left: set[tuple[int, int]] = set()
        """Objects that held what is wanted, and were not written."""
        self._found: dict[tuple[int, int], int] = {}

    def hold(self, groups: Sequence[Sequence[SetupRow]]) -> None:
        """Make groups of objects hold what they shall, and read all of them back."""
        for group in groups:
            if not self._holds(group):
                self._write(group)
        self.check([row for group in groups for row in group if row.treatment is not Treatment.STEP])

    def stop_on_problems(self) -> None:
        """Raise what was found."""
        if self.problems:
            raise DriveSetupError(*self.problems)

    def stop_when_late(self) -> None:
        """Raise what was found, and that the time is over, when it is."""
        if time.monotonic() > self.deadline:
            self.problems.append(
                Problem(
                    "the set-up takes too long",
                    self.who,
                    f"not finished after {self._timeout_s:g} s",
                    "a device that answers at once",
                    NODE_NEXT,
                )
            )
            self.stop_on_problems()

    def check(self, rows: Sequence[SetupRow]) -> None:
        """Read objects, and find those that are not as they must be."""
        for row in rows:
            if (row.index, row.subindex) in self._absent:
                continue
            self.stop_when_late()
            try:
                found = self.node.read(row.index, row.subindex, row.type)
            except SdoFailure as failure:
                self._failed("cannot be read", row, failure)
                continue
            self._silences = 0
            if row.matches(found):
                left = (row.index, row.subindex) in self._left
                checked = row.treatment in {Treatment.CHECK, Treatment.CHECK_BITS}
                how = "checked" if checked else "held already, not written" if left else "written, read back"
                self.log.append(f"{self.where(row)} {row.meaning} = {number_text(row, found)}: {how}")
            else:
                what = f"{row.meaning} is not what it must be"
                self.problems.append(
                    Problem(what, self.where(row), number_text(row, found), number_text(row, row.value), row.next_step)
                )

    def _holds(self, group: Sequence[SetupRow]) -> bool:
        """Read what a group of objects holds; whether all of it is wanted as it is, so that nothing is written.

        Objects may be fixed, as may a whole mapping: a drive that holds what is wanted need not let itself be written.
        """
        wanted = True
        for row in group:
            if row.treatment not in _READ_BACK or not row.fits:
                wanted &= row.treatment in _NEVER_COMPARED
                continue
            self.stop_when_late()
            try:
                self._found[row.index, row.subindex] = found = self.node.read(row.index, row.subindex, row.type)
            except SdoFailure as failure:
                if failure.abort_code == 0:
                    self._absent.update((one.index, one.subindex) for one in group)
                    self._failed("cannot be read", row, failure)
                    return True
                # an object that may be missing is not waited for; any other is told by the attempt to write it
                wanted &= row.treatment is Treatment.WRITE_IF_THERE and failure.abort_code in _MISSING
                if row.treatment is Treatment.WRITE_IF_THERE and failure.abort_code in _MISSING:
                    self._absent.add((row.index, row.subindex))
                    self.log.append(f"{self.where(row)} {row.meaning}: this drive has no such object")
                continue
            self._silences = 0
            wanted &= row.matches(found)
        if wanted:
            self._left.update((row.index, row.subindex) for row in group)
        return wanted

    def _write(self, rows: Sequence[SetupRow]) -> None:
        for row in rows:
            if row.treatment not in _WRITTEN or (row.index, row.subindex) in self._absent:
                continue
            if not row.fits:
                self._absent.add((row.index, row.subindex))
                self.problems.append(
                    Problem(
                        f"{row.meaning} does not fit its object",
                        self.where(row),
                        str(row.value),
                        f"a number of type {row.type}",
                        "correct the value in the bench file",
                    )
                )
                continue
            self.stop_when_late()
            try:
                found = self._found.get((row.index, row.subindex), row.value)
                self.node.write(row.index, row.subindex, row.type, row.written_over(found))
                self._silences = 0
            except SdoFailure as failure:
                self._absent.add((row.index, row.subindex))
                if row.treatment is Treatment.WRITE_IF_THERE and failure.abort_code in _MISSING:
                    self.log.append(f"{self.where(row)} {row.meaning}: this drive has no such object")
                else:
                    self._failed("cannot be written", row, failure)

    def _failed(self, what: str, row: SetupRow, failure: SdoFailure) -> None:
        self.find(f"{row.meaning} {what}", self.where(row), failure.cause, number_text(row, row.value), failure)
        if failure.abort_code == 0:
            self._silences += 1
            if self._silences >= SILENCES_IN_A_ROW:
                self.stop_on_problems()

    def find(self, what: str, where: str, found: str, expected: str, failure: SdoFailure) -> None:
        """Note what a transfer did not do."""
        self.problems.append(Problem(what, where, found, expected, failure.next_action))

    def where(self, row: SetupRow) -> str:
        """Return the place of an object, as a person would look for it."""
        return f"{self.who} {row.index:04X}:{row.subindex:02X}"
