"""What a recovery takes up from the runs before it: the fault that goes on, and the zeroes of the torque sensors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import islice

from controller.held_lock import Left
from definitions.faults import FAULT_BY_ID
from station.documents.manifest import LeftBy
from station.errors import StationError
from station.records.run_record import RunRecord
from station.records.samples.check import sound_table
from station.records.samples.samples import samples_bytes
from station.records.samples.table import Table
from station.records.seal import alterations, is_sealed

ZEROES_LOOKED_FOR = 20
"""Earlier runs of a bench: one of them has taken the zeroes of its torque sensors."""

NO_FAULT = FAULT_BY_ID["brake_stays_closed"].number
"""Where a run was torn off without a fault: what goes on is the lock that was left closed."""


def left_by(run: RunRecord, table: Table | None, before: Iterable[RunRecord]) -> LeftBy:
    """Return what the controller of a recovery has to know of the run before: its fault and its zeroes.

    A run that ended before it had taken the zeroes has none: they are those of the newest run `before` with this text
    of the bench file that took them. table: its records, None where it has none.
    """
    taken_up = run.manifest().left
    last = 0 if table is None else int(table[-1]["orders"]["fault"])
    fault = last or (NO_FAULT if taken_up is None else taken_up.fault)
    if taken_up is not None:  # a recovery goes on with the zeroes that it was begun with
        return replace(taken_up, fault=fault)
    zeroes = None if table is None else _zeroes_taken(table)
    if zeroes is not None:
        return LeftBy(fault=fault, torque_in_tare_nm=zeroes[0], torque_out_tare_nm=zeroes[1])
    found = next(_earlier_zeroes(before, run.manifest().bench.sha256), None)
    if found is None:
        return LeftBy(fault=fault, torque_in_tare_nm=0.0, torque_out_tare_nm=0.0, zeroes_unknown=True)
    of, (torque_in_nm, torque_out_nm) = found
    return LeftBy(fault=fault, torque_in_tare_nm=torque_in_nm, torque_out_tare_nm=torque_out_nm, zeroes_of=of)


def _zeroes_taken(table: Table) -> tuple[float, float] | None:
    """Return the zeroes of the torque sensors [N·m] of a run; None where it did not come to take them."""
    orders = table[-1]["orders"]
    zeroes = float(orders["torque_in_tare_nm"]), float(orders["torque_out_tare_nm"])
    return zeroes if any(zeroes) else None


def _earlier_zeroes(runs: Iterable[RunRecord], bench_sha256: str) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield runs, or recoveries, that have zeroes of these sensors, with them; of a doubtful record none are taken."""
    for run in islice(runs, ZEROES_LOOKED_FOR):
        try:
            manifest = run.manifest()
            if manifest.bench.sha256 != bench_sha256 or not is_sealed(manifest) or alterations(run):
                continue
            table = sound_table(samples_bytes(run), run.layout())
        except StationError:
            continue
        zeroes = _zeroes_taken(table) if len(table) else None
        if zeroes is not None and not (manifest.left is not None and manifest.left.zeroes_unknown):
            yield run.id, zeroes


def taken_up(left: LeftBy | None) -> Left | None:
    """Return how a bench was left as the controller of a recovery takes it up; None of an ordinary run."""
    if left is None:
        return None
    return Left(left.fault, left.torque_in_tare_nm, left.torque_out_tare_nm, zeroes_known=not left.zeroes_unknown)
