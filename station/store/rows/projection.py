"""From one run's folder to its rows: a function of the folder and of what the chain says of the run."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict

from sqlalchemy import Connection, delete, insert, select, text
from sqlalchemy.exc import DataError, IntegrityError

from station.atomic_file import seen_text
from station.documents.manifest import Manifest
from station.documents.ratio import RatioRecord
from station.documents.reading import NEXT_STEP
from station.documents.result import MetricValue, Result, SideValue
from station.errors import RecordError
from station.records.chain.chain_file import Chain
from station.records.chain.entries import CREATED, SEALED, Entry
from station.records.chain.head import chain_seen_in
from station.records.chain.walk import candidates, trust_of
from station.records.run_record import CALIBRATION, MANIFEST, RESULT, RunRecord
from station.records.seal import CONCLUDED, NO_RESULT, NOT_READ, alterations, is_sealed, names_to_seal
from station.reports.headline import manifest_badges, objection, virtual_badges
from station.store import tables
from station.store.plant.hours import COMPLETE, FAIL, UNDECIDED, count_hours, hour_of
from station.store.plant.meanings import Meaning, number_of, put_meanings
from station.store.plant.months import make_months
from station.store.plant.retests import note_attempts
from station.store.rows.shared_rows import REFERENCES, drop_unnamed, file_rows, put_shared, shared_by, unit_rows
from station.store.tables import Row, Rows

MOST_AT_ONCE = 500
"""Runs that one statement names: databases have limits."""

LONGEST_CAUSE = 200

NOT_IN_PLACE = f"{MANIFEST}: the one that was sealed is not in its place yet"

REFUSED = (DataError, IntegrityError, OverflowError, UnicodeError)
"""How a database, or what speaks to it, refuses a value: one too large, a text that it cannot write, a row twice."""

OUTPUT_TORQUE = "output torque"
MEASURED, CONVERTED = "output torque as measured", "output torque converted from the input's"
"""Where the output torque of a run comes from, as its stage says."""

_OF_CHAIN = (f"SELECT 1 FROM {name} WHERE chain = :chain" for name in tables.METADATA.tables)  # noqa: S608 - constants
ANY_ROW = text(f"{' UNION ALL '.join(_OF_CHAIN)} LIMIT 1")
"""Asks whether a chain has a row in any table; PostgreSQL sends all that is asked for before the first can be read."""


def rows_of(run: RunRecord, chain: Chain, *, samples: bool = False) -> Rows:
    """Return the rows of a run; of one that is damaged, altered or not concluded, what can be told for sure.

    What could not be read at this look is compared again at the next one: then nothing is kept as seen of the run.

    samples: compare every byte of the samples, and not their size alone.
    """
    found, unread = _rows_and_unread(run, chain, samples=samples)
    if unread or (tables.RUNS in found and not chain.there and chain_seen_in(chain.data) is not None):
        for row in found.get(tables.RUNS, []):
            row |= {"seen": "", "seen_files": ""}
    return found


def _rows_and_unread(run: RunRecord, chain: Chain, *, samples: bool) -> tuple[Rows, bool]:
    """Return the rows of a run, and whether some file of it could not be read."""
    created, sealed = _entries_of(run, chain)
    name, start, waits = chain.id, chain.start, run.has(CONCLUDED)
    try:
        manifest = run.manifest()
        if not waits and not is_sealed(manifest) and _is_strange(chain, created, sealed):
            sealed = None
        signers = {one.key for one in (created, sealed, start) if one is not None}  # whom to trust asks who looks
        altered = alterations(run, samples=samples, chain=chain, trusted=frozenset(signers))
        # One that is altered although it is open was concluded: the index from before the chain says so.
        concluded = sealed is not None or is_sealed(manifest) or bool(altered)
        if sealed is not None and not is_sealed(manifest):
            altered = altered or (_not_in_place(run),)
        result = run.read(Result, RESULT) if concluded and not altered else None
        found = _attempt_rows(run, chain, manifest, created)
        if concluded:
            found |= {tables.RUNS: [_run_row(name, run, manifest, result, sealed, altered)]}
            found |= {} if result is None else _result_rows(name, run, result)
            found |= {} if altered else unit_rows(chain, manifest)
    except RecordError as error:
        unread = isinstance(error.__cause__, OSError)
        return _damaged_rows(run, chain, created, sealed, f"{MANIFEST}: {error}"), unread
    return found, any(text.endswith((NOT_READ, NO_RESULT)) or waits_for_its_name(text) for text in altered)


def _entries_of(run: RunRecord, chain: Chain) -> tuple[Entry | None, Entry | None]:
    """Return the lines that begin and conclude a run, as far as the chain has them."""
    found = [
        next(iter(candidates(chain, (one for one in chain.entries_of(run.id) if one.kind == kind))), None)
        for kind in (CREATED, SEALED)
    ]
    return found[0], found[1]


def _is_strange(chain: Chain, created: Entry | None, sealed: Entry | None) -> bool:
    """Whether a run was concluded by a line of a key that does not count, and begun by one of a key that does.

    Anybody can write it: of a run that is open by its run.json it says nothing.
    """
    if created is None or sealed is None or created.key == sealed.key:
        return False
    keys = trust_of(chain).keys
    return created.key in keys and sealed.key not in keys


def waits_for_its_name(text: str) -> bool:
    """Whether this is said of a run whose sealed run.json has not got its name yet: nothing of it was altered."""
    return text.startswith(NOT_IN_PLACE)


def _not_in_place(run: RunRecord) -> str:
    if run.deserted():
        return f"{NOT_IN_PLACE}: its process has ended. Run 'lostmotion conclude {run.id}'"
    return f"{NOT_IN_PLACE}: it is still being written. Look again in a moment"


def put_runs_apart(connection: Connection, chain: Chain, found: Mapping[str, Rows]) -> None:
    """Put the rows of runs as `put_rows`; a run with a value that the database refuses is damaged, and no other one."""
    try:
        with connection.begin_nested():
            put_rows(connection, chain, found)
    except REFUSED as error:
        if len(found) > 1:
            for run, rows in found.items():
                put_runs_apart(connection, chain, {run: rows})
            return
        cause = " ".join(str(getattr(error, "orig", None) or error).split())
        with suppress(*REFUSED), connection.begin_nested():  # what the chain says of it may be what is refused
            put_rows(
                connection, chain, {run: _refused_rows(RunRecord(chain.data / run), chain, cause) for run in found}
            )


def put_rows(connection: Connection, chain: Chain, found: Mapping[str, Rows]) -> None:
    """Put the rows of runs in the place of those that these runs have."""
    before = shared_by(connection, chain, list(found))
    hours, serials = _removed(connection, chain.id, list(found))
    together: Rows = {}
    for rows in found.values():
        for table, content in rows.items():
            together.setdefault(table, []).extend(content)
    make_months(connection, found)
    for table, content in together.items():
        if table is tables.MEANINGS:
            meanings = (Meaning(*(str(row[name]) for name in Meaning._fields)) for row in content)
            put_meanings(connection, chain.id, meanings)
        elif table in REFERENCES:
            put_shared(connection, table, content)
        elif content:
            connection.execute(insert(table), content)
    drop_unnamed(connection, chain, before, found, lambda run: rows_of(run, chain))
    came = together.get(tables.RUNS, [])
    _bring_up_plant(
        connection,
        chain.id,
        hours.union(str(row["hour"]) for row in came),
        serials.union(str(row["serial"]) for row in came),
    )


def remove_rows(connection: Connection, chain: Chain, runs: Sequence[str]) -> None:
    """Remove the rows of runs, and what no other run shares with them."""
    before = shared_by(connection, chain, runs)
    hours, serials = _removed(connection, chain.id, runs)
    drop_unnamed(connection, chain, before, {}, lambda run: rows_of(run, chain))
    _bring_up_plant(connection, chain.id, hours, serials)


def remove_chain(connection: Connection, chain: str) -> None:
    """Remove all rows of a chain."""
    if connection.execute(ANY_ROW, {"chain": chain}).first() is None:
        return  # a statement for each table takes longer than to put in a few runs
    for table in tables.METADATA.sorted_tables:
        connection.execute(delete(table).where(table.c.chain == chain))


def _bring_up_plant(connection: Connection, chain: str, hours: Collection[str], serials: Collection[str]) -> None:
    count_hours(connection, chain, note_attempts(connection, chain, serials).union(hours))


def _removed(connection: Connection, chain: str, runs: Sequence[str]) -> tuple[set[str], set[str]]:
    """Remove the rows of runs; return the hours that must be counted anew, and the serial numbers looked at."""
    hours, serials = set[str](), set[str]()
    of_run = tables.RUNS.c
    for begin in range(0, len(runs), MOST_AT_ONCE):
        some = runs[begin : begin + MOST_AT_ONCE]
        there = select(of_run.hour, of_run.serial).where(of_run.chain == chain, of_run.run.in_(some))
        for hour, serial in connection.execute(there):
            hours.add(hour)
            serials.add(serial)
        for table in tables.OF_A_RUN:
            connection.execute(delete(table).where(table.c.chain == chain, table.c.run.in_(some)))
    return hours, serials


def seen(path: str, folder: int | None = None) -> str:
    """Return what `seen_text` has of a file, '' where it is not there; folder: open one that the path begins in."""
    try:
        return seen_text(os.stat(path, dir_fd=folder))
    except OSError:
        return ""


def seen_files(run: RunRecord) -> str:
    """Return the same of every file that the verdict rests on, as one hash."""
    there = ((name, seen(f"{run.folder}/{name}")) for name in names_to_seal(run))
    text = "\n".join(f"{name}={found}" for name, found in there if found)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _attempt_rows(run: RunRecord, chain: Chain, manifest: Manifest, created: Entry | None) -> Rows:
    """Return what is known of a run from its beginning: as its signed entry has it, where the chain has one."""
    if created is not None:
        return _begun_rows(run, chain, created)
    recipe_sha256, bench_sha256 = manifest.recipe.sha256, manifest.bench.sha256
    attempt: Row = {
        "chain": chain.id,
        "run": run.id,
        "counter": None,
        "serial": manifest.serial,
        "attempt": manifest.attempt,
        "recipe_sha256": recipe_sha256,
        "bench_sha256": bench_sha256,
        "created": manifest.started,
        "key": None,
    }
    return {tables.ATTEMPTS: [attempt], **file_rows(run, chain, recipe_sha256, bench_sha256)}


def _begun_rows(run: RunRecord, chain: Chain, created: Entry) -> Rows:
    row = {name: created.fields[name] for name in ("run", "serial", "attempt")}
    row |= {"chain": chain.id, "counter": created.counter, "created": created.fields["time"], "key": created.key}
    hashes = {f"{part}_sha256": created.fields[part] for part in ("recipe", "bench")}
    return {tables.ATTEMPTS: [row | hashes], **file_rows(run, chain, **hashes)}


def _run_row(  # noqa: PLR0917 - a run as the chain, its manifest and its result have it
    chain: str,
    run: RunRecord,
    manifest: Manifest,
    result: Result | None,
    sealed: Entry | None,
    altered: tuple[str, ...],
) -> Row:
    stages = () if result is None else result.stages
    torque = next((stage for stage in stages if stage.stage == OUTPUT_TORQUE), None)
    names = ("state", "verdict", "serial", "attempt")
    said = {name: getattr(manifest, name) if sealed is None else sealed.fields[name] for name in names}
    master, objected = manifest.unit.master or "", "" if result is None else objection(result)
    return {
        "chain": chain,
        "run": run.id,
        "counter": None if sealed is None else sealed.counter,
        "entry_sha256": None if sealed is None else sealed.sha256,
        "key": None if sealed is None else sealed.key,
        "sha256": None if sealed is None else sealed.fields["sha256"],
        "state": str(said["state"]),
        "verdict": said["verdict"],
        "serial": said["serial"],
        "attempt": said["attempt"],
        "model": manifest.unit.model,
        "recipe": manifest.recipe.name,
        "revision": manifest.recipe.revision,
        "bench": "" if result is None or result.bench is None else result.bench.name,
        "started": manifest.started,
        "ended": manifest.ended,
        "operator": manifest.operator,
        "scenario": manifest.scenario,
        "clock": manifest.clock,
        "virtual": bool(manifest_badges(manifest) if result is None else virtual_badges(result)),
        "master": master,
        "torque_source": "" if torque is None else CONVERTED if torque.applied else MEASURED,
        "objection": objected,
        "records": manifest.records,
        "altered": "\n".join(altered),
        "seen": seen(f"{run.folder}/{MANIFEST}"),
        "seen_files": seen_files(run),
        "in_production": not (master or manifest.scenario or altered or manifest.study),
        "valid": said["state"] == COMPLETE and not (objected or altered),
        "hour": hour_of(manifest.started),
        "again": False,
        "first": False,
        "fixture": manifest.bench.fixture or "",
        "lock_angle_deg": None if result is None else result.lock_angle_deg,
    }


def _damaged_rows(run: RunRecord, chain: Chain, created: Entry | None, sealed: Entry | None, text: str) -> Rows:
    """Return what the chain alone says of a run that cannot be read."""
    found: Rows = {} if created is None else _begun_rows(run, chain, created)
    if sealed is not None:
        row = dict.fromkeys(column.name for column in tables.RUNS.columns)
        row |= {name: sealed.fields[name] for name in ("run", "serial", "attempt", "state", "verdict", "sha256")}
        row |= {"chain": chain.id, "counter": sealed.counter, "entry_sha256": sealed.sha256, "key": sealed.key}
        row |= dict.fromkeys(("model", "recipe", "bench", "fixture", "master", "torque_source", "objection"), "")
        row |= {
            "virtual": False,
            "in_production": False,
            "valid": False,
            "hour": "",
            "again": False,
            "first": False,
            "altered": text,
            "seen": seen(f"{run.folder}/{MANIFEST}"),
        }
        found[tables.RUNS] = [row | {"seen_files": seen_files(run)}]
    return found


def _refused_rows(run: RunRecord, chain: Chain, cause: str) -> Rows:
    """Return what the chain alone says of a run that has a value which the database cannot hold."""
    created, sealed = _entries_of(run, chain)
    text = f"{MANIFEST}: has a value that the store cannot hold: {cause[:LONGEST_CAUSE]}. {NEXT_STEP}"
    return _damaged_rows(run, chain, created, sealed, text)


def _result_rows(chain: str, run: RunRecord, result: Result) -> Rows:
    own = {"chain": chain, "run": run.id}
    found: Rows = {
        tables.MEANINGS: [
            {"chain": chain, "meaning": number_of(one), **one._asdict()} for one in map(meaning_of, result.metrics)
        ],
        tables.METRICS: [
            own | {"position": position} | row
            for position, metric in enumerate(result.metrics)
            for row in _metric_rows(metric)
        ],
        tables.CHECKS: [own | asdict(check) for check in result.gates],
        tables.ALARMS: [
            own
            | {"position": position, "first": alarm.first}
            | {name: getattr(alarm, name) for name in ("id", "scan", "t_s", "state", "reaction", "text")}
            for position, alarm in enumerate(result.alarms)
        ],
    }
    if run.has(CALIBRATION):
        ratio = run.read(RatioRecord, CALIBRATION)
        head = own | {"id": ratio.id, "model": ratio.model, "made": ratio.made}
        figures = ("slope", "offset_nm", "u_slope", "u_offset_nm", "residual_sd_nm", "points")
        found[tables.CALIBRATIONS] = [
            head | {"quadrant": quadrant} | {name: getattr(line, name) for name in figures}
            for quadrant, line in ratio.quadrants.items()
        ]
    return found


def meaning_of(metric: MetricValue) -> Meaning:
    """Return what a metric of a result means."""
    return Meaning(
        metric=metric.id,
        choices=" ".join(metric.choices),
        branch=metric.branch,
        definition=metric.definition,
        estimator=metric.estimator,
        band=json.dumps(metric.band),
        torque_nm=json.dumps(metric.torque_nm),
        unit=metric.unit,
    )


def _metric_rows(metric: MetricValue) -> list[Row]:
    """Return a row for each side of a metric with that side's own verdict, the one that it goes by among them."""
    shared: Row = {
        "meaning": number_of(meaning_of(metric)),
        "cycles": metric.cycles,
        "limit_min": metric.limits.min,
        "limit_max": metric.limits.max,
        "coverage_factor": metric.coverage_factor,
    }
    sides: list[tuple[str, MetricValue | SideValue]] = [(metric.side, metric)]
    sides += [(side, found) for side, found in metric.sides.items() if side != metric.side]
    return [
        shared
        | {"side": side, "main": found is metric, "value": found.value, "uncertainty": found.uncertainty}
        | {"verdict": _own_verdict(metric) if found is metric else found.verdict}
        for side, found in sides
    ]


def _own_verdict(metric: MetricValue) -> str | None:
    """Return the verdict of the side that a metric goes by, as its record has it.

    It is the metric's own where the sides do not say it: the worst of the rows is the verdict of the metric, always.
    """
    own = metric.sides.get(metric.side)
    said = {side.verdict for side in metric.sides.values()}
    worst = next((verdict for verdict in (FAIL, UNDECIDED) if verdict in said), None)
    if own is None or worst is None or worst != metric.verdict:
        return metric.verdict
    return own.verdict or metric.verdict
