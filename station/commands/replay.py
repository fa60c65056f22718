"""`lostmotion replay`: steps the controller through a record, and asks what another recipe would have changed."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

from controller.controller import Controller
from controller.held_lock import Left
from controller.program import Program
from station.bench.request import Job, Source, load_job, recipe_path
from station.errors import StationError
from station.record.check import Table, table_of
from station.record.program_file import PROGRAM, program_differences
from station.record.run_record import RunRecord
from station.record.seal import EXIT_ALTERED, alteration_lines, alterations
from station.record.store import Store
from station.results.replay import Replayed, replay
from station.results.what_if import ShadowWatch, interlock_changes, judge, same_load, tare_changes, verdict_changes
from station.run.conclusion import finite
from station.run.recovery import recover

SAME, DIFFERS, BAD = 0, 1, 2
WHAT_IF_REFUSED = "what another recipe would have changed is not asked of an altered record"


def replay_run(name: str, data: Path, other: str | None, *, as_json: bool) -> int:
    """Replay a run; 0 identical (or nothing would have changed), 1 not, 2 when the record cannot be replayed.

    An altered record is replayed, because where it differs is worth knowing, but 0 becomes 3: identical to what?

    Raises:
        StationError, RecipeError: there is no such run, or its recipe or bench cannot be loaded any more.

    """
    run = Store(data).find(name)
    recover(run)
    altered = alterations(run)
    job = load_job(str(run.folder / "recipe.yaml"), str(run.folder / "bench.yaml"))
    try:
        content = run.samples.read_bytes()
    except OSError as error:
        raise StationError(f"{run.samples}: cannot be read: {error.strerror}") from error
    other_job = None if other is None else _other(other, job)
    shadow = None if other_job is None else ShadowWatch(job.program, other_job.program)
    left = run.manifest().get("left")
    controller = Controller(job.program, shadow, None if left is None else Left(**left))
    started = time.perf_counter()
    found = replay(content, controller)
    seconds = time.perf_counter() - started
    report = _report(run, job, controller, found) | {
        "scans_per_s": round((found.identical + 1) / seconds),
        "seconds": round(seconds, 3),
        "altered": list(altered),
    }
    code = BAD if found.damage else SAME if found.same and not report["events_differ"] else DIFFERS
    if shadow is not None and other_job is not None and code == SAME and not altered:
        report["what_if"] = _what_if(run, job, other_job, table_of(content), shadow)
        code = DIFFERS if report["what_if"]["changed"] else SAME
    if altered and code == SAME:
        code = EXIT_ALTERED
    if as_json:
        sys.stdout.write(json.dumps(finite(report), ensure_ascii=False) + "\n")
    else:
        told = [*alteration_lines(altered), *_lines(report, found, int(run.manifest()["period_ns"]))]
        told += [WHAT_IF_REFUSED] if altered and other is not None else []
        sys.stdout.write("\n".join(told) + "\n")
    return code


def _other(name: str, job: Job) -> Job:
    """Return another recipe on the run's bench, unchecked: limits below the recorded load are what is asked about."""
    source = Source.read(recipe_path(name))
    return Job(source.recipe(), job.bench, source, job.bench_source)


def _report(run: RunRecord, job: Job, controller: Controller, found: Replayed) -> dict[str, Any]:
    return {
        "run": run.id,
        "state": run.state(),
        "identical_scans": found.identical,
        "difference": None if found.difference is None else found.difference.to_dict(),
        "damage": found.damage,
        "cut_bytes": found.cut_bytes,
        "program_differs": _program_differences(run, job.program),
        "events_differ": _event_differences(run, controller) if found.same else [],
    }


def _program_differences(run: RunRecord, program: Program) -> list[str]:
    """Return where the recorded recipe now becomes another program than it became then."""
    if not run.has(PROGRAM):
        return []
    return program_differences(run.read_json(PROGRAM), program)


def _event_differences(run: RunRecord, controller: Controller) -> list[str]:
    """Return the first transition that differs from the run's own list of events; none for a run without one."""
    if not run.has("events.jsonl"):
        return []
    lines = (run.folder / "events.jsonl").read_text(encoding="utf-8").splitlines()
    rows = [json.loads(line) for line in lines]
    told = [(row["scan"], row["state"], row["to"]) for row in rows if row["kind"] == "transition"]
    made = [(event.scan, event.state, event.text) for event in controller.events if event.kind == "transition"]
    if told == made:
        return []
    differing = [(a, b) for a, b in zip(told, made, strict=False) if a != b]
    first = differing[0] if differing else (len(told), len(made))
    return [f"transitions differ: recorded {first[0]}, replayed {first[1]}"]


def _what_if(run: RunRecord, job: Job, other: Job, table: Table, shadow: ShadowWatch) -> dict[str, Any]:
    interlocks = interlock_changes(table, shadow)
    tares = tare_changes(table, job.program, other.program)
    recorded = run.read_json("result.json") if run.has("result.json") else {"verdict": None, "metrics": []}
    verdict, metrics = recorded["verdict"], []
    if run.state() == "complete":
        stored = {
            "segments": run.read_json("program.json")["segments"],
            "timing": run.read_json("timing.json"),
            "id": run.id,
        }
        judged = json.loads(json.dumps(judge(table, other.recipe, other.bench, stored).to_dict()))
        verdict, metrics = judged["verdict"], verdict_changes(recorded, judged)
    return {
        "recipe": {"name": other.recipe.recipe.name, "revision": other.recipe.recipe.revision},
        "same_load": same_load(job.program, other.program),
        "interlocks": interlocks,
        "tares": tares,
        "metrics": metrics,
        "verdict": {"recorded": recorded["verdict"], "other": verdict},
        "changed": bool(interlocks or tares or metrics or verdict != recorded["verdict"]),
    }


def _lines(report: dict[str, Any], found: Replayed, period_ns: int) -> list[str]:
    speed = f"{report['seconds']:.2f} s, {report['scans_per_s']} scans/s"
    lines = [f"{report['run']} ({report['state']}): {found.identical} scans replayed identically ({speed})"]
    if found.cut_bytes:
        lines.append(
            f"{found.cut_bytes} bytes of a last, incomplete record are left out: it was cut while being written"
        )
    if found.damage:
        lines.append(f"the record is damaged: {found.damage}")
    lines += [f"the recorded recipe becomes another program now: {text}" for text in report["program_differs"][:8]]
    if found.difference is not None:
        lines += found.difference.lines(period_ns)
    lines += report["events_differ"]
    if "what_if" in report:
        lines += _what_if_lines(report["what_if"], period_ns)
    return lines


def _what_if_lines(what_if: dict[str, Any], period_ns: int) -> list[str]:
    recipe = what_if["recipe"]
    lines = [f"with {recipe['name']} revision {recipe['revision']}:"]
    if not what_if["same_load"]:
        lines.append("  it would have commanded another load; only limits are compared, on the load that was recorded")
    for one in what_if["interlocks"]:
        scans = [scan for scan in (one["recorded_scan"], one["other_scan"]) if scan is not None]
        when = (
            f"scan {min(scans)} ({min(scans) * period_ns * 1e-9:.3f} s, {one['state']}, {one['torque_out_nm']:g} N·m)"
        )
        text = {
            "new": f"would have been raised at {when}",
            "gone": f"would not have been raised; the run raised it at {when}",
            "moved": f"would have been raised at scan {one['other_scan']} instead of {one['recorded_scan']}",
        }[one["change"]]
        end = ", and the run would have gone another way from there" if one["diverges"] else ""
        lines.append(f"  interlock {one['id']} ({one['reaction']}) {text}{end}")
    lines += [f"  {text}" for text in what_if["tares"]]
    lines += [_metric_line(one) for one in what_if["metrics"]]
    verdict = what_if["verdict"]
    if verdict["recorded"] != verdict["other"]:
        lines.append(f"  verdict: {verdict['recorded']} as recorded, {verdict['other']} with the other limits")
    if not what_if["changed"]:
        lines.append("  nothing would have changed")
    return lines


def _metric_line(change: dict[str, Any]) -> str:
    def side(metric: dict[str, Any] | None) -> str:
        if metric is None:
            return "not asked for"
        limits = metric.get("limits") or {}
        bounds = [f"{name} {limits[name]:g}" for name in ("min", "max") if limits.get(name) is not None]
        value = "no value" if metric["value"] is None else f"{metric['value']:.4g} {metric['unit']}"
        return f"{value} ({', '.join(bounds) or 'no limit'}): {metric['verdict']}"

    branch = f" {change['branch']}" if change["branch"] else ""
    return f"  {change['id']}{branch}: {side(change['recorded'])} -> {side(change['other'])}"
