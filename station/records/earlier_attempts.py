"""What became of a unit when it was measured before: stands in the record of every later attempt."""

from __future__ import annotations

from collections.abc import Sequence

from station.documents.manifest import EarlierAttempt
from station.documents.result import Result
from station.errors import StationError
from station.records.run_record import RESULT, RunRecord

MOST = 5
"""The newest are told: a master part is measured every day for years."""


def earlier_attempts(runs: Sequence[RunRecord], serial: str) -> tuple[EarlierAttempt, ...]:
    """Return the newest of these runs that are of a serial number, oldest first; damaged ones are left out."""
    found: list[EarlierAttempt] = []
    for run in reversed(runs):
        try:
            manifest = run.manifest()
        except StationError:
            continue
        if manifest.serial == serial and manifest.recovery_of is None:
            one = EarlierAttempt(
                attempt=manifest.attempt,
                run=run.id,
                state=manifest.state,
                verdict=manifest.verdict,
                failed=_failed(run),
            )
            found.append(one)
        if len(found) == MOST:
            break
    return tuple(reversed(found))


def _failed(run: RunRecord) -> tuple[str, ...]:
    """Return the metrics that failed, by their titles without what stands in brackets."""
    try:
        metrics = run.read(Result, RESULT).metrics if run.has(RESULT) else ()
    except StationError:
        return ()
    return tuple((one.title or one.id).partition(" (")[0] for one in metrics if one.verdict == "FAIL")
