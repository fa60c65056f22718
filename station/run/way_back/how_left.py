"""How a run left its bench: in order, in need of a recovery, or as it found it, so that the run before it counts."""

from __future__ import annotations

from enum import Enum, auto

from station.atomic_file import read_file
from station.documents.events import EventRow, LeftState
from station.documents.reading import document_in
from station.documents.result import Result
from station.errors import RecordError, StationError
from station.records.run_record import EVENTS, INTERRUPTED, NOT_CONCLUDED, RESULT, RunRecord
from station.records.samples.event_log import has_begun
from station.records.seal import alterations, is_sealed

FAULT, STOPPED = "fault", "stopped"

NEEDS_WAY_BACK = (FAULT, INTERRUPTED, NOT_CONCLUDED)
"""How a run may end so that the bench has to be recovered before anything turns."""


class HowLeft(Enum):
    """What a run means for its bench."""

    IN_ORDER = auto()
    """Unloaded, with the lock open; or the run is still on, which is told elsewhere."""
    AS_FOUND = auto()
    """The run ended before anything of the bench was changed: the bench is as the run before left it."""
    IN_NEED = auto()
    """The unit may be wound up behind the lock: the bench has to be recovered."""


def how_left(run: RunRecord) -> HowLeft:
    """Return how a run, or a recovery, left its bench. Where nothing better is proven, it is in need of a recovery.

    Raises:
        RecordError: run.json cannot be read.

    """
    state = run.state()
    if state not in {*NEEDS_WAY_BACK, STOPPED}:
        return HowLeft.IN_ORDER
    if state not in {FAULT, STOPPED}:
        return HowLeft.IN_NEED
    try:
        manifest = run.manifest()
        recorded_fault = state == FAULT and manifest.records
        # without the samples: a page asks again and again, and they are most of a run's bytes
        if recorded_fault or not is_sealed(manifest) or alterations(run, samples=False):
            return HowLeft.IN_NEED
        if state == FAULT or not _has_begun(run):
            return HowLeft.AS_FOUND
        left = run.read(Result, RESULT).left
    except StationError:
        return HowLeft.IN_NEED
    return HowLeft.IN_ORDER if is_released(state, left) else HowLeft.IN_NEED


def left_as_found(run: RunRecord) -> bool:
    """Say whether a run ended before it changed anything of its bench; of one that cannot be read nobody knows it."""
    try:
        return how_left(run) is HowLeft.AS_FOUND
    except RecordError:
        return False


def is_released(state: str, after: LeftState | None) -> bool:
    """Say whether a run that was stopped, or a recovery, ended with the torque brought to zero and the lock open."""
    return state == STOPPED and after is not None and after.lock == "open"


def _has_begun(run: RunRecord) -> bool:
    """Whether anything of the bench was changed; a start that was cancelled before has its transition to the end only.

    Of a bench that could not be opened there is no record at all, and of a scan that is lost later there is one.
    """
    lines = read_file(run.folder / EVENTS).splitlines()
    return has_begun([document_in(EventRow, line, run.folder / EVENTS) for line in lines])
