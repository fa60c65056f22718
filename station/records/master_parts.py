"""The master parts of a bench: when each was last measured, and whether it read as it should.

One run cannot show an error that both torques and the angle have in common, such as both torques 5 % too large and the
angle with them. A unit whose verdict is known can: a good one must pass, a bad one must fail.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import NamedTuple

from recipes.schema.bench_schema import Bench, MasterPart
from station.documents.manifest import MASTER, Manifest, VerdictName
from station.documents.result import Result
from station.errors import StationError
from station.records.data_folder import Store
from station.records.run_record import RESULT, RunRecord, only_simulated
from station.records.seal import alterations

COMPLETE = "complete"


AS_IT_SHOULD = "The master part read as it should. Put it back in its place."
NOT_AS_IT_SHOULD = "The master part does not read as it should: the bench may measure wrong. Call the technician."
GOOD_ONE_FAILED = (
    "The good master part failed: the bench may measure wrong, or the part is worn. Put it into the NOK box and call "
    "the technician."
)
NOT_MEASURED = "The master part was not measured. Measure it again, or call the technician."


def to_do_with_part(expected: VerdictName, verdict: str) -> str:
    """Return what is done with a master part after a verdict."""
    if verdict == "NOT DECIDABLE":
        return NOT_MEASURED
    if verdict == expected:
        return AS_IT_SHOULD
    return NOT_AS_IT_SHOULD if verdict == "PASS" else GOOD_ONE_FAILED


class MasterCheck(NamedTuple):
    """A master part as a bench last measured it: its serial number, whether it speaks for the bench, and in words."""

    serial: str
    in_order: bool
    text: str


def master_parts(store: Store, bench: Bench, now: datetime) -> tuple[MasterCheck, ...]:
    """Return the state of each master part that a bench file names; none where it names none."""
    return tuple(_checked(store, bench.bench.name, part, now) for part in bench.master_parts)


def _checked(store: Store, bench: str, part: MasterPart, now: datetime) -> MasterCheck:
    newest = _newest(store, bench, part.serial)
    if newest is None:
        why = f"was never measured on this bench; needed every {_hours(part.every_s)}"
        return MasterCheck(part.serial, False, f"{MASTER}{part.serial} {why}")  # noqa: FBT003
    run, manifest = newest
    age = now - datetime.fromisoformat(manifest.started)
    ago = f"{_hours(age.total_seconds())} before, run {run.id}"
    if alterations(run):
        wrong = f"has an altered record ({ago}): it proves nothing. Measure it again"
    elif manifest.verdict != part.expect:
        wrong = f"read {manifest.verdict}, and {part.expect} is right ({ago}): this bench may measure wrong"
    elif not timedelta(0) <= age <= timedelta(seconds=part.every_s):
        wrong = f"was last measured {ago}; due every {_hours(part.every_s)}"
    else:
        right = f"read {manifest.verdict}, as it should ({ago}). {_proves(run, part)}"
        return MasterCheck(part.serial, True, f"{MASTER}{part.serial} {right}")  # noqa: FBT003
    return MasterCheck(part.serial, False, f"{MASTER}{part.serial} {wrong}")  # noqa: FBT003


ONE_SIDED = (
    "Its recipe has a limit on one side only, so a measuring error towards better values is not detected: give this "
    "recipe a lower and an upper limit"
)


def _proves(run: RunRecord, part: MasterPart) -> str:
    """Say how large an error common to torques or angles may have been when a master part read as it should.

    A good one lies within its limits whatever the error, so its value cannot be off by more than they are apart.
    """
    if part.expect != "PASS":
        return "The bench rejects a bad unit like this master part"
    apart = {}
    for metric in run.read(Result, RESULT).metrics:
        low, high = metric.limits.min, metric.limits.max
        if low is not None and high is not None and low > 0.0:
            apart[metric.id] = 100.0 * (high / low - 1.0)
    if not apart:
        return ONE_SIDED
    narrowest = min(apart, key=lambda name: apart[name])
    return f"A measuring error above {apart[narrowest]:.2g} % of the metric {narrowest} would have been detected"


def _newest(store: Store, bench: str, serial: str) -> tuple[RunRecord, Manifest] | None:
    """Return the newest run of a serial number that used a bench and came to its end, without injected faults."""
    for run in reversed(store.named_by(serial)):
        try:
            manifest = run.manifest()
        except StationError:
            continue
        whole = manifest.state == COMPLETE and manifest.scenario is None and manifest.recovery_of is None
        whole &= not only_simulated(manifest)
        if whole and manifest.serial == serial and manifest.bench.name == bench:
            return run, manifest
    return None


def _hours(seconds: float) -> str:
    """Return a time as a person says it: seconds below two minutes, minutes below two hours, hours below two days."""
    for unit, length, least in (("d", 86400.0, 2.0), ("h", 3600.0, 2.0), ("min", 60.0, 2.0)):
        if abs(seconds) >= least * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.0f} s"
