"""Performance qualification: what is due on the bench, its studies, and the capability of the process."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from analysis.trace.errors import AnalysisError
from station.bench.files import load_named_bench
from station.documents.validation import OPEN, PERFORMANCE, STATED, Evidence, judged
from station.errors import StationError
from station.quality.bench_ability import Part, due_on, type_one_of
from station.quality.figures import capability_of, said_beside, yield_of
from station.records.data_folder import Store
from station.store.quality.lot import Lot, production
from station.wall_clock import WALL_CLOCK

LEAST_CG = 1.33
"""ISO 22514-7, VDA 5."""

LEAST_CPK = 1.33
"""Of the process, ISO 22514-2; customers may ask for more."""

MOST_GRR_PCT = 30.0
LEAST_NDC = 5
"""AIAG, Measurement Systems Analysis: below 10 % good, up to 30 % for some uses; five categories or more."""

SHARE_PCT = 20.0


@dataclass(frozen=True, slots=True)
class KnownPart:
    """A part of known value, for a type 1 study."""

    serial: str
    metric: str
    reference: float


@dataclass(frozen=True, slots=True)
class GageFigure:
    """A gage study as it came out: gage spread as % of the total spread and of the tolerance, and categories."""

    metric: str
    grr_pct: float
    tolerance_pct: float | None
    ndc: int
    design: str


def known_part(text: str) -> KnownPart:
    """Return the part that a text names, SERIAL:METRIC:VALUE; StationError where it does not."""
    words = text.rsplit(":", 2)
    try:
        serial, metric, value = words
        part = KnownPart(serial, metric, float(value))
    except ValueError:
        part = None
    if part is None or not part.serial or not part.metric or not math.isfinite(part.reference):
        raise StationError(
            f"--type1: found {text[:60]!r}; expected SERIAL:METRIC:VALUE, as in MASTER-1:lost_motion:0.52"
        )
    return part


def _of(asked: str, found: str, state: str, again: str) -> Evidence:
    return Evidence(part=PERFORMANCE, asked=asked, found=found, state=state, again=again)


def performance(  # noqa: PLR0917 - what is asked for
    data: Path,
    bench: str | None,
    lot: Lot,
    parts: Iterable[KnownPart],
    gages: Iterable[GageFigure | str],
    by: str = "operator",
) -> Iterator[Evidence]:
    """Yield the evidence; gages: studies that were made, or why one could not be, with `by` as the operator.

    Raises:
        RecipeError: the bench file cannot be read. StoreError: the store cannot be used.

    """
    yield from _due(data, bench)
    yield from _type_one(data, lot, tuple(parts))
    yield from _gages(data, lot, tuple(gages), by)
    yield from _process(data, lot)


def again_of(command: str, data: Path, lot: Lot) -> str:
    """Return the command that shows a figure of a lot again, with all that chooses it."""
    options = {"--recipe": lot.recipe, "--model": lot.model, "--bench": lot.bench}
    options |= {"--since": lot.since, "--until": lot.until}
    given = [f"{name} {shlex.quote(value)}" for name, value in options.items() if value is not None]
    return " ".join([command, "--data", shlex.quote(str(data)), *given, *(["--virtual"] if lot.virtual else [])])


def _marked(told: str, lot: Lot) -> str:
    """Return what was found, marked where it is of units of the virtual bench."""
    return f"VIRTUAL units: {told}" if lot.virtual else told


def _due(data: Path, bench: str | None) -> Iterator[Evidence]:
    asked = "Master parts, calibrations and the blank test of the fixture are in date, and master parts read rightly"
    found = () if bench is None else due_on(Store(data), load_named_bench(bench), WALL_CLOCK.now())
    if not found:
        yield _of(asked, "no bench was named" if bench is None else "the bench file names none", OPEN, "--bench FILE")
    for one in found:
        yield _of(
            f"In date on {one.bench}: {one.what}", one.text, judged(one.in_order), f"lostmotion run --bench {bench}"
        )


def _type_one(data: Path, lot: Lot, parts: tuple[KnownPart, ...]) -> Iterator[Evidence]:
    if not parts:
        yield _of("Type 1 study: Cg and Cgk", "no part of known value was named", OPEN, "--type1 SERIAL:METRIC:VALUE")
    for one in parts:
        asked = f"Type 1 study of {one.metric} on {one.serial}: Cg and Cgk at least {LEAST_CG}"
        named = f"--serial {shlex.quote(one.serial)} --metric {shlex.quote(one.metric)} --reference {one.reference:g}"
        again = again_of(f"lostmotion quality type1 {named}", data, Lot(bench=lot.bench, virtual=lot.virtual))
        if lot.since is not None or lot.until is not None:  # the command of the study itself knows no time
            place = shlex.quote(f"{one.serial}:{one.metric}:{one.reference:g}")
            again = again_of(f"lostmotion quality validation --out DIR --type1 {place}", data, lot)
        try:
            with production(data) as look:
                of_time = lot._replace(recipe=None, model=None)
                runs = tuple(look.measured(of_time, one.serial)) if lot.since or lot.until else None
                part = Part(one.serial, one.metric, bench=lot.bench, virtual=lot.virtual, runs=runs)
                study = type_one_of(look, part, one.reference, None, SHARE_PCT).study
        except (StationError, AnalysisError) as error:
            yield _of(asked, str(error), OPEN, again)
            continue
        told = f"Cg {study.cg:.2f} ({study.cg_low:.2f} … {study.cg_high:.2f})"
        told += f", Cgk {study.cgk:.2f} from {study.cgk_low:.2f}"
        told += f", {study.measurements} measurements, bias {study.bias:.3g}, tolerance {study.tolerance:g}"
        yield _of(asked, _marked(told, lot), judged(min(study.cg, study.cgk) >= LEAST_CG), again)


def _gages(data: Path, lot: Lot, gages: tuple[GageFigure | str, ...], by: str) -> Iterator[Evidence]:
    asked = f"Gage study: gage spread at most {MOST_GRR_PCT:g} % (good: 10 %), {LEAST_NDC} categories or more"
    if not gages:
        yield _of(asked, "no metric was named", OPEN, "--gage METRIC")
    for one in gages:
        metric = one.partition(":")[0] if isinstance(one, str) else one.metric
        study = f"lostmotion quality validation --out DIR --gage {shlex.quote(metric)} --by {by}"
        again = again_of(study, data, lot)
        if isinstance(one, str):
            yield _of(asked, one, OPEN, again)
            continue
        of_tolerance = "no tolerance" if one.tolerance_pct is None else f"{one.tolerance_pct:.3g} % of the tolerance"
        share = one.grr_pct if one.tolerance_pct is None else max(one.grr_pct, one.tolerance_pct)
        told = f"{one.metric}: {one.grr_pct:.3g} % of the total spread, {of_tolerance}, ndc {one.ndc}; {one.design}"
        met = share <= MOST_GRR_PCT and one.ndc >= LEAST_NDC
        yield _of(asked, _marked(told, lot), judged(met), again)


def _process(data: Path, lot: Lot) -> Iterator[Evidence]:
    asked = f"Process capability: Cpk at least {LEAST_CPK} for each metric with a limit"
    again = again_of("lostmotion quality capability", data, lot)
    try:
        with production(data) as look:
            lot = look.one_recipe(lot)
            again = again_of("lostmotion quality capability", data, lot)
            yields, rows = yield_of(look, lot).whole, capability_of(look, lot).rows
    except (StationError, AnalysisError) as error:
        yield _of(asked, str(error), OPEN, again)
        return
    first, final = yields.first_pass, yields.final
    told = f"{first.of} units: first-pass {first.number}, final {final.number} of {final.of} passed"
    told += f"; first-pass with 95 % confidence {100 * first.low:.3g} … {100 * first.high:.3g} %"
    shown = again_of("lostmotion quality yield", data, lot)
    yield _of("Yield of the lot, of which nothing is required", _marked(told, lot), STATED, shown)
    for row in rows:
        name = f"{row.metric.name} side {row.side}"
        if row.found is None:
            yield _of(asked, f"{name}: {row.why}", OPEN, again)
            continue
        found = row.found
        told = f"{name}: Cpk {found.within.nearest:.2f} ({found.cpk_low:.2f} … {found.cpk_high:.2f})"
        told = "; ".join([f"{told}, {found.values} values", *said_beside(row, "")])
        met = found.within.nearest >= LEAST_CPK
        yield _of(asked, _marked(told, lot), OPEN if met and row.without else judged(met), again)
