"""`lostmotion store`: how far the store is, and making it again."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from station.atomic_file import refused
from station.counted import counted
from station.documents.entries import plain
from station.errors import StationError
from station.records.chain.chain_file import Chain
from station.store.engine import StoreError, is_damaged
from station.store.outbox import rebuild
from station.store.places import set_aside, store_place
from station.store.table_counts import behind, counts
from station.store.view import look_at, opened, warn

SAID_EVERY = 2000


@dataclass(frozen=True)
class StoreState:
    """Where a store is, its rows by table, and how many entries of the chain it is behind."""

    store: str
    rows: Mapping[str, int]
    behind: int


def rebuild_store(data: Path, *, as_json: bool) -> int:
    """Make the store of a data folder again from its chain and its run folders; 0.

    A damaged file of its own is set aside, and a new one made.

    Raises:
        StationError: no such folder, or the store cannot be used.

    """
    _refuse_no_folder(data)
    try:
        return _rebuilt(data, as_json=as_json)
    except StoreError as error:
        place = store_place(data)
        if not (place.own and is_damaged(error.__cause__)):
            raise
        try:
            aside = set_aside(place)
        except OSError as refusal:
            raise refused(Path(str(refusal.filename)), refusal) from error
        warn(f"the store was damaged, and is kept as {aside}. A new one is made")
    return _rebuilt(data, as_json=as_json)


def _rebuilt(data: Path, *, as_json: bool) -> int:
    database = opened(data, may_take_long=True)
    try:
        rebuild(database, Chain(data), told=_tell, warned=warn)
        with look_at(data):
            pass
        found = counts(database, Chain(data))
    finally:
        database.close()
    return _say(StoreState(database.place.shown, found, 0), as_json=as_json)


def store_state(data: Path, *, as_json: bool) -> int:
    """Print where the store of a data folder is, its rows, and how many entries of the chain it is behind; 0.

    Raises:
        StationError: no such folder, or the store cannot be used.

    """
    _refuse_no_folder(data)
    database, chain = opened(data), Chain(data)
    try:
        found = StoreState(database.place.shown, counts(database, chain), behind(database, chain))
    finally:
        database.close()
    return _say(found, as_json=as_json)


def _refuse_no_folder(data: Path) -> None:
    if not data.is_dir():
        raise StationError(f"--data {data}: there is no such folder; name the one that 'lostmotion run' wrote to")


def _tell(done: int, there: int) -> None:
    if done % SAID_EVERY == 0:
        warn(f"{done} of {there} runs are in the store")


def _say(found: StoreState, *, as_json: bool) -> int:
    if as_json:
        sys.stdout.write(json.dumps(plain(found)) + "\n")
        return 0
    sys.stdout.write(f"{found.store}\n")
    sys.stdout.writelines(f"  {name:14} {count:8}\n" for name, count in found.rows.items())
    left = found.behind
    sys.stdout.write(
        "up to date with the chain\n"
        if not left
        else f"behind by {counted(left, 'entry', 'entries')}. The next 'list' brings it up\n"
    )
    return 0
