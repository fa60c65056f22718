"""Room on the disk for a run, looked for before anything moves: a run that fills the disk ends under torque."""

from __future__ import annotations

import shutil
from pathlib import Path

from station.bench.request import Job
from station.errors import StationError
from station.records.samples.scan_record import RECORD_BYTES

OTHER_FILES_BYTES = 8_000_000
"""Pictures, report, events, logs and copies of the input."""

LONGER_THAN_PLANNED = 1.5
"""A run may hold, wait for samples and unload; its records are counted with this factor."""


def needed_bytes(job: Job) -> int:
    """Return how much disk a run of this job may take."""
    return OTHER_FILES_BYTES + round(LONGER_THAN_PLANNED * job.program.planned_scans) * RECORD_BYTES


def refuse_full_disk(data: Path, job: Job) -> None:
    """Refuse a run whose record would not fit; StationError with what is free and what is needed."""
    place = data.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    try:
        free = shutil.disk_usage(place).free
    except OSError as error:
        text = f"--data {data}: the free space of its disk cannot be read: {error.strerror}. Choose another folder"
        raise StationError(text) from error
    needed = needed_bytes(job)
    if free < needed:
        raise StationError(
            f"--data {data}: found {free / 1e6:.1f} MB free on its disk; needed: at least {needed / 1e6:.0f} MB "
            f"for a run of {job.recipe.recipe.name}. Free the disk, or choose another folder with --data"
        )
