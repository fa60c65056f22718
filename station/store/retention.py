"""Retention: which records of runs a plant keeps for how long, by a table in a file, and their removal.

    rules:
      - {id: good products, class: product, verdict: PASS, keep_days: 730, then: trace}

The first rule that fits a run counts; a run that no rule fits is kept. Never removed are a run that was not concluded
or is not as it was sealed, the newest run of a bench, of a master part and of a serial number, and one of which not
every file is in a backup with the same SHA-256; by a rule with `kept_in: archive`, one whose copy in the archive, read
then, lacks a byte that is sealed. What is removed has a signed line in the chain, and is not missing.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, model_validator

from recipes import RecipeError, load_document
from recipes.text.section import refusal
from station.atomic_file import read_file, sync_folder
from station.documents.manifest import MANIFEST, Manifest
from station.errors import RecordError, StationError
from station.records.attempts import aside_of
from station.records.chain.entries import REMOVED
from station.records.chain.writing import writing_to
from station.records.clocks import VIRTUAL, clock_of
from station.records.data_folder import Store
from station.records.run_record import BENCH_COPY, RECIPE_COPY, RESULT, RunRecord
from station.records.seal import alterations, fingerprint, is_sealed
from station.records.traces import keep_trace
from station.reports.content import LOOP_CSV
from station.reports.report_of_run import loop_of

FILE = "retention.yaml"
PRODUCT, MASTER, VIRTUAL_RUN, INJECTED = "product", "master", "virtual", "injected"
TRACE, NOTHING = "trace", "nothing"
BACKUP, ARCHIVE = "backup", "archive"
KEPT_OF_A_TRACE = (MANIFEST, RESULT, RECIPE_COPY, BENCH_COPY)

RunClass = Literal["product", "master", "virtual", "injected"]
Outcome = Literal["PASS", "FAIL", "NOT DECIDABLE", "none"]


class Rule(BaseModel):
    """A row: which runs, for how many days their whole record is kept, and what is kept then.

    `run_class`: product, master (part), virtual (bench or time), injected (faults). `verdict`: none is that of a run
    that did not come to its end. Where either is left out, any fits. `then`: trace keeps result and loop. `kept_in`:
    where a copy of the record must be before it goes.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    id: Annotated[str, Field(min_length=1, max_length=60)]
    run_class: RunClass | None = Field(default=None, alias="class")
    verdict: Outcome | None = None
    keep_days: Annotated[int, Field(ge=1, le=36_500)]
    then: Literal["trace", "nothing"]
    kept_in: Literal["backup", "archive"] = "backup"

    def fits(self, run: Manifest) -> bool:
        """Say whether a run is one that the rule is for."""
        verdict = run.verdict if run.state == "complete" and run.verdict else "none"
        return self.run_class in (None, class_of(run)) and self.verdict in (None, verdict)


class Rules(BaseModel):
    """The file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    rules: tuple[Rule, ...] = Field(min_length=1, max_length=100)

    @model_validator(mode="after")
    def _named_once(self) -> Rules:
        ids = [rule.id for rule in self.rules]
        twice = next((one for one in ids if ids.count(one) > 1), None)
        if twice is not None:
            raise refusal(f"two rules with the id {twice!r}", "each id once", "Give one of them another id.")
        return self


class Planned(NamedTuple):
    """A run that a rule is for and whose days are over; why_not: what stands against its removal, '' for nothing.

    kept_in: where a copy of its record must be.
    """

    run: str
    serial: str
    rule: str
    then: str
    days: int
    bytes: int
    why_not: str = ""
    kept_in: str = BACKUP


@dataclass(frozen=True)
class Removal:
    """What became of a plan: runs that were removed, and those that were not, each with why."""

    removed: tuple[Planned, ...]
    kept: tuple[Planned, ...]


def class_of(run: Manifest) -> RunClass:
    """Return which class a run is of; injected faults count before all else, then the virtual bench."""
    if run.scenario is not None:
        return "injected"
    if run.bench.embedded or run.unit.virtual or clock_of(run.clock) == VIRTUAL:
        return "virtual"
    return "master" if run.unit.master is not None else "product"


def load_rules(data: Path, named: Path | None = None) -> Rules:
    """Return the rules of a data folder, or those of the file that was named.

    Raises:
        StationError: there is no such file.
        RecipeError: with all problems of the file.

    """
    file = named or data / FILE
    if not file.is_file():
        raise StationError(
            f"{file}: the file with the retention rules does not exist. Write it, or name another file with --rules"
        )
    return load_document(file, Rules)


def plan(data: Path, rules: Rules, now: datetime) -> tuple[Planned, ...]:
    """Return the runs whose days are over, oldest first, with what stands against the removal of each.

    Raises:
        RecordError: the chain cannot be read.

    """
    runs = Store(data).runs()
    manifests = {run.id: found for run in runs if (found := _manifest(run)) is not None}
    newest = _newest(manifests)
    planned = []
    for run in runs:
        manifest = manifests.get(run.id)
        rule = None if manifest is None else next((one for one in rules.rules if one.fits(manifest)), None)
        if manifest is None or rule is None:
            continue
        days = (now - datetime.fromisoformat(manifest.started)).days
        if days > rule.keep_days:
            why = _why_not(run, manifest, newest)
            size = sum(one.stat().st_size for one in run.folder.rglob("*") if one.is_file())
            planned.append(Planned(run.id, manifest.serial, rule.id, rule.then, days, size, why, rule.kept_in))
    return tuple(planned)


def _manifest(run: RunRecord) -> Manifest | None:
    try:
        return run.manifest()
    except RecordError:
        return None  # nobody knows whose it is: it stays, and `verify` names it


def _newest(manifests: Mapping[str, Manifest]) -> set[str]:
    """Return the newest run of each bench and of each serial number, which the next start is judged by."""
    newest: dict[tuple[str, str], str] = {}
    for run, manifest in sorted(manifests.items()):
        newest["bench", manifest.bench.name] = newest["serial", manifest.serial] = run
    return set(newest.values())


def _why_not(run: RunRecord, manifest: Manifest, newest: set[str]) -> str:
    if not is_sealed(manifest):
        return "the run is not concluded"
    if run.folder.is_symlink():
        return "its folder is a link. Put the folder in the place of the link"
    if run.id in newest:
        return "this is the newest run of its bench or of its serial number"
    altered = alterations(run)
    return f"the run has changed since it was sealed: {altered[0]}" if altered else ""


def apply(
    data: Path,
    planned: Sequence[Planned],
    backed_up: Mapping[str, str],
    person: str,
    told: Callable[[Planned], None] = lambda _: None,
    *,
    why_not_archived: Callable[[RunRecord], str] = lambda _: "is not in the archive",
) -> Removal:
    """Remove what is planned and has its copy; a trace is kept and the chain has its line before a file goes.

    backed_up: SHA-256 of every file in the backup, by its path in the data folder. why_not_archived: compares the copy
    of a run in the archive, and returns why it cannot stand in for the record, '' where it can.

    Raises:
        RecordError: the chain or a trace cannot be written; what was removed until then has its line.

    """
    removed, kept = [], []
    for one in planned:
        run = RunRecord(data / one.run)
        why = one.why_not or (why_not_archived(run) if one.kept_in == ARCHIVE else _not_backed_up(data, run, backed_up))
        files: dict[str, bytes] = {}
        if not why and one.then == TRACE:
            try:
                files = _trace_of(run)
            except (StationError, RecipeError, OSError) as error:
                why = f"its trace cannot be made: {error}"
        done = one._replace(why_not=why)
        if why:
            kept.append(done)
        else:
            _remove(data, run, one, person, files)
            removed.append(done)
        told(done)
    return Removal(tuple(removed), tuple(kept))


def _not_backed_up(data: Path, run: RunRecord, backed_up: Mapping[str, str]) -> str:
    for path in _files(run):
        name = path.relative_to(data).as_posix()
        if backed_up.get(name) != fingerprint(path).sha256:
            return f"the file {name} differs from the backup"
    return ""


def _files(run: RunRecord) -> Iterator[Path]:
    return (one for one in sorted(run.folder.rglob("*")) if one.is_file())


def _trace_of(run: RunRecord) -> dict[str, bytes]:
    files = {name: read_file(run.folder / name, most=None) for name in KEPT_OF_A_TRACE if run.has(name)}
    if run.manifest().state == "complete":
        files[LOOP_CSV] = loop_of(run)
    return files


def _remove(data: Path, run: RunRecord, one: Planned, person: str, files: Mapping[str, bytes]) -> None:
    trace = keep_trace(data, run.id, files) if files else ""
    sha256, manifest = fingerprint(run.folder / MANIFEST).sha256, run.manifest()
    said = {"run": run.id, "serial": one.serial, "sha256": sha256, "rule": one.rule, "person": person, "trace": trace}
    old = {"attempt": manifest.attempt, "state": manifest.state, "verdict": manifest.verdict}
    with writing_to(data) as chain:
        chain.append(REMOVED, **said, aside=aside_of(manifest), **(old if manifest.chain is None else {}))
    try:
        shutil.rmtree(run.folder)
        sync_folder(data)
    except OSError as error:
        raise RecordError(
            f"{run.folder}: this folder cannot be removed: {error.strerror}. Remove it by hand"
        ) from error
