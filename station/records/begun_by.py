"""By what a run was begun: hashes of recipe and bench in run.json, and in the signed line that begins the run.

That line has those of program and device profiles too, each by its name: the conclusion takes from the program which
scan belongs to which loop, and who reads a record takes from the profiles what its devices were told. What it does not
name is no part of what the run was begun with.

Until a run is concluded anybody can change its files, and run.json with them; the line in the chain stays as it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from station.documents.manifest import MANIFEST, ChainPlace, Manifest
from station.records.chain.chain_file import CHAIN, CREATED_MANIFEST, Chain
from station.records.chain.entries import CREATED, REMOVED, SEALED, Entry
from station.records.chain.lookup import entries_of_run
from station.records.chain.walk import candidates
from station.records.program_file import PROGRAM
from station.records.run_record import PROFILES
from station.there import is_there

BEGUN = "begun"
"""State of a run that was begun and nothing more: its folder is there, and its run.json waits for its name."""


class BegunBy(NamedTuple):
    """SHA-256 of the recipe and of the bench file of a run; None for one that is not there."""

    recipe: str | None
    bench: str | None


def beginning_of(chain: Chain, run: str, trusted: frozenset[str] | None = None) -> Entry | None:
    """Return the signed line that begins a run, as `candidates`; None where there is none."""
    begun = (one for one in chain.entries_of(run) if one.kind == CREATED)
    return next(iter(candidates(chain, begun, trusted)), None)


def begun_and_left(data: Path, names: Iterable[str]) -> Entry | None:
    """Return the line, which counts, of the first of these folders whose process was killed just behind that line.

    Its run.json waits for its name, so nobody finds it as a run before it is concluded, or the next one is begun.
    """
    waiting = (name for name in names if is_there(data / name / CREATED_MANIFEST))
    found = (entries_of_run(data, name) for name in waiting if not is_there(data / name / MANIFEST))
    return next((line for lines in found if (line := _one_of(lines, CREATED)) and not _has_ended(lines)), None)


def concluded_and_lost(data: Path, names: Iterable[str]) -> Entry | None:
    """Return the line, which counts, that concluded the first of these folders whose run.json is gone.

    Nobody finds it as a run, whatever else lies there. What a rule has removed is not lost.
    """
    found = (entries_of_run(data, name) for name in names if is_there(data / name / MANIFEST) is False)
    return next((line for lines in found if (line := _one_of(lines, SEALED)) and not _one_of(lines, REMOVED)), None)


def _has_ended(lines: Iterable[Entry]) -> bool:
    return any(one.kind in (SEALED, REMOVED) for one in lines)


def _one_of(lines: Iterable[Entry], kind: str) -> Entry | None:
    return next((one for one in lines if one.kind == kind), None)


def begun_text(line: Entry) -> str:
    """Return what is said of a run of which there is the line that begins it and nothing more, and what to do."""
    run, unit = line.fields["run"], f"attempt {line.fields['attempt']} of unit {line.fields['serial']}"
    return (
        f"run {run}: {unit} was begun and not concluded; nothing was measured in it. If its process was killed, run "
        f"'lostmotion conclude {run}'"
    )


def is_named_by(manifest: Manifest, chain: Chain, created: Entry) -> bool:
    """Whether run.json names this line of the chain as the one that begins its run."""
    return manifest.chain == ChainPlace(id=chain.id, counter=created.counter, previous=created.fields["previous"])


def not_begun_by(manifest: Manifest, found: BegunBy) -> list[str]:
    """Return which of recipe and bench is not the one of run.json, as `<file>: <how>`."""
    return [
        f"{part}.yaml: is not the {part} that the run was started with"
        for part, own, kept in zip(BegunBy._fields, found, _said(manifest), strict=True)
        if own != kept
    ]


def unlike_its_line(manifest: Manifest, created: Entry) -> list[str]:
    """Return where run.json names another recipe or bench than the line that begins the run, as `<file>: <how>`."""
    return [
        f"{MANIFEST}: names another {part} than the entry of {CHAIN} that begins this run"
        for part, own in zip(BegunBy._fields, _said(manifest), strict=True)
        if own != created.fields[part]
    ]


def is_begun_with(name: str) -> bool:
    """Whether a file of a run is its program, or one of its profiles."""
    return name == PROGRAM or name.startswith(f"{PROFILES}/")


def begun_with(created: Entry) -> dict[str, str]:
    """Return SHA-256 of program and profiles by the line that begins a run, by name; an older line names none."""
    return dict(created.fields.get("files") or {})


def not_begun_with(created: Entry, files: Mapping[str, str]) -> list[str]:
    """Return which of program and profiles is not the one of the line that begins the run, as `<file>: <how>`.

    files: SHA-256 of the run's files, by name; what the line does not name may be anything.
    """
    return [
        f"{name}: differs from what the run was begun with, by the entry of {CHAIN} that begins it"
        for name, sha256 in begun_with(created).items()
        if files.get(name) != sha256
    ]


def _said(manifest: Manifest) -> BegunBy:
    return BegunBy(manifest.recipe.sha256, manifest.bench.sha256)
