"""The report of a run: one HTML file that needs nothing else, for whoever defends the verdict months later."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import jinja2

from station.headline import ending_text, headline, remaining_reasons, virtual_badges
from station.result_view import all_rows, limits_text, metric_name, number, timing_line, uncertainty_text, unit_text

TEMPLATES = Path(__file__).parent / "templates"
TEMPLATE = "report.html.j2"

PICTURES: dict[str, str] = {
    "loop.png": "Wind-up over torque: every sample, the rising and falling branches and the mean curve",
    "time.png": "Torque and angle of the locked shaft over time, with the states of the run and its alarm",
}
"""What each picture of a run shows, for readers that do not see it."""

RULES = {
    "simple": "Simple acceptance: the measured value itself is compared with the limit.",
    "guard_band": "Guard band: limits are moved in by w = r·U to accept, out by w to reject; between is not decidable.",
}


def guarded_text(metric: dict[str, Any], decision: dict[str, Any]) -> str:
    """Return the limits for acceptance, moved in by the guard band; nothing without guard band or uncertainty."""
    if decision["rule"] != "guard_band" or metric["uncertainty"] is None or not limits_text(metric["limits"]):
        return ""
    width = decision["guard_factor"] * metric["uncertainty"]
    low, high = metric["limits"].get("min"), metric["limits"].get("max")
    moved = {"min": None if low is None else low + width, "max": None if high is None else high - width}
    return f"accept {limits_text(moved)}, w = {width:.2g}"


def report_html(
    result: dict[str, Any],
    run: dict[str, Any],
    events: list[dict[str, Any]],
    files: dict[str, str],
    pictures: dict[str, bytes],
    *,
    conditions: dict[str, str] | None = None,
) -> bytes:
    """Return the report as HTML.

    Args:
        result: result.json.
        run: run.json.
        events: transitions, alarms, commands and notes.
        files: text of recipe.yaml and bench.yaml by name.
        pictures: PNG pictures by file name; `PICTURES` says what each shows.
        conditions: temperatures and zeroes of the run, name and text.

    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "guarded": guarded_text,
        "limits": limits_text,
        "metric_name": metric_name,
        "uncertainty": uncertainty_text,
        "unit": unit_text,
    }
    page = environment.get_template(TEMPLATE).render(
        result=result,
        run=run,
        events=events,
        files=files,
        pictures=[(PICTURES[name], base64.b64encode(picture).decode()) for name, picture in pictures.items()],
        metrics=all_rows(result["metrics"]),
        rule=RULES[result["decision"]["rule"]],
        timing_line=timing_line(result["timing"]),
        head=headline(result),
        conditions=conditions or {},
        badges=virtual_badges(result),
        ending=ending_text(result),
        reasons=remaining_reasons(result),
    )
    return page.encode()
