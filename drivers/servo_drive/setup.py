"""Set-up of the drive before the scan: prove which drive it is, write every protection, read all of it back, start it.

Blocking, over SDO. Nothing is written to a drive whose identity is wrong; every other finding is collected and told at
once. A drive that fails here is left in pre-operational, where it takes no set-points.
"""

from __future__ import annotations

import time

from definitions.image import NmtState
from definitions.protections import missing_text
from drivers.can.bus import CanLink
from drivers.config import DriveConfig
from drivers.errors import DriveSetupError, Problem
from drivers.servo_drive.mapping import mapping_groups
from drivers.servo_drive.objects import (
    SetupRow,
    Treatment,
    homing_rows,
    identity_rows,
    missing_protections,
    polarity_rows,
    protection_rows,
    protections_switched_off,
    rating_rows,
    startup_rows,
    synchronisation_rows,
)
from drivers.servo_drive.sdo import (
    NMT_ENTER_PRE_OPERATIONAL,
    NMT_RESET_COMMUNICATION,
    NMT_START,
    OBJECT_MISSING,
    SUBINDEX_MISSING,
    SdoFailure,
    SdoNode,
)

SILENCES_IN_A_ROW = 2
"""Transfers without an answer after which the node is taken for gone instead of being asked for every other object."""

_NODE_NEXT = "check power, node id, bit rate, cable and termination"
_WRITTEN = (Treatment.WRITE, Treatment.STEP, Treatment.WRITE_IF_THERE)
_READ_BACK = (Treatment.WRITE, Treatment.WRITE_IF_THERE)
_NEVER_COMPARED = (Treatment.STEP, Treatment.CHECK)
"""Rows of a group that say nothing of whether it must be written."""
_MISSING = (OBJECT_MISSING, SUBINDEX_MISSING)


def set_up_drive(link: CanLink, config: DriveConfig, period_ns: int) -> list[str]:
    """Make the drive ready for the scan and operational; returns what was verified, one line per object.

    Raises DriveSetupError with all findings.
    """
    return _Setup(link, config, period_ns).run()


class _Setup:
    """One pass through the set-up, with its findings and its log."""

    def __init__(self, link: CanLink, config: DriveConfig, period_ns: int) -> None:
        self.config = config
        self.period_ns = period_ns
        self.node = SdoNode(link, config.node_id, config.sdo_reply_timeout_s, config.sdo_tries)
        self.deadline = time.monotonic() + config.setup_timeout_s
        self.log: list[str] = []
        self.problems: list[Problem] = []
        self.silences = 0
        self.absent: set[tuple[int, int]] = set()
        self.left: set[tuple[int, int]] = set()
        """Objects that held what is wanted, and were not written."""
        self.found: dict[tuple[int, int], int] = {}

    def run(self) -> list[str]:
        self._refuse_switched_off()
        self._refuse_contradictions()
        try:
            self._boot()
            self._check(identity_rows(self.config))
            self._stop_on_problems()
            self._check(rating_rows(self.config))
            alone = [
                *startup_rows(self.config),
                *synchronisation_rows(self.config, self.period_ns),
                *protection_rows(self.config),
                *polarity_rows(),
                *homing_rows(self.config),
            ]
            groups = [*([row] for row in alone), *mapping_groups(self.config)]
            for group in groups:
                if not self._holds(group):
                    self._write(group)
            self._check([row for group in groups for row in group if row.treatment is not Treatment.STEP])
            self._stop_on_problems()
            self._start()
            node = f"node {self.config.node_id}"
            self.log += [f"{node}: {missing_text(one)}" for one in missing_protections(self.config.profile)]
        except SdoFailure as failure:  # of an NMT command: the bus itself failed
            self._find("NMT command not sent", f"node {self.config.node_id}", failure.cause, "sent", failure)
        self._stop_on_problems()
        return self.log

    def _refuse_switched_off(self) -> None:
        for row in protections_switched_off(self.config):
            where = f"node {self.config.node_id} {row.index:04X}:{row.subindex:02X}"
            self.problems.append(
                Problem(f"{row.meaning} would be switched off", where, "0", "above 0", "correct the bench file")
            )
        self._stop_on_problems()

    def _refuse_contradictions(self) -> None:
        """Refuse a profile that starts the drive up with an object which the set-up writes or checks too."""
        config = self.config
        taken = [*identity_rows(config), *rating_rows(config), *synchronisation_rows(config, self.period_ns)]
        taken += [*protection_rows(config), *polarity_rows(), *homing_rows(config)]
        taken += [row for group in mapping_groups(config) for row in group]
        meanings = {(row.index, row.subindex): row.meaning for row in taken}
        for row in startup_rows(config):
            meaning = meanings.get((row.index, row.subindex))
            if meaning is not None:
                what, expected = f"{row.meaning} is written at start-up", f"an object that is not {meaning}"
                self.problems.append(
                    Problem(what, self._where(row), str(row.value), expected, "delete it from 'startup' of the profile")
                )
        self._stop_on_problems()

    def _stop_on_problems(self) -> None:
        if self.problems:
            raise DriveSetupError(*self.problems)

    def _stop_when_late(self) -> None:
        if time.monotonic() > self.deadline:
            self.problems.append(
                Problem(
                    "the set-up takes too long",
                    f"node {self.config.node_id}",
                    f"not finished after {self.config.setup_timeout_s:g} s",
                    "a drive that answers at once",
                    _NODE_NEXT,
                )
            )
            self._stop_on_problems()

    def _boot(self) -> None:
        """Restart the node's communication, so that what it says afterwards is known to be from now."""
        node, wait_s = self.node, self.config.boot_timeout_s
        node.command(NMT_RESET_COMMUNICATION)
        if not node.wait_for(NmtState.BOOT_UP, wait_s):
            self.problems.append(
                Problem(
                    "the drive does not start",
                    f"node {node.node_id}",
                    f"no boot-up message within {wait_s:g} s after the reset of its communication",
                    "a boot-up message",
                    _NODE_NEXT,
                )
            )
            self._stop_on_problems()
        node.command(NMT_ENTER_PRE_OPERATIONAL)
        deadline = time.monotonic() + wait_s
        while True:  # some drives say boot-up well before they answer
            try:
                node.read(0x1018, 1, "u32")
            except SdoFailure:
                if time.monotonic() > deadline:
                    break
            else:
                break
        self.log.append(f"node {node.node_id}: boot-up message received")

    def _check(self, rows: list[SetupRow]) -> None:
        for row in rows:
            if (row.index, row.subindex) in self.absent:
                continue
            self._stop_when_late()
            try:
                found = self.node.read(row.index, row.subindex, row.type)
            except SdoFailure as failure:
                self._failed("cannot be read", row, failure)
                continue
            self.silences = 0
            if row.matches(found):
                left = (row.index, row.subindex) in self.left
                checked = row.treatment in {Treatment.CHECK, Treatment.CHECK_BITS}
                how = "checked" if checked else "held already, not written" if left else "written, read back"
                self.log.append(f"{self._where(row)} {row.meaning} = {_number(row, found)}: {how}")
            else:
                what = f"{row.meaning} is not what it must be"
                self.problems.append(
                    Problem(what, self._where(row), _number(row, found), _number(row, row.value), row.next_step)
                )

    def _holds(self, group: list[SetupRow]) -> bool:
        """Read what a group of objects holds; whether all of it is wanted as it is, so that nothing is written.

        Objects may be fixed, as may a whole mapping: a drive that holds what is wanted need not let itself be written.
        """
        wanted = True
        for row in group:
            if row.treatment not in _READ_BACK or not row.fits:
                wanted &= row.treatment in _NEVER_COMPARED
                continue
            self._stop_when_late()
            try:
                self.found[row.index, row.subindex] = found = self.node.read(row.index, row.subindex, row.type)
            except SdoFailure as failure:
                if failure.abort_code == 0:
                    self.absent.update((one.index, one.subindex) for one in group)
                    self._failed("cannot be read", row, failure)
                    return True
                # an object that may be missing is not waited for; any other is told by the attempt to write it
                wanted &= row.treatment is Treatment.WRITE_IF_THERE and failure.abort_code in _MISSING
                if row.treatment is Treatment.WRITE_IF_THERE and failure.abort_code in _MISSING:
                    self.absent.add((row.index, row.subindex))
                    self.log.append(f"{self._where(row)} {row.meaning}: this drive has no such object")
                continue
            self.silences = 0
            wanted &= row.matches(found)
        if wanted:
            self.left.update((row.index, row.subindex) for row in group)
        return wanted

    def _write(self, rows: list[SetupRow]) -> None:
        for row in rows:
            if row.treatment not in _WRITTEN or (row.index, row.subindex) in self.absent:
                continue
            if not row.fits:
                self.absent.add((row.index, row.subindex))
                self.problems.append(
                    Problem(
                        f"{row.meaning} does not fit its object",
                        self._where(row),
                        str(row.value),
                        f"a number of type {row.type}",
                        "correct the value in the bench file",
                    )
                )
                continue
            self._stop_when_late()
            try:
                found = self.found.get((row.index, row.subindex), row.value)
                self.node.write(row.index, row.subindex, row.type, row.written_over(found))
                self.silences = 0
            except SdoFailure as failure:
                self.absent.add((row.index, row.subindex))
                if row.treatment is Treatment.WRITE_IF_THERE and failure.abort_code in _MISSING:
                    self.log.append(f"{self._where(row)} {row.meaning}: this drive has no such object")
                else:
                    self._failed("cannot be written", row, failure)

    def _failed(self, what: str, row: SetupRow, failure: SdoFailure) -> None:
        self._find(f"{row.meaning} {what}", self._where(row), failure.cause, _number(row, row.value), failure)
        if failure.abort_code == 0:
            self.silences += 1
            if self.silences >= SILENCES_IN_A_ROW:
                self._stop_on_problems()

    def _find(self, what: str, where: str, found: str, expected: str, failure: SdoFailure) -> None:
        self.problems.append(Problem(what, where, found, expected, failure.next_action))

    def _start(self) -> None:
        self.node.command(NMT_START)
        if self.node.wait_for(NmtState.OPERATIONAL, self.config.boot_timeout_s):
            self.log.append(f"node {self.config.node_id}: started, heartbeat says operational")
            return
        self.problems.append(
            Problem(
                "the drive does not become operational",
                f"node {self.config.node_id}",
                f"NMT states {sorted(set(self.node.heard))} heard within {self.config.boot_timeout_s:g} s",
                "heartbeats with state 5, operational",
                _NODE_NEXT,
            )
        )

    def _where(self, row: SetupRow) -> str:
        return f"node {self.config.node_id} {row.index:04X}:{row.subindex:02X}"


def _number(row: SetupRow, value: int) -> str:
    """Write ids and bit fields in hexadecimal, quantities in decimal."""
    return f"0x{value:08X}" if row.type == "u32" and (row.index < 0x2000 or row.index == 0x6502) else str(value)
