"""What another recipe would have changed in a run, as plain data and in words."""

from __future__ import annotations

import json
from typing import Any

from controller.controller import Controller
from controller.held_lock import Left
from station.bench.request import Job, Source, recipe_path
from station.record.check import Table
from station.record.store import RESULT, RunRecord
from station.results.divergence import Beside
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
        RecipeError: the other recipe cannot be read.

    """

    def __init__(self, name: str, run: RunRecord, job: Job, left: Left | None) -> None:
        source = Source.read(recipe_path(name))
        self._run = run
        self._own = job
        # Unchecked: limits below the recorded load are what is asked about.
        self._other = Job(source.recipe(), job.bench, source, job.bench_source)
        self._shadow = ShadowWatch(job.program, self._other.program)
        self.controller = Controller(job.program, self._shadow, left)
        self.beside = Beside(self.controller, Controller(self._other.program, None, left))

    def answer(self, table: Table) -> dict[str, Any]:
        """Return what the other recipe would have changed, as plain data.

        Args:
            table: all records of the run, which was replayed identically and is not altered.

        """
        run, own, other = self._run, self._own.program, self._other
        divergence = self.beside.divergence
        period_ns = int(run.manifest()["period_ns"])
        recorded = run.read_json(RESULT) if run.has(RESULT) else {"verdict": None, "metrics": []}
        verdict, reasons, metrics = recorded["verdict"], [], []
        if run.state() == "complete":
            judged = self._judged(table)
            verdict, reasons, metrics = judged["verdict"], judged["reasons"], verdict_changes(recorded, judged)
        if divergence is not None:
            # What was recorded from there on is no measurement by the other recipe, whatever it looks like.
            verdict = NOT_DECIDABLE
            reasons = [f"the run would have gone another way from {divergence.at(period_ns)} on: {divergence.cause}"]
        interlocks = interlock_changes(table, self._shadow, divergence)
        tares = tare_changes(table, own, other.program)
        return {
            "recipe": {"name": other.recipe.recipe.name, "revision": other.recipe.recipe.revision},
            "same_load": same_load(own, other.program),
            "divergence": None if divergence is None else divergence.to_dict(period_ns),
            "exact": divergence is None,
            "interlocks": interlocks,
            "tares": tares,
            "metrics": metrics,
            "verdict": {"recorded": recorded["verdict"], "other": verdict, "reasons": reasons},
            "changed": bool(divergence or interlocks or tares or metrics or verdict != recorded["verdict"]),
        }

    def _judged(self, table: Table) -> dict[str, Any]:
        run, other = self._run, self._other
        stored = {
            "segments": run.read_json("program.json")["segments"],
            "timing": run.read_json("timing.json"),
            "id": run.id,
        }
        judged: dict[str, Any] = json.loads(json.dumps(judge(table, other.recipe, other.bench, stored).to_dict()))
        return judged


def what_if_lines(found: dict[str, Any], period_ns: int) -> list[str]:
    """Return what the other recipe would have changed, for a person: what is exact first, then what is not."""
    recipe, divergence, verdict = found["recipe"], found["divergence"], found["verdict"]
    lines = [f"with {recipe['name']} revision {recipe['revision']}:"]
    if not found["same_load"]:
        lines.append("  it would have commanded another load; only limits are compared, on the load that was recorded")
    if divergence is not None:
        when = f"scan {divergence['scan']} ({divergence['t_s']:.3f} s, {divergence['state']})"
        lines.append(f"  first difference at {when}: {divergence['cause']}")
        lines.append("  the run would have gone another way from there")
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
