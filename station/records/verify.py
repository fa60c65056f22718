"""Everything of a data folder held against its chain: lines, signatures, runs and files; recipes and studies too."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from station.errors import RecordError
from station.records.archive_note import read_note
from station.records.chain.chain_file import Chain
from station.records.chain.missing import altered_problem, unsigned_problems
from station.records.chain.problems import Problem
from station.records.chain.walk import Trust, Walk, attempt_problems, end_problems, key_problems, trust_of, walk
from station.records.data_folder import Store
from station.records.folder_check import about_run, folder_problems, name_problems, runs_before, unknown_seals
from station.records.revisions.history import History
from station.records.run_folders import is_text
from station.records.run_record import RunRecord
from station.records.seal import alterations, is_sealed
from station.records.studies import study_problems
from station.records.traces import trace_problems

NAMED_ONCE = frozenset({"renamed", "copied", "swapped", "not_in_chain", "lost_line"})
"""Kinds of problem that say already why a folder does not fit its run.json."""

MOST_LOOKS = 5
"""Looks at a folder in which units are measured: all but the first are at what was in doubt, which takes moments."""


@dataclass(frozen=True)
class Verified:
    """What was looked at, and what is wrong."""

    chain: Chain
    walk: Walk
    trust: Trust
    runs: int
    concluded: int
    problems: list[Problem]
    removed: int = 0
    """Runs whose records a retention rule has removed; each has its signed line."""
    only_archived: int = 0
    """Of them those that are in the archive, by the note of the folder."""


def verify_folder(
    data: Path, named: tuple[str, ...] = (), *, samples: bool = True, may_be_empty: bool = False
) -> Verified:
    """Check a data folder completely, also one in which units are measured meanwhile.

    Args:
        data: the folder.
        named: public keys whose signatures count; empty for those that this computer knows.
        samples: False compares only the size of the samples.
        may_be_empty: in a folder without a run nothing has to be signed, whatever key is named.

    Raises:
        RecordError: the chain is there and cannot be read.

    """
    chain, sound = Chain(data), set[str]()
    for _ in range(MOST_LOOKS):
        found = _looked_at(data, chain, named, sound, samples=samples)
        doubtful = {one.run for one in found.problems if one.run}
        if not doubtful or chain.seen == chain.seen_now():
            break
        # The chain has grown since it was read: what is in doubt may only be newer than what was read of it.
        chain = Chain(data)
        sound |= found.walk.sealed.keys() - doubtful
    if found.runs or not may_be_empty:
        found.problems.extend(unsigned_problems(found.walk, named))
    return found


def _looked_at(data: Path, chain: Chain, named: tuple[str, ...], sound: AbstractSet[str], *, samples: bool) -> Verified:
    """Hold a folder against its chain as that was read; the files of runs that were found sound are not read again."""
    trust = trust_of(chain, named)
    found = walk(chain, trusted=trust.keys)
    problems = [*found.problems, *end_problems(chain, found.place), *key_problems(found, trust)]
    problems += attempt_problems(found, trust)
    names = Store(data).folders()
    runs = [RunRecord(data / name) for name in names if is_text(name)]
    problems += name_problems(names)
    chain.index()
    if chain.there:
        before, old_problems = runs_before(chain)
        held = {run.id: _named_in(run) for run in runs}
        known = {*found.created, *found.sealed, *before}
        removed = {run: line for run, line in found.removed.items() if line.key in trust.keys}
        problems += old_problems
        about = partial(about_run, found)
        problems += folder_problems(chain, known, held, about, sealed=found.sealed.keys(), removed=removed.keys())
        problems += trace_problems(data, removed)
    told = {problem.run for problem in problems if problem.kind in NAMED_ONCE}
    concluded = set[str]()
    for run in runs:
        if run.id in sound:
            concluded.add(run.id)
            continue
        try:
            concluded |= {run.id} if is_sealed(run.manifest()) else set()
            altered = alterations(run, samples=samples, chain=chain, trusted=trust.keys)
        except (RecordError, KeyError, TypeError, AttributeError) as error:
            problems.append(Problem("damaged", run.id, f"{run.id}: {error}"))
            continue
        if run.id not in told:
            problems += [altered_problem(run.id, one) for one in altered]
    open_still = [run for run in found.sealed if run not in concluded and run not in found.removed]
    problems += unknown_seals(chain, open_still, trust.keys)
    problems += _recipe_problems(data, trust)
    problems += [Problem("study", "", text) for text in study_problems(data, trust.keys)]
    here = {one.id for one in runs}
    gone = {run for run, line in found.removed.items() if line.key in trust.keys and run not in here}
    try:
        archived = set(read_note(data).runs)
    except RecordError as error:
        archived = set()
        problems.append(Problem("archive", "", str(error)))
    return Verified(chain, found, trust, len(runs), len(concluded), problems, len(gone), len(gone & archived))


def _recipe_problems(data: Path, trust: Trust) -> list[Problem]:
    try:
        history = History(data, trust.keys)
    except RecordError as error:
        return [Problem("recipes", "", str(error))]
    return [Problem("recipes", "", text) for text in (*history.problems, *history.text_problems())]


def _named_in(run: RunRecord) -> str | None:
    try:
        return run.manifest().id
    except RecordError:
        return None
