"""`lostmotion check`: whether a recipe is valid, and what it would do."""

from __future__ import annotations

import json
import sys
import textwrap
from dataclasses import dataclass

from definitions.metrics import METRICS
from definitions.program import Program
from recipes import Recipe
from station.bench.request import Job, load_job
from station.cli.terminal_plot import plot
from station.counted import counted
from station.documents.entries import plain
from station.documents.manifest import RecipeHead
from station.documents.ratio import BenchHead
from station.documents.result import Limits
from station.plain_text import knows_braille
from station.reports.result_text import limits_text
from station.reports.result_view import result_console
from station.run.screen.progress import clock


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadPoint:
    """A point of the load profile."""

    t_s: float
    torque_nm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A step of a run as planned, with the largest torque that it goes to."""

    step: str
    start_s: float
    duration_s: float
    peak_torque_nm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """What a checked recipe would do: torques in N·m, times in s."""

    recipe: RecipeHead
    bench: BenchHead
    model: str
    duration_s: float
    peak_torque_nm: float
    rated_torque_nm: float
    period_ns: int
    segments: int
    load_profile: tuple[LoadPoint, ...]
    steps: tuple[Step, ...]
    metrics: tuple[str, ...]
    warnings: tuple[str, ...]


def summary(job: Job) -> Summary:
    """Return what a checked recipe would do."""
    recipe, program = job.recipe, job.program
    named = recipe.recipe
    profile = (LoadPoint(t_s=round(t_s, 3), torque_nm=torque_nm) for t_s, torque_nm in program.load_profile())
    return Summary(
        recipe=RecipeHead(name=named.name, revision=named.revision, sha256=job.recipe_source.sha256),
        bench=BenchHead(name=job.bench.bench.name, revision=job.bench.bench.revision),
        model=recipe.unit_under_test.model,
        duration_s=round(program.planned_scans * program.period_s, 3),
        peak_torque_nm=program.peak_torque_nm,
        rated_torque_nm=recipe.unit_under_test.rated_torque_nm,
        period_ns=recipe.sampling.period_ns,
        segments=len(program.segments),
        load_profile=tuple(profile),
        steps=tuple(steps(program)),
        metrics=tuple(one.id for _, one in recipe.wanted()),
        warnings=(*job.warnings, *filter(None, [job.no_automatic_run])),
    )


@dataclass
class Planned:
    """A step while its segments are added up, in scans."""

    name: str
    start: int
    scans: int
    peak_nm: float = 0.0


def steps(program: Program) -> list[Step]:
    """Return the steps of a run as planned: name, start and duration [s], torque it goes to [N·m] where it has one."""
    prepared = program.tare.samples + program.lock.settle_scans
    rows = [Planned("home", 0, program.tare.samples), Planned("lock", program.tare.samples, program.lock.settle_scans)]
    start = prepared
    for segment in program.segments:
        name = STEP_OF_ROLE.get(segment.role)
        if name is None:
            name = f"cycle {segment.cycle}" if segment.cycle else rows[-1].name
            name = f"fatigue {name}" if segment.role == "fatigue" else name
        if segment.role == "dwell" or name == rows[-1].name:
            rows[-1].scans += segment.planned_scans
        else:
            rows.append(Planned(name, start, segment.planned_scans))
        if segment.role != "dwell":
            rows[-1].peak_nm = max(rows[-1].peak_nm, segment.peak_nm)
        start += segment.planned_scans
    rows.append(Planned("release", start, program.rest_scans))
    return [
        Step(
            step=row.name,
            start_s=round(row.start * program.period_s, 3),
            duration_s=round(row.scans * program.period_s, 3),
            peak_torque_nm=round(row.peak_nm, 3),
        )
        for row in rows
    ]


STEP_OF_ROLE: dict[str, str] = {
    "proof": "lock",
    "calibrate": "calibrate",
    "virgin": "first rise",
    "approach": "approach",
    "sweep": "torque sweep",
    "unload": "unload",
}
"""Step that a segment belongs to by its role; measured and fatigue cycles are named by their number."""


def metric_lines(recipe: Recipe) -> list[str]:
    """Return one line per metric: id with what tells it from others, and its limits in its unit."""
    lines = []
    for place, one in recipe.wanted():
        torque = f"{one.torque_nm:g} N·m" if one.torque_nm is not None else ""
        band = f"band {100.0 * one.band:g} %" if one.band is not None else ""
        side = f"side {one.side}" if one.side else ""
        name = " ".join(part for part in (one.id, torque, band, one.branch, one.variant, one.fit, side) if part)
        preset = f" (preset {recipe.presets[int(place[1])]})" if place[0] == "presets" else ""
        limits = limits_text(Limits(min=one.min, max=one.max, max_standard_deviation=one.max_standard_deviation))
        unit = "" if METRICS[one.id].unit == "1" else f" {METRICS[one.id].unit}"
        lines.append(f"    {name:<32} {f'{limits}{unit}' if limits else 'reported'}{preset}")
    return lines


def rule_text(recipe: Recipe) -> str:
    """Return the decision rule as one line."""
    decision = recipe.decision
    if decision.rule == "simple":
        return "simple: the measured value is compared with the limit"
    return f"guard band: a value nearer to its limit than w = {decision.guard_factor:g} U is NOT DECIDABLE"


def check(recipe: str, bench: str | None, *, as_json: bool) -> int:
    """Check a recipe and print what it would do; RecipeError with all that is wrong."""
    job = load_job(recipe, bench)
    found = summary(job)
    if as_json:
        sys.stdout.write(json.dumps(plain(found), ensure_ascii=False) + "\n")
        return 0
    unit = job.recipe.unit_under_test
    peak = found.peak_torque_nm
    heads = [
        f"  {found.recipe.name} revision {found.recipe.revision}: {job.recipe.recipe.description}",
        f"  bench        {job.bench.bench.name} revision {job.bench.bench.revision}, load at the {job.recipe.loading}",
        f"  unit         {unit.model}, rated {unit.rated_torque_nm:g} N·m, ratio {unit.ratio:g}",
        f"  peak torque  {peak:g} N·m ({peak / unit.rated_torque_nm:.0%} of rated)",
        f"  duration     {clock(found.duration_s)} min, {counted(found.segments, 'segment')}",
        f"  scan         every {found.period_ns / 1e6:g} ms",
        f"  decision     {rule_text(job.recipe)}",
    ]
    width = result_console().width
    names = max(len(row.step) for row in found.steps)
    lines = [
        f"{job.recipe_source.path}: passed",
        *(part for head in heads for part in _wrapped(head, width, 15)),
        "  metrics",
        *metric_lines(job.recipe),
        "",
        f"    {'step':<{names}} {'start':>8} {'duration':>10} {'peak torque':>13}",
        *(
            f"    {row.step:<{names}} {row.start_s:>6.1f} s {row.duration_s:>8.1f} s {row.peak_torque_nm:>9.1f} N·m"
            for row in found.steps
        ),
        "",
        plot(job.program.load_profile(), ("s", "N·m"), plain=not knows_braille(sys.stdout)),
        *(part for text in job.warnings for part in _wrapped(f"WARNING  {text}", width, 9)),
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def _wrapped(line: str, width: int, indent: int) -> list[str]:
    return textwrap.wrap(line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)
