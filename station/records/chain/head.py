"""What this computer has last seen of a chain, outside its data folder: how far it went, and who may sign in it.

    <own place>/chains/<chain>/<path>.json   counter and hash of the newest entry, path of the folder, keys; signed
    <own place>/folders/<path>.json          which chain lies in a data folder

So a chain that was cut off at its end, or replaced with all of its folder, is noticed on the computer that wrote it.
"""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

from definitions.number_formats import LARGEST_COUNT
from station.atomic_file import LARGEST_SMALL_FILE, read_file, write_atomic
from station.documents.entries import Plain
from station.errors import RecordError, StationError
from station.own_place import own_folder, own_place
from station.records.chain.keys import (
    FOLDER_KEYS,
    BenchKey,
    keys_in,
    own_public_key,
    signed_by,
    trusted_by_person,
)

CHAINS, FOLDERS = "chains", "folders"


@dataclass(frozen=True)
class Head:
    """Newest entry of a chain that this computer has seen, and the keys that it has pinned for it."""

    chain: str
    counter: int
    sha256: str
    path: str
    keys: tuple[str, ...]


def head_of(chain: str, data: Path) -> Head | None:
    """Return what was last seen of a chain in a data folder; None where this computer never wrote to it.

    Of a folder that was moved, that of its old place counts. A copy beside the original has none, and goes its own way.
    """
    own = _signed(own_place() / CHAINS / _name(chain) / f"{_path_name(data)}.json")
    if own is not None:
        return own
    moved = [
        head for head in heads_of(chain) if chain_seen_in(Path(head.path)) != chain or not Path(head.path).is_dir()
    ]
    return max(moved, key=lambda head: head.counter, default=None)


def heads_of(chain: str) -> list[Head]:
    """Return what was seen of a chain in every place that it had."""
    files = (own_place() / CHAINS / _name(chain)).glob("*.json")
    return [head for path in files if (head := _signed(path)) is not None]


def places_written() -> list[tuple[str, str]]:
    """Return every chain that this computer has written, and the folder in which it did: id and path, each once."""
    heads = (_signed(path) for path in (own_place() / CHAINS).glob("*/*.json"))
    return sorted({(head.chain, head.path) for head in heads if head is not None})


def _signed(path: Path) -> Head | None:
    try:
        return _head_in(read_file(path, LARGEST_SMALL_FILE))
    except RecordError:
        return None


@lru_cache(maxsize=256)
def _head_in(content: bytes) -> Head | None:
    """Return what was seen of a chain as a file says it, None where it is not signed; kept for who asks again soon."""
    found = _object_in(content)
    if found is None:
        return None
    signature, key = str(found.pop("signature", "")), str(found.pop("key", ""))
    with suppress(KeyError, TypeError, ValueError):
        # No chain goes further: an earlier program took such a head from a forged line.
        if 1 <= found["counter"] <= LARGEST_COUNT and signed_by(key, _content(found), signature):
            return Head(**{**found, "keys": tuple(found["keys"])})
    return None


def chain_seen_in(data: Path) -> str | None:
    """Return the id of the chain that this computer last wrote in a data folder; None where it never did."""
    return _chain_seen(_path_name(data))


def _chain_seen(name: str) -> str | None:
    try:
        found = _object_in(read_file(own_place() / FOLDERS / f"{name}.json", LARGEST_SMALL_FILE))
    except RecordError:
        return None
    return None if found is None else str(found.get("chain"))


def counting_keys(data: Path, chain: str) -> tuple[frozenset[str], frozenset[str]]:
    """Return the keys that count in a data folder with this chain: those known here, and others known from it alone.

    The folder itself is asked on a computer that never wrote to it, and knows the chain from nowhere else.
    """
    own = own_public_key()
    known = {*trusted_by_person(), *([own] if own else [])}
    heads = heads_of(chain)
    if heads or chain_seen_in(data) is not None:
        return frozenset(known.union(*(head.keys for head in heads))), frozenset()
    return frozenset(known), frozenset(keys_in(data / FOLDER_KEYS)) - known


def keep_head(head: Head, key: BenchKey) -> None:
    """Keep what was seen. A disk that refuses that costs no run: the chain itself is on disk already."""
    row = asdict(head) | {"keys": list(head.keys)}
    whole = row | {"key": key.public, "signature": key.sign(_content(row))}
    with suppress(StationError):
        name = _digest(head.path)
        write_atomic(own_folder(f"{CHAINS}/{_name(head.chain)}") / f"{name}.json", _content(whole))
        if _chain_seen(name) != head.chain:
            place = {"chain": head.chain, "path": head.path}
            write_atomic(own_folder(FOLDERS) / f"{name}.json", _content(place))


def _content(row: Plain) -> bytes:
    return json.dumps(row, ensure_ascii=False, sort_keys=True).encode()


def _name(chain: str) -> str:
    return chain if chain.isalnum() else _digest(chain)


def _path_name(data: Path) -> str:
    return _digest(str(data.resolve()))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _object_in(content: bytes) -> Plain | None:
    try:
        found = json.loads(content)
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None
