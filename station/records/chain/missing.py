"""A chain that ought to be in a folder and is not: what a run says of it, and what this computer knows.

A folder from before there were chains has none, and its runs name none. A run that names one was sealed there: without
that chain nothing but its own files speaks for it, and who changed one of them changed the others too.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from station.documents.manifest import MANIFEST, ChainPlace, Manifest
from station.documents.reading import read_document
from station.errors import RecordError
from station.records.chain.chain_file import CHAIN, Chain
from station.records.chain.entries import CREATED
from station.records.chain.head import chain_seen_in, places_written
from station.records.chain.keys import FOLDER_KEYS
from station.records.chain.old_index import INDEX
from station.records.chain.problems import Problem
from station.records.chain.walk import Walk, trust_of
from station.records.run_folders import runs_there
from station.there import is_there

NO_CHAIN_BESIDE = f"{MANIFEST}: names "
"""How it begins what `why_not_alone` says: of these runs no file was found changed, their chain is away."""


def why_not_alone(manifest: Manifest, data: Path) -> str:
    """Return why a run that lies in a folder without a chain is not one from before the chain; '' where it may be.

    A run.json that was rid of its entry may still be known here: from a chain that this computer wrote elsewhere.
    """
    if manifest.chain is not None:
        return _away(manifest.chain)
    if chain_seen_in(data) is not None:
        return f"{CHAIN}: is missing, and this computer has written one in this folder"
    place = _began_here(manifest.id, data)
    return f"{NO_CHAIN_BESIDE}no chain, but the one in {place} begins this run" if place else ""


def _away(named: ChainPlace) -> str:
    said = f"{NO_CHAIN_BESIDE}entry {named.counter} of chain {named.id}, which is not in this folder"
    return f"{said}; restore {CHAIN} from a backup"


def altered_problem(run: str, text: str) -> Problem:
    """Return an alteration of a run as a problem: one of its chain where that is away, else one of its files."""
    return Problem("no_chain" if text.startswith(NO_CHAIN_BESIDE) else "altered", run, f"{run}: {text}")


def unsigned_problems(found: Walk, named: tuple[str, ...]) -> list[Problem]:
    """Return what is wrong with a folder in which nothing is signed, where somebody named the key of who signs there.

    Without a named key it may be a folder from before the chain. With one, nothing shows that it is that bench's.
    """
    if not named or found.keys:
        return []
    text = f"{CHAIN}: has no signed entry, so nothing here is signed by {', '.join(named)}"
    return [Problem("unsigned", "", text)]


def chain_named_in(data: Path) -> str | None:
    """Return the id of the chain that the newest readable run of a folder names; None where it names none."""
    for name in reversed(runs_there(data)):
        try:
            named = read_document(Manifest, data / name / MANIFEST).chain
        except RecordError:
            continue
        return None if named is None else named.id
    return None


def is_data_folder(folder: Path) -> bool:
    """Whether runs were kept in a folder: it has a chain, an index, or had a chain that this computer wrote there."""
    return any(is_there(folder / name) is not False for name in (CHAIN, INDEX)) or chain_seen_in(folder) is not None


def stands_alone(folder: Path) -> bool:
    """Whether the folder of a run lies in no data folder, nor beside other runs: somebody was given this one run."""
    data = folder.parent
    return not is_data_folder(data) and not is_there(data / FOLDER_KEYS) and runs_there(data) in ([], [folder.name])


def _began_here(run: str, data: Path) -> str:
    """Return in which other folder this computer keeps the chain that begins a run; '' where none is known."""
    own = str(data.resolve())
    for chain_id, path in places_written():
        chain = Chain(Path(path))
        if path != own and run in _runs_in(path, chain.seen_now()) and chain.id == chain_id:
            keys = trust_of(chain).keys
            if any(one.kind == CREATED and one.signed and one.key in keys for one in chain.entries_of(run)):
                return path
    return ""


@lru_cache(maxsize=16)
def _runs_in(path: str, seen: str) -> frozenset[str]:
    """Return the runs that a chain names; kept, for who looks at all runs of a folder asks for each of them."""
    try:
        return frozenset(Chain(Path(path)).runs() if seen else ())
    except RecordError:  # it says nothing now, and nothing else depends on it
        return frozenset()
