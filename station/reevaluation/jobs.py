"""Which runs a question is asked of: those that fit and that the chain vouches for, and where each is read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import select

from station.archive.ask import ask
from station.archive.identity import recognise
from station.archive.place import Place
from station.archive.settings import ArchiveSettings
from station.documents.manifest import VERDICTS
from station.records.archive_note import Address, Note, read_note
from station.records.chain.chain_file import Chain
from station.records.chain.entries import SEALED
from station.records.chain.walk import trust_of
from station.records.run_folders import is_run
from station.reevaluation.evaluate_one import Job
from station.reevaluation.question import ReevaluationError
from station.store.quality.lot import Production, production
from station.store.tables import RUNS

COMPLETE = "complete"
MOST_RUNS = 1_000_000_000


class Where(NamedTuple):
    """Conditions on runs; None takes all. since, until: moments in UTC."""

    recipe: str | None = None
    model: str | None = None
    bench: str | None = None
    serial: str | None = None
    operator: str | None = None
    verdict: str | None = None
    since: str | None = None
    until: str | None = None


class Wanted(NamedTuple):
    """The jobs of a question, and runs that fit and cannot be read anywhere, each with why."""

    jobs: list[Job]
    unreadable: dict[str, str]


def where_of(conditions: Sequence[str]) -> Where:
    """Return the conditions of a command line, NAME=VALUE each.

    Raises:
        ReevaluationError: one of them is none.

    """
    found: dict[str, str] = {}
    for text in conditions:
        name, equals, value = (part.strip() for part in text.partition("="))
        if name not in Where._fields or not equals or not value or name in found:
            raise ReevaluationError(
                f"--where: found {text!r}; allowed is NAME=VALUE, each NAME once. Names: {', '.join(Where._fields)}"
            )
        found[name] = _moment(name, value) if name in ("since", "until") else value
    if found.get("verdict") not in (None, *VERDICTS):
        raise ReevaluationError(f"--where verdict: found {found['verdict']!r}; allowed are {', '.join(VERDICTS)}")
    return Where(**found)


def _moment(name: str, text: str) -> str:
    try:
        return datetime.fromisoformat(text).astimezone(UTC).isoformat(timespec="milliseconds")
    except ValueError:
        raise ReevaluationError(
            f"--where {name}: found {text!r}; allowed is a date, as in 2026-01-31 or 2026-01-31T08:00"
        ) from None


def jobs_of(
    data: Path, where: Where, archive: ArchiveSettings | None, *, whole_record: bool, from_archive: bool
) -> Wanted:
    """Return a job for each complete run that fits, oldest first.

    archive: of the data folder, None where it has none. whole_record: the whole record is read, else the trace where
    the archive has it. from_archive: runs of the archive alone, and read there.

    Raises:
        StationError: no such folder; the store cannot be used, or the archive cannot be asked.

    """
    note = read_note(data) if archive is not None else Note()
    if from_archive:
        return _of_archive(data, where, note, archive, whole_record=whole_record)
    with production(data) as look:
        rows = look.connection.execute(_asked(look, where)).tuples().all()
    return _placed(data, rows, note, archive, whole_record=whole_record)


def jobs_for(data: Path, rows: Sequence[tuple[str, str, str, str]], archive: ArchiveSettings | None) -> Wanted:
    """Return a job for each of some runs that reads its trace, where the archive has it, or else its record.

    rows: id, serial number, SHA-256 of the run.json and verdict of each.
    """
    note = read_note(data) if archive is not None else Note()
    return _placed(data, rows, note, archive, whole_record=False)


def _placed(
    data: Path, rows: Sequence[tuple[str, str, str, str]], note: Note, archive: ArchiveSettings | None, *,
    whole_record: bool,
) -> Wanted:  # fmt: skip
    """Return a job for each run at the place where it is read."""
    found = Wanted([], {})
    for run, serial, sha256, verdict in rows:
        address = note.runs.get(run)
        here = is_run(data / run)
        if address is not None and address.run.sha256 == sha256 and (not here or not whole_record):
            job = _archived(Job(run, serial, sha256, verdict), address, archive, whole_record=whole_record)
            if job is not None:
                found.jobs.append(job)
                continue
        if here:
            found.jobs.append(Job(run, serial, sha256, verdict, folder=str(data.resolve() / run)))
        else:
            found.unreadable[run] = "is neither here nor in the archive"
    return found


def _asked(look: Production, where: Where) -> Any:
    asked = select(RUNS.c.run, RUNS.c.serial, RUNS.c.sha256, RUNS.c.verdict)
    asked = asked.where(RUNS.c.chain == look.chain.id, look.trusted(), RUNS.c.state == COMPLETE, RUNS.c.altered == "")
    asked = asked.where(RUNS.c.sha256.is_not(None))
    for name in ("recipe", "model", "bench", "serial", "operator", "verdict"):
        value = getattr(where, name)
        asked = asked if value is None else asked.where(RUNS.c[name] == value)
    asked = asked if where.since is None else asked.where(RUNS.c.started >= where.since)
    asked = asked if where.until is None else asked.where(RUNS.c.started < where.until)
    return asked.order_by(RUNS.c.run)


def _archived(job: Job, address: Address, archive: ArchiveSettings | None, *, whole_record: bool) -> Job | None:
    """Return a job that reads a run in the archive; None where the archive lacks what is read."""
    line, there = address.line, address.run
    if archive is None or line.url != archive.url:
        return None
    if whole_record:
        return job_at(job, archive, line.full.name, there.group, "")
    if line.trace is None or there.trace is None or there.trace_sha256 is None:
        return job_at(job, archive, line.full.name, there.group, "")
    of_trace = job_at(job, archive, line.trace.name, there.trace, there.trace_sha256)
    return replace(of_trace, whole=line.full.name, whole_group=there.group)


def job_at(job: Job, archive: ArchiveSettings, name: str, group: int, trace_sha256: str) -> Job:
    """Return a job with the place in the archive where it is read."""
    return Job(job.run, job.serial, job.sha256, job.verdict, "", archive, name, group, trace_sha256)


def _of_archive(data: Path, where: Where, note: Note, archive: ArchiveSettings | None, *, whole_record: bool) -> Wanted:
    """Return jobs for the runs of the archive; their verdicts are those that the chain vouches for."""
    if archive is None:
        raise ReevaluationError(
            "--archive: the data folder has no archive.yaml, the file that names the archive. See 'lostmotion archive "
            "--help'"
        )
    conditions = [f"state = '{COMPLETE}'"]
    for name in ("recipe", "model", "bench", "serial", "operator"):
        value = getattr(where, name)
        conditions += [] if value is None else [f"{name} = '{value.replace(chr(39), chr(39) * 2)}'"]
    conditions += [] if where.since is None else [f"CAST(started AS TIMESTAMPTZ) >= '{where.since}'"]
    conditions += [] if where.until is None else [f"CAST(started AS TIMESTAMPTZ) < '{where.until}'"]
    sql = f"SELECT DISTINCT run FROM runs WHERE {' AND '.join(conditions)} ORDER BY run"  # noqa: S608 - quoted above
    chain, found = Chain(data), Wanted([], {})
    chain.index()
    keys = trust_of(chain).keys
    place = Place(archive)
    recognise(data, place)
    for (run,) in ask(place, sql, MOST_RUNS).rows:
        address = note.runs.get(run)
        if address is None:
            continue  # of another data folder
        entries = (one for one in chain.entries_of(run) if one.kind == SEALED and one.key in keys and one.signed)
        sealed = next((one for one in entries if one.fields["sha256"] == address.run.sha256), None)
        if sealed is None:
            found.unreadable[run] = "the chain has no entry of a known key that seals its archive copy"
            continue
        if where.verdict not in (None, sealed.fields["verdict"]):
            continue
        job = Job(run, str(sealed.fields["serial"]), address.run.sha256, str(sealed.fields["verdict"]))
        there = _archived(job, address, archive, whole_record=whole_record)
        if there is None:
            found.unreadable[run] = f"is in another archive: {address.line.url}"
        else:
            found.jobs.append(there)
    return found
