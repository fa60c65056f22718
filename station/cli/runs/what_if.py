"""What another recipe would have changed in a run, as plain data and in words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from analysis.trace.errors import AnalysisError
from controller.controller import Controller
from controller.held_lock import Left
from recipes import Recipe, check
from station.bench.request import Job, Source, recipe_path
from station.errors import StationError
from station.records.program_file import StoredProgram, plain_program
from station.records.run_record import RESULT, RunRecord
from station.records.samples.table import Table
from station.results.divergence import Beside
from station.results.trace_origin import check_recipe_fits
from station.results.what_if import ShadowWatch, interlock_changes, judge, same_load, tare_changes, verdict_changes
from station.run.conclusion import NOT_DECIDABLE


class Question:
    """Another recipe asked of a run: its interlocks and its controller look on while the run is replayed.

    Args:
        name: the other recipe, a file or the name of a shipped one.
        run: the run.
        job: the run's own recipe and bench.
        left: how the bench was left before the run, for a recovery.

    Raises:
        StationError: the other recipe is for another unit, another loaded shaft, or another period.
        RecipeError: the other recipe cannot be read.

    """

    def __init__(self, name: str, run: RunRecord, job: Job, left: Left | None) -> None:
        path = recipe_path(name)
        source = Source.read(path)
        recipe = source.recipe()
        check_recipe_fits(recipe, path, job.recipe, run)
        _check_period(recipe, path, job.recipe, run)
        self._run = run
        self._own = job
        # Limits below the recorded load are what is asked about: what `run` says of them is told, not a refusal.
        self._other = Job(recipe, job.bench, source, job.bench_source)
        self._shadow = ShadowWatch(job.program, self._other.program)
        self.controller = Controller(job.program, self._shadow, left)
        self.beside = Beside(self.controller, Controller(self._other.program, None, left))

    def answer(self, table: Table) -> dict[str, Any]:
        """Return what the other recipe would have changed, as plain data.

        Args:
            table: all records of the run, which was replayed identically and is not altered.

        """
        run, own, other = self._run, self._own.program, self._other
        manifest, divergence = run.manifest(), self.beside.divergence
        recorded = run.read_json(RESULT) if run.has(RESULT) else {"verdict": None, "reasons": [], "metrics": []}
        verdict, reasons, metrics = recorded["verdict"], [], []
        if run.state() == "complete":
            judged = self._judged(table, recorded)
            verdict, reasons, metrics = judged["verdict"], judged["reasons"], verdict_changes(recorded, judged)
        refused = [str(one) for one in check(other.recipe, other.bench, other.recipe_source.path, run.day())]
        against = [f"a run would refuse the recipe: {one}" for one in refused]
        if divergence is not None:
            # What was recorded from there on is no measurement by the other recipe, whatever it looks like.
            when = divergence.at(int(manifest["period_ns"]))
            against.insert(0, f"the run would have gone another way from {when} on: {divergence.cause}")
        if against:
            verdict, reasons = NOT_DECIDABLE, against
        alike = same_load(own, other.program)
        found: dict[str, Any] = {
            "recipe": {"name": other.recipe.recipe.name, "revision": other.recipe.recipe.revision},
            "refused": refused,
            "same_load": alike,
            "divergence": None if divergence is None else divergence.to_dict(int(manifest["period_ns"])),
            "exact": divergence is None,
            "interlocks": interlock_changes(table, self._shadow, divergence),
            "tares": tare_changes(table, own, other.program),
            "metrics": metrics,
            "verdict": {"recorded": recorded["verdict"], "other": verdict, "reasons": reasons},
        }
        other_way = divergence is not None or refused or not alike or found["interlocks"] or found["tares"]
        return found | {"changed": bool(other_way or metrics or verdict != recorded["verdict"])}

    def _judged(self, table: Table, recorded: dict[str, Any]) -> dict[str, Any]:
        """Return the other recipe's result; what spoke against the run besides its recipe speaks against this too."""
        own = self._result(self._own, table, [])
        objections = [reason for reason in recorded["reasons"] if reason not in own["reasons"]]
        if own["verdict"] != recorded["verdict"] and not objections:
            said = f"the run's own verdict is {recorded['verdict']}, evaluated anew it is {own['verdict']}"
            objections = [f"{said}: the software is not the one that made it"]
        return self._result(self._other, table, objections)

    def _result(self, job: Job, table: Table, objections: list[str]) -> dict[str, Any]:
        run = self._run
        # Which ramps are measured, and which only condition the unit, is the recipe's word: no order tells them apart.
        asked = job is self._other and self.beside.divergence is None
        segments = plain_program(job.program)["segments"] if asked else StoredProgram.of(run).segments
        stored = {"segments": segments, "timing": run.read_json("timing.json"), "id": run.id}
        try:
            found = judge(table, job.recipe, job.bench, stored, objections)
        except (AnalysisError, StationError) as error:
            return {"verdict": NOT_DECIDABLE, "reasons": [str(error)], "metrics": []}
        judged: dict[str, Any] = json.loads(json.dumps(found.to_dict()))
        return judged


def _check_period(recipe: Recipe, path: Path, own: Recipe, run: RunRecord) -> None:
    """Refuse a recipe of another period: images that were taken every 1 ms are none of a run that takes every 2 ms."""
    period_ns, own_ns = recipe.sampling.period_ns, own.sampling.period_ns
    if period_ns != own_ns:
        raise StationError(
            f"{path}: sampling.period: found {period_ns * 1e-6:g} ms; run {run.id} was scanned every "
            f"{own_ns * 1e-6:g} ms. Choose a recipe with period: {own_ns * 1e-6:g} ms"
        )


def what_if_lines(found: dict[str, Any], period_ns: int) -> list[str]:
    """Return what the other recipe would have changed, for a person: what is exact first, then what is not."""
    recipe, divergence, verdict = found["recipe"], found["divergence"], found["verdict"]
    lines = [f"with {recipe['name']} revision {recipe['revision']}:"]
    lines += [f"  a run would refuse it: {one}" for one in found["refused"]]
    if not found["same_load"]:
        text = "it commands another load; what that would have done to the unit is not known"
        same = "its load profile is another one, but orders the same as far as the run went"
        lines.append(f"  {same if divergence is None else text}")
    if divergence is not None:
        when = f"scan {divergence['scan']} ({divergence['t_s']:.3f} s, {divergence['state']})"
        lines.append(f"  first difference at {when}: {divergence['cause']}")
        lines.append("  the run would have been different from there on")
    lines += [_interlock_line(one, period_ns) for one in found["interlocks"] if one["exact"]]
    inexact = [_interlock_line(one, period_ns) for one in found["interlocks"] if not one["exact"]]
    told = [*(f"  {text}" for text in found["tares"]), *(_metric_line(one) for one in found["metrics"])]
    if found["exact"]:
        lines += told
    elif inexact or told:
        lines.append("  not exact: asked of the load that was recorded, not of the one that would have been:")
        lines += [f"  {line}" for line in (*inexact, *told)]
    if verdict["recorded"] != verdict["other"]:
        why = f": {verdict['reasons'][0]}" if verdict["reasons"] else ""
        lines.append(f"  verdict: {verdict['recorded']} as recorded, {verdict['other']} with the other recipe{why}")
    if not found["changed"]:
        lines.append("  nothing would have changed")
    return lines


def _interlock_line(one: dict[str, Any], period_ns: int) -> str:
    scans = [scan for scan in (one["recorded_scan"], one["other_scan"]) if scan is not None]
    when = f"scan {min(scans)} ({min(scans) * period_ns * 1e-9:.3f} s, {one['state']}, {one['torque_out_nm']:g} N·m)"
    text = {
        "new": f"would have been raised at {when}",
        "gone": f"would not have been raised; the run raised it at {when}",
        "moved": f"would have been raised at scan {one['other_scan']} instead of {one['recorded_scan']}",
    }[one["change"]]
    return f"  interlock {one['id']} ({one['reaction']}) {text}"


def _metric_line(change: dict[str, Any]) -> str:
    def side(metric: dict[str, Any] | None) -> str:
        if metric is None:
            return "not asked for"
        limits = metric.get("limits") or {}
        bounds = [f"{name} {limits[name]:g}" for name in ("min", "max") if limits.get(name) is not None]
        value = "no value" if metric["value"] is None else f"{metric['value']:.4g} {metric['unit']}"
        return f"{value} ({', '.join(bounds) or 'no limit'}): {metric['verdict'] or 'not judged'}"

    branch = f" {change['branch']}" if change["branch"] else ""
    return f"  {change['id']}{branch}: {side(change['recorded'])} -> {side(change['other'])}"
