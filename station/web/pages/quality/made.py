"""What the page of quality shows, made of the store in the evaluating process: nothing here knows a page."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from recipes import RecipeError, default_bench, find_recipe, parse_recipe
from recipes.schema.bench_schema import Bench
from station.bench.files import load_named_bench
from station.bench.request import Source
from station.errors import StationError
from station.quality.bench_ability import (
    Due,
    Part,
    PartFigure,
    TypeOneFigure,
    due_on,
    part_trend,
    parts_of,
    type_one_of,
)
from station.quality.figures import (
    CapabilityFigure,
    CausesFigure,
    ChartFigure,
    TrendFigure,
    YieldFigure,
    capability_of,
    causes_of,
    chart_of,
    trend_of,
    yield_of,
)
from station.quality.limits_trial import Trial, Tried, draft_text, limits_trial, recipe_of
from station.quality.recipe_change import other_definitions
from station.quality.text_on_trial import TextTrial, text_trial
from station.records.data_folder import Store
from station.records.master_parts import ProductRecipe, product_recipe
from station.records.revisions.history import History
from station.store.quality.lot import Lot, production
from station.store.quality.values import characteristic
from station.wall_clock import WALL_CLOCK
from station.web.models import Models
from station.web.permission import recipe_file

CATCH_UP_S = 0.1
"""Longest time for putting runs into the store that have come since, for each figure."""

SHARE = 0.2
MOST_FLIPS = 50


@dataclass(frozen=True)
class Choices:
    """What can be chosen: recipes and models of the folder, master parts with their runs, and what is behind."""

    recipes: tuple[str, ...]
    models: tuple[str, ...]
    real: bool
    parts: tuple[tuple[str, int], ...]
    behind: int


def choices(data: Path) -> Choices:
    """Return what can be chosen in a data folder."""
    with production(data, most_s=CATCH_UP_S) as look:
        recipes, models = look.choices()
        real = True
        try:
            look.refuse_empty(Lot())
        except StationError:
            real = False
        return Choices(
            tuple(one for one in recipes if one), models, real, parts_of(look, virtual=not real), look.behind
        )


def page_disbelieved(data: Path, lot: Lot) -> int:
    """Return how many runs of a lot no figure counts because their records are not believed."""
    with production(data, most_s=CATCH_UP_S) as look:
        return look.disbelieved(lot)


def page_yield(data: Path, lot: Lot, by: str) -> YieldFigure:
    """Return the yield of a lot over time."""
    with production(data, most_s=CATCH_UP_S) as look:
        return yield_of(look, lot, by)


def page_causes(data: Path, lot: Lot) -> CausesFigure:
    """Return what hindered a lot."""
    with production(data, most_s=CATCH_UP_S) as look:
        return causes_of(look, lot)


def page_capability(data: Path, lot: Lot) -> CapabilityFigure:
    """Return the capability of every metric with a limit."""
    with production(data, most_s=CATCH_UP_S) as look:
        return capability_of(look, lot)


def page_chart(data: Path, lot: Lot, metric: str, rules: tuple[str, ...], subgroup: int) -> ChartFigure:
    """Return the control chart of a metric."""
    with production(data, most_s=CATCH_UP_S) as look:
        return chart_of(look, lot, metric, rules, subgroup=subgroup)


def page_trend(data: Path, lot: Lot, metric: str, by: str) -> TrendFigure:
    """Return a metric by groups."""
    with production(data, most_s=CATCH_UP_S) as look:
        return trend_of(look, lot, metric, by)


def page_part(data: Path, part: Part) -> PartFigure:
    """Return a master part over time."""
    with production(data, most_s=CATCH_UP_S) as look:
        return part_trend(look, part)


def page_type_one(data: Path, part: Part, reference: float, tolerance: float | None) -> TypeOneFigure:
    """Return the type 1 study of a part."""
    with production(data, most_s=CATCH_UP_S) as look:
        return type_one_of(look, part, reference, tolerance, SHARE)


def page_due(data: Path, models: Models) -> tuple[Due, ...]:
    """Return what is due on each bench of the table of models."""
    benches: dict[str, tuple[Bench, list[ProductRecipe]]] = {}
    found: list[Due] = []
    history = History(data)
    for one in models.models:
        try:
            source = Source.read(find_recipe(recipe_file(history, one.recipe)))
            recipe = source.recipe()
            bench = load_named_bench(one.bench) if one.bench else default_bench(recipe)[1]
        except (RecipeError, StationError) as error:
            found.append(Due(one.bench or one.model, "bench file", in_order=False, text=str(error).splitlines()[0]))
            continue
        products = benches[bench.bench.name][1] if bench.bench.name in benches else []
        benches[bench.bench.name] = bench, [*products, product_recipe(recipe, source.sha256)]
    for bench, products in benches.values():
        found += due_on(Store(data), bench, WALL_CLOCK.now(), products)
    return tuple(found)


def page_trial(data: Path, lot: Lot, tried: Tried) -> Trial:
    """Return what other limits do to a lot."""
    with production(data, most_s=CATCH_UP_S) as look:
        return limits_trial(look, lot, tried, MOST_FLIPS)


def page_definitions(data: Path, lot: Lot, metric: str) -> tuple[str, ...]:
    """Return other definitions of a metric that can be tried; none where the recipe does not name it once."""
    with production(data, most_s=CATCH_UP_S) as look:
        lot = look.one_recipe(lot)
        recipe, what = recipe_of(look, lot), characteristic(look, lot, metric)
    with suppress(StationError):
        return other_definitions(recipe, what.metric)
    return ()


def page_draft(data: Path, found: Trial) -> str:
    """Return the recipe of the lot with what was tried, as the text of its next revision."""
    return draft_text(data, found).decode()


def page_text_trial(data: Path, content: bytes) -> TextTrial:
    """Return what the limits of a recipe's text do to the runs of its recipe."""
    with production(data, most_s=CATCH_UP_S) as look:
        return text_trial(look, parse_recipe(content, "the text"))
