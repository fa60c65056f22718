"""What on a bench has its day: calibrations, the fixture's blank test and the master parts, with when each is due."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date, datetime
from pathlib import Path
from typing import NamedTuple

from recipes import RecipeError
from recipes.schema.bench_schema import Bench
from station.bench.request import load_job
from station.counted import counted
from station.documents.manifest import MASTER
from station.errors import StationError
from station.records.data_folder import Store
from station.records.master_parts import master_parts
from station.records.revisions.history import History
from station.web.models import Models
from station.web.permission import recipe_file

SOON_DAYS = 14


class Due(NamedTuple):
    """Something with its day: on which bench, what it is, how it stands in words; overdue, or due soon."""

    bench: str
    what: str
    text: str
    overdue: bool = False
    soon: bool = False


def due_on(data: Path, models: Models, now: datetime) -> tuple[Due, ...]:
    """Return what is due on every bench of the table of models, the overdue first; a bench that cannot be read says so.

    now: a moment with its time zone.
    """
    rows: list[Due] = []
    seen: set[str | tuple[str, str]] = set()
    history = History(data)
    for model in models.models:
        try:
            job = load_job(recipe_file(history, model.recipe), model.bench)
        except (RecipeError, StationError) as error:
            rows.append(Due(model.bench or model.recipe, f"model {model.model}", str(error), overdue=True))
            continue
        bench, recipe = job.bench_source.sha256, job.recipe_source.sha256
        rows += _of_bench(job.bench, now.date()) if bench not in seen else ()
        for part in master_parts(Store(data), job.bench, now, job.product) if (bench, recipe) not in seen else ():
            text = part.text.removeprefix(f"{MASTER}{part.serial} ")
            rows.append(Due(job.bench.bench.name, f"{MASTER}{part.serial}", text, overdue=not part.in_order))
        seen |= {bench, (bench, recipe)}
    # A part may speak for the recipe of one model, and be wanted for another one: each of both once.
    return tuple(sorted(dict.fromkeys(rows), key=lambda row: (not row.overdue, not row.soon)))


def _of_bench(bench: Bench, today: date) -> Iterator[Due]:
    name, curve = bench.bench.name, bench.fixture.curve
    for one in bench.calibrations:
        yield _due(name, f"torque ratio of {one.model} ({one.id})", one.made, one.due, today)
    if curve is not None:
        yield _due(name, f"blank test of the fixture ({curve.id})", curve.made, curve.due, today)


def _due(bench: str, what: str, made: date, due: date, today: date) -> Due:
    left = (due - today).days
    text = f"made {made}, due {due}: {counted(abs(left), 'day')} {'left' if left >= 0 else 'overdue'}"
    return Due(bench, what, text, overdue=left < 0, soon=0 <= left <= SOON_DAYS)
