"""`lostmotion check`: whether a recipe is in order, and what it would do."""

from __future__ import annotations

import json
import sys
from typing import Any

from station.plain_text import knows_braille
from station.progress import clock
from station.request import Job, load_job
from station.terminal_plot import plot


def summary(job: Job) -> dict[str, Any]:
    """Return what a checked recipe would do, as plain data: torques in N·m, times in s."""
    recipe, program = job.recipe, job.program
    return {
        "recipe": {
            "name": recipe.recipe.name,
            "revision": recipe.recipe.revision,
            "sha256": job.recipe_source.sha256,
        },
        "bench": {"name": job.bench.bench.name, "revision": job.bench.bench.revision},
        "model": recipe.unit_under_test.model,
        "duration_s": round(program.planned_scans * program.period_s, 3),
        "peak_torque_nm": program.peak_torque_nm,
        "rated_torque_nm": recipe.unit_under_test.rated_torque_nm,
        "period_ns": recipe.sampling.period_ns,
        "segments": len(program.segments),
        "load_profile": [{"t_s": round(t_s, 3), "torque_nm": torque_nm} for t_s, torque_nm in program.load_profile()],
        "metrics": [one.id for one in recipe.metrics],
    }


def check(recipe: str, bench: str | None, *, as_json: bool) -> int:
    """Check a recipe and print what it would do; RecipeError with all that is wrong."""
    job = load_job(recipe, bench)
    found = summary(job)
    if as_json:
        sys.stdout.write(json.dumps(found, ensure_ascii=False) + "\n")
        return 0
    unit = job.recipe.unit_under_test
    peak = found["peak_torque_nm"]
    lines = [
        f"{job.recipe_source.path}: in order",
        f"  {found['recipe']['name']} revision {found['recipe']['revision']}: {job.recipe.recipe.description}",
        f"  bench        {job.bench.bench.name} revision {job.bench.bench.revision}, load at the {job.recipe.loading}",
        f"  unit         {unit.model}, rated {unit.rated_torque_nm:g} N·m, ratio {unit.ratio:g}",
        f"  peak torque  {peak:g} N·m ({peak / unit.rated_torque_nm:.0%} of rated)",
        f"  duration     {clock(found['duration_s'])} min, {found['segments']} segments",
        f"  scan         every {found['period_ns'] / 1e6:g} ms",
        f"  metrics      {', '.join(dict.fromkeys(found['metrics']))}",
        "",
        plot(job.program.load_profile(), ("s", "N·m"), plain=not knows_braille(sys.stdout)),
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0
