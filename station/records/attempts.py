"""The attempts of a serial number before the next one: by the signed chain, and by the records where it is silent.

A damaged, altered or lost record does not make a unit new. What the chain says of an attempt counts; its record adds
which metrics failed. Of a record that a retention rule has removed, its trace does; of one from before the chain
that left no trace, the line of its removal says what became of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from station.documents.manifest import INJECTED, INTERRUPTED, SIMULATED, EarlierAttempt, Manifest
from station.documents.result import Result
from station.errors import StationError
from station.records.chain.entries import CREATED, SEALED, Entry
from station.records.chain.lookup import entries_of_serial, removals_of_serial
from station.records.clocks import VIRTUAL, clock_of
from station.records.run_record import MANIFEST, RESULT, RunRecord
from station.records.seal import fingerprint
from station.records.traces import FOLDER, is_as_kept

MOST = 5
"""The newest are told: a master part is measured every day for years."""

TOLD = frozenset({"attempt", "state"})
"""What the line of a removal has that says what became of its run."""


def earlier_attempts(data: Path, runs: Sequence[RunRecord], serial: str) -> tuple[EarlierAttempt, ...]:
    """Return the newest attempts of a serial number, oldest first; damaged runs that no chain knows are left out.

    runs: those that are named after the serial number, oldest first.

    Raises:
        RecordError: the chain cannot be read.

    """
    created, sealed = _in_chain(data, serial)
    removed = removals_of_serial(data, serial)
    traces, told = _traces(data, removed), {run for run, line in removed.items() if line.fields.keys() >= TOLD}
    found: list[EarlierAttempt] = []
    here = {run.id for run in runs}
    for name in sorted({*created, *here, *traces, *told}, reverse=True):
        run = RunRecord(data / name) if name in here else traces.get(name, RunRecord(data / name))
        one = _attempt(run, serial, created.get(name), sealed.get(name))
        if name in removed and name not in here:
            one = _as_removed(one, removed[name])
        if one is not None:
            found.append(one)
        if len(found) == MOST:
            break
    return tuple(reversed(found))


def _traces(data: Path, removed: Mapping[str, Entry]) -> dict[str, RunRecord]:
    """Return the traces of runs whose records were removed, as they were kept, by run; removed: the lines of that."""
    newest = sorted((run for run, line in removed.items() if line.fields["trace"]), reverse=True)[:MOST]
    traces = {run: data / FOLDER / run for run in newest}
    return {run: RunRecord(trace) for run, trace in traces.items() if is_as_kept(trace, removed[run])}


def _as_removed(one: EarlierAttempt | None, line: Entry) -> EarlierAttempt | None:
    """Return an attempt with what the line of its removal says of it; one: what else is known, None for nothing."""
    said = line.fields
    if one is not None:
        return one if one.aside is not None else replace(one, aside=said.get("aside"))
    if not said.keys() >= TOLD:
        return None
    state, verdict, aside = said["state"], said.get("verdict"), said.get("aside")
    return EarlierAttempt(attempt=said["attempt"], run=said["run"], state=state, verdict=verdict, aside=aside)


def _in_chain(data: Path, serial: str) -> tuple[dict[str, Entry], dict[str, Entry]]:
    """Return the lines that begin and conclude the newest runs of a serial number, by run."""
    created: dict[str, Entry] = {}
    sealed: dict[str, Entry] = {}
    for entry in entries_of_serial(data, serial):
        if entry.kind in (CREATED, SEALED):
            (created if entry.kind == CREATED else sealed).setdefault(str(entry.fields["run"]), entry)
        if len(created) == MOST:
            break
    return created, sealed


def _attempt(run: RunRecord, serial: str, created: Entry | None, sealed: Entry | None) -> EarlierAttempt | None:
    """Return what became of a run as an attempt of a serial number; None where it is none, or nobody knows."""
    try:
        manifest = run.manifest()
    except StationError:
        manifest = None
    if manifest is not None and manifest.id != run.id:
        manifest = None  # a copy says nothing of the run that its folder is named after
    if manifest is not None and manifest.recovery_of is not None:
        return None
    if sealed is not None:
        said = sealed.fields
        return EarlierAttempt(
            attempt=said["attempt"],
            run=run.id,
            state=said["state"],
            verdict=said["verdict"],
            failed=_failed(run),
            aside=None if manifest is None or _changed(run, said["sha256"]) else aside_of(manifest),
        )
    if manifest is not None and (created is not None or manifest.serial == serial):
        attempt = manifest.attempt if created is None else created.fields["attempt"]
        return EarlierAttempt(
            attempt=attempt,
            run=run.id,
            state=manifest.state,
            # Without the line that concludes it, of a run that names a chain, a PASS has nothing that speaks for it.
            verdict=None if manifest.chain is not None and manifest.verdict == "PASS" else manifest.verdict,
            failed=_failed(run),
            aside=aside_of(manifest),
        )
    if created is None:
        return None
    return EarlierAttempt(attempt=created.fields["attempt"], run=run.id, state=INTERRUPTED, verdict=None)


def _changed(run: RunRecord, sealed_sha256: str) -> bool:
    """Whether a manifest is not the one that was sealed: then it sets no attempt aside."""
    try:
        return fingerprint(run.folder / MANIFEST).sha256 != sealed_sha256
    except StationError:
        return True


def aside_of(manifest: Manifest) -> str | None:
    """Return why a run is no attempt at a real unit, None where it is one."""
    if manifest.scenario is not None:
        return INJECTED
    return SIMULATED if manifest.unit.virtual or clock_of(manifest.clock) == VIRTUAL else None


def _failed(run: RunRecord) -> tuple[str, ...]:
    """Return the metrics that failed, by their titles without what stands in brackets."""
    try:
        metrics = run.read(Result, RESULT).metrics if run.has(RESULT) else ()
    except StationError:
        return ()
    return tuple((one.title or one.id).partition(" (")[0] for one in metrics if one.verdict == "FAIL")
