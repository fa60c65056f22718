"""What has changed on a bench since it last worked: its last good run against the newest, from their records."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from sqlalchemy import func, select

from recipes import RecipeError
from station.bench.request import stored_job
from station.documents.manifest import RECORDING, Manifest
from station.documents.result import Result
from station.errors import StationError
from station.records.chain.chain_file import Chain
from station.records.data_folder import Store
from station.records.run_record import RESULT, RunRecord
from station.records.samples.samples import channel_values
from station.reports.headline import manifest_badges
from station.store.outbox import catch_up
from station.store.plant.hours import hour_of
from station.store.run_search import CATCH_UP_S
from station.store.tables import RUN_HOURS, RUNS
from station.store.view import opened

HASH_DIGITS = 8

IN_PROGRESS = "The newest run is in progress: it is compared when it has ended."
"""What a run lacks that has not ended, as its timing, has not changed."""

TARE_MOVED = 0.02
"""Share of the sensor's usual reading by which a zero may differ: of the larger of both zeroes, or `TARE_LEAST_NM`."""

TARE_LEAST_NM = 0.05
WARMER_K = 5.0
TIMES_LATER = 2.0
"""Factor by which a wake-up latency has to grow before it is worth a word."""


class Change(NamedTuple):
    """One thing that was looked at: before, now, and whether it is another."""

    what: str
    before: str
    now: str
    changed: bool


@dataclass(frozen=True)
class Since:
    """What was compared: the last run that passed and the newest one; why there is nothing to compare, otherwise."""

    good: str = ""
    newest: str = ""
    changes: tuple[Change, ...] = ()
    why_none: str = ""


@dataclass(frozen=True)
class RunFacts:
    """What of a run may explain why the next one did not work. calibrations: id and day each is due.

    zeroes: of the torque sensors [N·m]; temperatures [°C]; None where the record has none.
    """

    recipe: str
    bench: str
    calibrations: tuple[str, ...]
    software: str
    computer: str
    virtual_unit: str
    closed: int
    torque_in_zero_nm: float | None
    torque_out_zero_nm: float | None
    housing_c: float | None
    room_c: float | None
    p99_us: float | None
    missed: int | None
    oldest_sample_scans: int | None


def since_it_worked(data: Path) -> Since:
    """Compare the newest run of a data folder with the last one of the same bench that passed.

    Raises:
        StationError: a record or the store cannot be read.

    """
    newest = next(reversed(Store(data).newest(1)), None)
    if newest is None:
        return Since(why_none="No run was made yet.")
    manifest = newest.manifest()
    if newest.state() == RECORDING:
        return Since(why_none=IN_PROGRESS)
    virtual = bool(manifest_badges(manifest))  # runs that simulated a real bench are compared with such ones
    good, closed, closed_in_all = _last_good(
        data, manifest.bench.name, newest.id, hour_of(manifest.started), virtual=virtual
    )
    if good is None:
        return Since(why_none=f"No run has passed on bench {manifest.bench.name} before.")
    before = facts_of(good, closed)
    return Since(good.id, newest.id, changes_between(before, facts_of(newest, closed_in_all)))


def _last_good(data: Path, bench: str, newest: str, hour: str, *, virtual: bool) -> tuple[RunRecord | None, int, int]:
    """Return the last run that passed on a bench before the newest, and how often the lock was closed up to each.

    hour: in which the newest run began. virtual: whether runs on virtual units are meant, or on real ones.
    """
    chain = Chain(data)
    database = opened(data)
    try:
        catch_up(database, chain, most_s=CATCH_UP_S)
        with database.reading() as connection:
            here = (RUNS.c.chain == chain.id) & (RUNS.c.bench == bench) & RUNS.c.virtual.is_(virtual)
            passed = here & (RUNS.c.verdict == "PASS") & (RUNS.c.altered == "") & RUNS.c.scenario.is_(None)
            last = select(RUNS.c.run, RUNS.c.hour).where(passed & (RUNS.c.run < newest))
            good = connection.execute(last.order_by(RUNS.c.run.desc()).limit(1)).first()

            def up_to(one: str, its_hour: str) -> int:
                # Whole hours are counted already, and only of its own hour the runs are read.
                hours = (RUN_HOURS.c.chain == chain.id) & (RUN_HOURS.c.bench == bench)
                hours &= RUN_HOURS.c.virtual.is_(virtual) & (RUN_HOURS.c.hour < its_hour)
                earlier = select(func.coalesce(func.sum(RUN_HOURS.c.runs), 0)).where(hours)
                beside = select(func.count()).select_from(RUNS)
                beside = beside.where(here, RUNS.c.hour == its_hour, RUNS.c.run <= one)
                return int(connection.execute(earlier).scalar_one()) + int(connection.execute(beside).scalar_one())

            counts = (0, 0) if good is None else (up_to(good.run, good.hour), up_to(newest, hour))
    finally:
        database.close()
    found = None if good is None else Store(data).by_id(good.run)
    return found, *counts


def facts_of(run: RunRecord, closed: int) -> RunFacts:
    """Return what a record says of the circumstances of its run; closed: runs on the bench up to it."""
    manifest = run.manifest()
    timing = run.read(Result, RESULT).timing if run.has(RESULT) else None
    return RunFacts(
        recipe=f"{manifest.recipe.name} r{manifest.recipe.revision} ({manifest.recipe.sha256[:HASH_DIGITS]})",
        bench=f"{manifest.bench.name} r{manifest.bench.revision} ({manifest.bench.sha256[:HASH_DIGITS]})",
        calibrations=_calibrations(run),
        software=_software(manifest),
        computer=manifest.software.host or "",
        virtual_unit=manifest.unit.virtual or "",
        closed=closed,
        torque_in_zero_nm=_last(run, "orders", "torque_in_tare_nm"),
        torque_out_zero_nm=_last(run, "orders", "torque_out_tare_nm"),
        housing_c=_last(run, "image", "housing_temp_c"),
        room_c=_last(run, "image", "ambient_temp_c"),
        p99_us=None if timing is None else float(timing.lateness_us.p99),
        missed=None if timing is None else timing.missed,
        oldest_sample_scans=None if timing is None else timing.oldest_sample_scans,
    )


def _software(manifest: Manifest) -> str:
    one = manifest.software
    return f"{one.version}{f' ({one.files_sha256[:HASH_DIGITS]})' if one.files_sha256 else ''}"


def _calibrations(run: RunRecord) -> tuple[str, ...]:
    """Return the calibrations in the bench file of a run, each with the day that it is due."""
    try:
        bench = stored_job(run).bench
    except (StationError, RecipeError):  # of another version: its hash says whether it is another
        return ()
    curve = bench.fixture.curve
    found = [f"{one.id}, due {one.due}" for one in bench.calibrations]
    return tuple(found + ([f"{curve.id}, due {curve.due}"] if curve else []))


def _last(run: RunRecord, group: str, name: str) -> float | None:
    try:
        (values,) = channel_values(run, [(group, name)])
    except StationError:
        return None
    value = float(values[-1]) if values.size else math.nan
    return value if math.isfinite(value) else None


def changes_between(before: RunFacts, now: RunFacts) -> tuple[Change, ...]:
    """Return what was looked at, what has changed first; a run without a result has no timing that could have."""
    timing = () if now.p99_us is None else (
        _number("wake-up latency, 99 %", before.p99_us, now.p99_us, "µs", lambda old, new: new > TIMES_LATER * old),
        _number("missed periods", before.missed, now.missed, "", lambda old, new: new > old),
        _number("oldest sample", before.oldest_sample_scans, now.oldest_sample_scans, "scans",
                lambda old, new: new > TIMES_LATER * old),
    )  # fmt: skip
    rows = [
        _text("recipe", before.recipe, now.recipe),
        _text("bench file", before.bench, now.bench),
        _text("calibrations", "; ".join(before.calibrations) or "none", "; ".join(now.calibrations) or "none"),
        _text("software", before.software, now.software),
        _text("computer", before.computer, now.computer),
        _text("virtual unit", before.virtual_unit, now.virtual_unit),
        Change("runs on this bench", str(before.closed), f"{now.closed}, {now.closed - before.closed} since", False),  # noqa: FBT003
        _number("zero of the input torque", before.torque_in_zero_nm, now.torque_in_zero_nm, "N·m", _moved),
        _number("zero of the output torque", before.torque_out_zero_nm, now.torque_out_zero_nm, "N·m", _moved),
        _number("housing temperature", before.housing_c, now.housing_c, "°C", _warmer),
        _number("room temperature", before.room_c, now.room_c, "°C", _warmer),
        *timing,
    ]
    return tuple(sorted((row for row in rows if row.before or row.now), key=lambda row: not row.changed))


def _moved(before: float, now: float) -> bool:
    return abs(now - before) > max(TARE_LEAST_NM, TARE_MOVED * max(abs(before), abs(now)))


def _warmer(before: float, now: float) -> bool:
    return abs(now - before) > WARMER_K


def _text(what: str, before: str, now: str) -> Change:
    return Change(what, before, now, before != now)


def _number(
    what: str, before: float | None, now: float | None, unit: str, differs: Callable[[float, float], bool]
) -> Change:
    def shown(one: float | None) -> str:
        return "not recorded" if one is None else f"{one:.4g} {unit}".rstrip().replace("-", "−")

    changed = (before is None) != (now is None) or (before is not None and now is not None and differs(before, now))
    return Change(what, shown(before), shown(now), changed)
