"""Recoveries of a bench: where they are kept, the record that the bench was left by, and whether a fault is over.

A recovery is recorded like a run, in a folder below the runs. The bench is as its newest record left it, be that a run
or a recovery; a fault is over when a recovery that came after it has unloaded the unit and opened the lock.
"""

from __future__ import annotations

from pathlib import Path

from definitions.protections import UNPROVEN
from station.documents.manifest import RECORDING, Manifest
from station.errors import StationError
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.run.way_back.how_left import HowLeft, how_left, left_as_found

FOLDER = "recoveries"

NEWEST_LOOKED_AT = 20
"""Recoveries: of those after the newest run of a bench, the last one counts."""


def recoveries(data: Path) -> Store:
    """Return the recoveries of a data folder."""
    return Store(data / FOLDER)


def drive_is_unproven(run: Manifest) -> bool:
    """Tell whether a run, or a recovery, says that nobody has measured that the drive of its bench ends its torque.

    What a virtual drive does when the program dies is known from itself.
    """
    return run.unit.virtual is None and UNPROVEN in run.notes


def newest_recovery(data: Path, run: RunRecord) -> RunRecord | None:
    """Return the newest recovery of a run's bench that was begun after the run; None where there is none.

    One that ended before it changed anything is passed over.

    Raises:
        RecordError: run.json of the run cannot be read.

    """
    bench = run.manifest().bench.name
    for found in reversed(recoveries(data).newest(NEWEST_LOOKED_AT)):
        if found.id < run.id:
            return None
        try:
            if found.manifest().bench.name == bench and not left_as_found(found):
                return found
        except StationError:
            return found  # nobody knows what it did: it is not the word that the bench is free
    return None


def is_under_way(recovery: RunRecord) -> bool:
    """Say whether a recovery is on; RecordError when it cannot be read."""
    return recovery.manifest().state == RECORDING and not recovery.deserted()


def was_recovered(data: Path, run: RunRecord) -> bool:
    """Say whether the bench was recovered since a run that ended in a fault.

    Raises:
        RecordError: the run, the recovery or its result cannot be read.

    """
    found = newest_recovery(data, run)
    return found is not None and how_left(found) is HowLeft.IN_ORDER
