"""What killed runs left behind, cleaned up when the next run starts: rings that nobody needs, runs of this bench.

A line must not wait for a person to conclude what ended by itself. So the start of a run concludes the deserted runs of
its own bench, and says so. It takes a bounded time: only the newest folders are looked at, and none is begun late.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from recipes import RecipeError
from station.errors import RecordError, StationError
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.run_ring import collect_rings
from station.records.seal import alterations, is_sealed
from station.records.to_paste import to_paste
from station.run.way_back.recover import recover, to_be_concluded

NEWEST_LOOKED_AT = 50
"""Folders: a run of this bench that was deserted is one of its last."""

BEGIN_WITHIN_S = 5.0
"""No conclusion is begun after this time; one takes about as long as the evaluation of a run."""

Say = Callable[[str], None]


def conclude_own(store: Store, bench: str, say: Say) -> None:
    """Conclude the newest deserted runs of a bench; what cannot be concluded now is told and stays as it is."""
    started = time.monotonic()
    for run in _newest(store):
        with suppress(RecordError):  # a damaged manifest is told by `list`, and is no matter of this run
            if run.manifest().bench.name != bench or not to_be_concluded(run) or run.scanning():
                continue
            if time.monotonic() - started > BEGIN_WITHIN_S:
                say(f"run {run.id} is not evaluated yet. Run '{to_paste('conclude', '--all', data=store.data)}'")
                return
            _conclude(run, say)


def _conclude(run: RunRecord, say: Say) -> None:
    try:
        recover(run)
        altered = alterations(run)
    except (StationError, RecipeError, OSError) as error:
        say(f"run {run.id} cannot be evaluated now: {' '.join(str(error).split())}")
        return
    if not to_be_concluded(run):
        manifest = run.manifest()
        found = f"no verdict, because the record was altered: {altered[0]}" if altered else manifest.verdict
        say(
            f"run {run.id} was evaluated afterwards, because its supervisor process had ended: {manifest.state}, "
            f"{found or 'without a verdict'}"
        )


def collect(store: Store) -> list[Path]:
    """Remove the rings of killed runs that nobody needs any more, and return them; see `collect_rings`."""
    needed = set()
    for run in _newest(store):
        with suppress(RecordError):
            manifest = run.manifest()
            if manifest.ring is not None and not is_sealed(manifest):
                needed.add(manifest.ring)
    return collect_rings(needed)


def _newest(store: Store) -> Iterator[RunRecord]:
    yield from reversed(store.newest(NEWEST_LOOKED_AT))
