"""A drive compared with its profile: every object that the set-up looks at is read, and nothing is written.

No command is sent either: the drive stays in the state that it is in.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from drivers.can.bus import CanLink
from drivers.config import DriveConfig
from drivers.servo_drive.mapping import mapping_groups
from drivers.servo_drive.objects import (
    SetupRow,
    Treatment,
    homing_rows,
    identity_rows,
    number_text,
    output_rows,
    polarity_rows,
    protection_rows,
    rating_rows,
    startup_rows,
    synchronisation_rows,
)
from drivers.servo_drive.sdo import OBJECT_MISSING, SUBINDEX_MISSING, SdoFailure, SdoNode

SILENCES_IN_A_ROW = 2
"""Objects without an answer after which the node is taken for gone."""

Outcome = Literal["holds", "will be written", "not there", "refused", "no answer"]


class Compared(NamedTuple):
    """One object: where, what it means, what is wanted and found, what the set-up makes of it, what to do.

    `refused`: it can neither be as wanted nor be made so, and the set-up refuses the drive.
    """

    place: str
    meaning: str
    wanted: str
    found: str
    outcome: Outcome
    next_step: str


def rows_of(config: DriveConfig, period_ns: int) -> list[SetupRow]:
    """Return every object that the set-up checks, or writes and reads back, in the order in which it does."""
    rows = [*identity_rows(config), *rating_rows(config), *startup_rows(config)]
    rows += [*synchronisation_rows(config, period_ns), *protection_rows(config), *polarity_rows(), *homing_rows(config)]
    rows += output_rows(config)
    rows += [row for group in mapping_groups(config) for row in group]
    return [row for row in rows if row.treatment is not Treatment.STEP]


def compare_drive(link: CanLink, config: DriveConfig, period_ns: int) -> list[Compared]:
    """Read every object of the set-up and compare it; ends early when the drive does not answer."""
    node = SdoNode(link, config.node_id, config.sdo_reply_timeout_s, config.sdo_tries)
    return compare_objects(node, rows_of(config, period_ns))


def compare_objects(node: SdoNode, rows: Iterable[SetupRow]) -> list[Compared]:
    """Read objects of a node and compare them; ends early when it does not answer."""
    compared: list[Compared] = []
    for row in rows:
        compared.append(_compared(node, row))
        if [one.outcome for one in compared[-SILENCES_IN_A_ROW:]] == ["no answer"] * SILENCES_IN_A_ROW:
            break
    return compared


def _compared(node: SdoNode, row: SetupRow) -> Compared:
    place, wanted = f"{row.index:04X}:{row.subindex:02X}", number_text(row, row.value)
    may_lack = row.treatment is Treatment.WRITE_IF_THERE
    written = may_lack or row.treatment is Treatment.WRITE
    try:
        found = node.read(row.index, row.subindex, row.type)
    except SdoFailure as failure:
        if not failure.abort_code:
            return Compared(place, row.meaning, wanted, failure.cause, "no answer", failure.next_action)
        if may_lack and failure.abort_code in (OBJECT_MISSING, SUBINDEX_MISSING):
            return Compared(place, row.meaning, wanted, "no such object", "not there", "")
        return Compared(place, row.meaning, wanted, failure.cause, "refused", failure.next_action)
    if row.matches(found):
        return Compared(place, row.meaning, wanted, number_text(row, found), "holds", "")
    outcome: Outcome = "will be written" if written else "refused"
    return Compared(place, row.meaning, wanted, number_text(row, found), outcome, "" if written else row.next_step)
