"""The folders of a data folder held against its chain: what is missing, copied, renamed, swapped, or from elsewhere."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from collections.abc import Set as AbstractSet

from station.documents.manifest import MANIFEST, Manifest
from station.errors import RecordError
from station.records.begun_by import beginning_of
from station.records.chain.chain_file import CHAIN, CREATED_MANIFEST, Chain
from station.records.chain.entries import SEALED, Entry
from station.records.chain.old_index import INDEX, index_kept, runs_in
from station.records.chain.problems import Problem
from station.records.chain.walk import Walk
from station.records.run_folders import is_text
from station.records.run_record import RunRecord


def folder_problems(
    chain: Chain,
    known: AbstractSet[str],
    folders: Mapping[str, str | None],
    about: Callable[[str], str],
    *,
    sealed: AbstractSet[str],
    removed: AbstractSet[str] = frozenset(),
) -> list[Problem]:
    """Return what is wrong with the folders.

    Args:
        chain: that of the data folder.
        known: every run that the chain knows of.
        folders: every folder with a run.json, and the run that this run.json names; None where it cannot be read.
        about: says of a run that is missing what a person looks for it by.
        sealed: the runs that were concluded.
        removed: runs whose records a rule has removed: they are not missing.

    """
    problems = []
    doubtful = {name: run for name, run in folders.items() if run != name or name not in known}
    held = {name: name if run is None else run for name, run in doubtful.items()}
    elsewhere = {run for name, run in held.items() if run != name and run in known}
    for name, run in held.items():
        if run == name:
            if name not in known:
                kind = "lost_line" if _says_it_is_from_here(chain, name) else "not_in_chain"
                problems.append(Problem(kind, name, f"{name}: this run is not in the chain"))
        elif held.get(run) == name:
            if name < run:  # one line for the two
                problems.append(Problem("swapped", name, f"{name}: its content and that of {run} are exchanged"))
        elif held.get(run, run if run in folders else "") == run:
            problems.append(Problem("copied", name, f"{name}: is a copy of {run}"))
        elif run in known:
            problems.append(Problem("renamed", name, f"{name}: contains run {run}; the folder was renamed"))
        else:
            problems.append(Problem("not_in_chain", name, f"{name}: contains run {run}, which is not in the chain"))
    lost = sorted(known - folders.keys() - elsewhere - removed)
    newest = max(known, default="")
    return problems + [
        Problem("missing", run, f"{run}: {about(run)}; its folder is missing")
        for run in lost
        if not (run == newest and run not in sealed and _is_being_begun(RunRecord(chain.data / run)))
    ]


def unknown_seals(chain: Chain, runs: Iterable[str], trusted: frozenset[str]) -> list[Problem]:
    """Return what speaks of a conclusion of runs that were begun here and are not concluded in their folders.

    A line of a key that nobody trusts makes no verdict true, and keeps nobody from concluding the run. But there may
    have been a verdict: without this nobody is told before the key is trusted.
    """
    problems = []
    for run in runs:
        keys = dict.fromkeys(one.key for one in chain.entries_of(run) if one.kind == SEALED and one.signed)
        created = beginning_of(chain, run, trusted) if keys else None
        if created is None or created.key not in trusted or not trusted.isdisjoint(keys):
            continue
        for key in keys:
            text = f"{CHAIN} says that it is concluded, signed by {key}, which this computer does not know"
            problems.append(Problem("unknown_key", run, f"{run}: is not concluded, but {text}"))
    return problems


def is_from_here(manifest: Manifest, chain: Chain) -> bool:
    """Whether a run.json names this chain as the one in which its run was begun."""
    return manifest.chain is not None and manifest.chain.id == chain.id


def _says_it_is_from_here(chain: Chain, name: str) -> bool:
    try:
        return is_from_here(RunRecord(chain.data / name).manifest(), chain)
    except RecordError:
        return False


def _is_being_begun(run: RunRecord) -> bool:
    """Whether the run.json of a run waits for its name; the newest one has it a moment after its line in the chain."""
    try:
        return run.read(Manifest, CREATED_MANIFEST).id == run.id
    except RecordError:
        return run.has(MANIFEST)  # it has got its name since


def name_problems(names: Iterable[str]) -> list[Problem]:
    """Return the folders of runs, among these, whose names are no text, so that no chain can name them."""
    shown = [_in_signs(name) for name in names if not is_text(name)]
    text = "the name of this folder is no readable text, so this run is not in the chain"
    return [Problem("not_in_chain", name, f"{name}: {text}") for name in shown]


def _in_signs(name: str) -> str:
    """Return a name with what no terminal shows as it is written in signs."""
    text = os.fsencode(name).decode("utf-8", "backslashreplace")
    return "".join(sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in text)


def runs_before(chain: Chain) -> tuple[set[str], list[Problem]]:
    """Return the runs that a folder had before its chain, and what is wrong with their index."""
    before = chain.before
    if before is None:
        return set(), []
    kept = index_kept(chain.data, before)
    if kept is None:
        text = f"{INDEX}: differs from the one at the start of the chain"
        return set(before.unconcluded), [Problem("old_index", "", text)]
    return runs_in(kept) | set(before.unconcluded), []


def about_run(found: Walk, run: str) -> str:
    """Return what the chain says of a run, for a person who looks for it."""
    sealed, created = found.sealed.get(run), found.created.get(run)
    if sealed:
        return about_concluded(sealed[-1])
    return f"{_unit(created)}, not concluded" if created is not None else "from before the chain"


def about_concluded(sealed: Entry) -> str:
    """Return what the line that concludes a run says of it, as `about_run`."""
    return f"{_unit(sealed)}, {sealed.fields['verdict'] or sealed.fields['state']}"


def _unit(entry: Entry) -> str:
    return f"attempt {entry.fields['attempt']} of unit {entry.fields['serial']}"
