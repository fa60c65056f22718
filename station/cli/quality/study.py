"""What `lostmotion quality study` does and prints: begin, next, measure, status, evaluate."""

from __future__ import annotations

import getpass
import sys
from dataclasses import dataclass
from pathlib import Path

from analysis.line.gage_study import AverageRange, GageStudy
from station.bench.request import load_job
from station.cli.line.gage import gage_blocks
from station.cli.quality.quality import NOT_SO, type_one_blocks
from station.cli.say import Grid, say
from station.documents.study import CALLED, StudyPlan
from station.errors import StationError
from station.quality.bench_ability import TypeOneFigure
from station.quality.guided.evaluate import Figure, evaluate, refuse_incomplete
from station.quality.guided.plan import MOST_STEPS, Asked, begin
from station.quality.guided.progress import DoesNotCount, Standing, look, settle
from station.records.studies import study_names
from station.store.quality.lot import production

MOST_ROWS = 12


@dataclass(frozen=True)
class How:
    """How the next step is to be measured: scanned serial number, who does it, and the clock of the virtual bench."""

    serial: str | None
    operator: str | None
    virtual_time: bool
    fast: bool
    seed: int | None


@dataclass(frozen=True, kw_only=True)
class StudyStatus:
    """What the commands on a study print as JSON. Steps count from 1; `next_*` is null when all are measured."""

    study: str
    person: str
    begun: str
    plan: StudyPlan
    measured: dict[str, str]
    missing: tuple[int, ...]
    next_step: int | None
    next_part: str | None
    next_operator: str | None
    does_not_count: tuple[DoesNotCount, ...]
    beside: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class PrintedGageStudy:
    """What `evaluate --json` prints of a metric of a gage study; others: the better sides and their gage share in %."""

    metric: str
    side: str
    unit: str
    parts: tuple[str, ...]
    operators: tuple[str, ...]
    trials: int
    tolerance: float | None
    anova: GageStudy
    average_range: AverageRange
    others: tuple[tuple[str, float], ...]


@dataclass(frozen=True, kw_only=True)
class PrintedEvaluation:
    """What `evaluate --json` prints: the runs by their step, and a figure for each metric."""

    study: str
    plan_sha256: str
    runs: dict[str, str]
    figures: tuple[TypeOneFigure | PrintedGageStudy, ...]


def _printed(one: Figure) -> TypeOneFigure | PrintedGageStudy:
    if isinstance(one, TypeOneFigure):
        return one
    return PrintedGageStudy(
        metric=one.metric,
        side=one.side,
        unit=one.unit,
        parts=one.design.parts,
        operators=one.design.operators,
        trials=one.design.values.shape[2],
        tolerance=one.tolerance,
        anova=one.anova,
        average_range=one.average_range,
        others=tuple((name, other.grr_pct.value) for name, other in one.others),
    )


def _document(found: Standing) -> StudyStatus:
    step, cell = found.next or (None, None)
    return StudyStatus(
        study=found.study.name,
        person=found.study.person,
        begun=found.study.begun,
        plan=found.plan,
        measured={str(one): run for one, run in sorted(found.measured.items())},
        missing=found.open,
        next_step=step,
        next_part=None if cell is None else cell.part,
        next_operator=None if cell is None else cell.operator or None,
        does_not_count=found.does_not_count,
        beside=found.beside,
    )


def begin_and_tell(data: Path, name: str, asked: Asked, person: str | None, *, as_json: bool) -> int:
    """Begin a study and print its first step; return 0. Raises as `begin`."""
    begin(data, name, asked, person or getpass.getuser())
    found = look(data, name)
    return say(_document(found), [_title(found), *_next(found, data)], as_json=as_json)


def tell_next(data: Path, name: str, person: str | None, *, as_json: bool) -> int:
    """Print what comes next; return 0. Raises as `settle`."""
    found = settle(data, name, person or getpass.getuser())
    return say(_document(found), [*_next(found, data), *_not_counting(found)], as_json=as_json)


def tell_status(data: Path, name: str | None, *, as_json: bool) -> int:
    """Print how a study stands, or all studies; return 0, or 1 where steps are missing. Raises as `look`."""
    if name is None:
        all_found = [look(data, one) for one in study_names(data)]
        rows = [
            (one.study.name, CALLED[one.plan.kind], ", ".join(m.id for m in one.plan.metrics),
             f"{len(one.measured)} of {len(one.plan.order)}", one.study.person, one.study.begun[:16].replace("T", " "))
            for one in all_found
        ]  # fmt: skip
        heads = ("study", "kind", "metrics", "measured", "begun by", "begun (UTC)")
        blocks: list[str | Grid] = [Grid(heads, rows, right=(3,))] if rows else [f"{data}: holds no study"]
        return say([_document(one) for one in all_found], blocks, as_json=as_json)
    found = look(data, name)
    missing = found.missing()
    blocks = [_title(found), _cells(found), *[f"missing: {one}" for one in missing[:MOST_ROWS]]]
    blocks += [f"and of {len(missing) - MOST_ROWS} more"] if len(missing) > MOST_ROWS else []
    say(_document(found), [*blocks, *_not_counting(found), *_next(found, data)], as_json=as_json)
    return NOT_SO if found.open else 0


def evaluate_and_tell(data: Path, name: str, person: str | None, level: float, *, as_json: bool) -> int:
    """Evaluate a study and print its figures; return 0, or 1 for a gage that is not capable.

    Raises:
        StationError: steps are missing. AnalysisError: the values allow no study.

    """
    refuse_incomplete(settle(data, name, person or getpass.getuser()))
    found = look(data, name, samples=True)
    with production(data) as view:
        figures = evaluate(view, found, level)
    blocks: list[str | Grid] = [_title(found)]
    for one in figures:
        blocks += _blocks(one, found, level)
    document = PrintedEvaluation(
        study=name,
        plan_sha256=found.study.plan_sha256,
        runs={str(step): run for step, run in sorted(found.measured.items())},
        figures=tuple(_printed(one) for one in figures),
    )
    say(document, blocks, as_json=as_json)
    return NOT_SO if any(isinstance(one, TypeOneFigure) and not one.study.capable for one in figures) else 0


def _blocks(one: Figure, found: Standing, level: float) -> list[str | Grid]:
    if isinstance(one, TypeOneFigure):
        return type_one_blocks(one, float(found.plan.share), level)
    side = "" if one.side == "both" else f" side {one.side}"
    blocks = [f"{one.metric}{side}", *gage_blocks(one.design, one.anova, one.average_range, one.unit, level)]
    blocks += [f"The worse side. Side {name} has {other.shares}" for name, other in one.others]
    return blocks + (["VIRTUAL: units of the virtual bench"] if found.plan.virtual else [])


def measure(data: Path, name: str, how: How, *, every: bool) -> int:
    """Measure the next step, or every step that is left on the virtual bench; return an exit code.

    Raises:
        StationError, RecipeError: it is another unit's or operator's turn, or recipe or bench have changed.

    """
    found = look(data, name)
    if not found.plan.virtual and (how.serial is None or every):
        raise StationError(
            f"study {name}: bench {found.plan.bench} is a real one, so every step needs its unit put on. Scan the "
            "label of the unit on the bench: --serial SN, and leave out --all"
        )
    code = _measure_one(data, found, how)
    while every and code is not None:
        before, found = found, settle(data, name, how.operator or getpass.getuser())
        if not found.open:
            return 0
        if len(found.measured) == len(before.measured):
            return code or NOT_SO
        code = _measure_one(data, found, how)
    found = settle(data, name, how.operator or getpass.getuser())
    for line in (*_not_counting(found)[-1:], *_next(found, data)):
        sys.stdout.write(f"{line}\n")
    return code


def _measure_one(data: Path, found: Standing, how: How) -> int:
    from station.cli.measure.run import Options, run  # noqa: PLC0415 - brings a whole run

    plan, step = found.plan, found.next
    if step is None:
        raise StationError(
            f"study {found.study.name}: every step is measured. 'lostmotion quality study evaluate "
            f"{found.study.name}' evaluates it"
        )
    number, cell = step
    load_job(plan.recipe_file, plan.bench_file)  # says at once what is wrong with files that have changed since
    before = sum(one.step == number for one in found.does_not_count)  # the same noise would fail the same way
    operator = how.operator or (cell.operator or None if plan.virtual else None)
    return run(
        Options(
            recipe=plan.recipe_file,
            serial=how.serial or cell.part,
            bench=plan.bench_file,
            data=data,
            unit=plan.units.get(cell.part),
            scenario=None,
            virtual_time=how.virtual_time,
            json=False,
            operator=operator,
            seed=None if how.seed is None else how.seed + number + MOST_STEPS * before,
            report=False,
            fast=how.fast,
            study=found.study.name,
        )
    )


def _title(found: Standing) -> str:
    study, plan = found.study, found.plan
    operators = f" × {len(plan.operators)} operators" if plan.operators else ""
    design = f"{len(plan.parts)} units{operators} × {plan.trials} trials" if len(plan.parts) > 1 else (
        f"unit {plan.parts[0]}, {plan.trials} measurements"
    )  # fmt: skip
    return (
        f"study {study.name}: {CALLED[plan.kind]} study of {', '.join(one.id for one in plan.metrics)}, {design}, "
        f"recipe {plan.recipe} revision {plan.revision} on bench {plan.bench}, order by seed {plan.seed}; "
        f"begun by {study.person}"
    )


def _next(found: Standing, data: Path) -> list[str]:
    """Return what is to be done now, and the command for it."""
    name, steps = found.study.name, len(found.plan.order)
    where = "" if str(data) == "runs" else f" --data {data}"
    if found.next is None:
        return [f"all {steps} steps are measured", f"  lostmotion quality study evaluate {name}{where}"]
    step, cell = found.next
    if found.running:
        return [f"run {found.running} is in progress. Wait for its end"]
    operator = f" --operator {cell.operator!r}" if cell.operator else ""
    by = f", by {cell.operator}" if cell.operator else ""
    return [
        f"step {step} of {steps}: put unit {cell.part} on the bench{by} (trial {cell.trial} of {found.plan.trials})",
        f"  lostmotion quality study measure {name} --serial {cell.part}{operator}{where}",
    ]


def _not_counting(found: Standing) -> list[str]:
    rows = [f"does not count: step {one.step}, run {one.run}: {one.why}" for one in found.does_not_count]
    beside = len(found.beside)
    rows += [f"beside the study: {beside} runs of its units were not started for it, {found.beside[-1]} for one"] if (
        beside) else []  # fmt: skip
    return rows


def _cells(found: Standing) -> Grid:
    """Return units by operators, with how many trials are measured."""
    plan = found.plan
    counts: dict[tuple[str, str], int] = {}
    for step in found.measured:
        cell = plan.order[step - 1]
        counts[cell.part, cell.operator] = counts.get((cell.part, cell.operator), 0) + 1
    names = plan.operators or ("",)
    rows = [(part, *(f"{counts.get((part, one), 0)} of {plan.trials}" for one in names)) for part in plan.parts]
    heads = ("unit", *(one or "measured" for one in names))
    return Grid(heads, rows, right=tuple(range(1, len(heads))))
