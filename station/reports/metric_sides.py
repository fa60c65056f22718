"""The sides of a metric as rows of a table, the one that judges first."""

from __future__ import annotations

from math import inf
from typing import Any

SEVERITY = {"FAIL": 0, "NOT DECIDABLE": 1, "PASS": 2}

OF_ONE_SIDE = ("budget", "standard_deviation", "per_cycle")
"""What each side has for itself, beside value, uncertainty and verdict; records of older versions have it of one."""


def side_rows(metric: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a metric as one row per side, the one that judges first."""
    sides = metric.get("sides") or {}
    headline = sides.get(metric["side"], metric)
    rows = [metric | {"verdict": headline.get("verdict")}]
    rows += [
        metric
        | {"side": side, "value": found["value"], "uncertainty": found["uncertainty"], "verdict": found["verdict"]}
        | {name: found.get(name) for name in OF_ONE_SIDE}
        for side, found in sides.items()
        if side != metric["side"]
    ]
    return sorted(rows, key=_goodness)


def _goodness(row: dict[str, Any]) -> tuple[int, float]:
    """Order rows by how near they are to refusal: verdict first, then the distance to the nearest limit."""
    limits, value = row.get("limits") or {}, row["value"]
    low, high = limits.get("min"), limits.get("max")
    if value is None:
        return SEVERITY.get(row["verdict"] or "", len(SEVERITY)), -inf
    room = min(inf if low is None else value - low, inf if high is None else high - value)
    return SEVERITY.get(row["verdict"] or "", len(SEVERITY)), room


def all_rows(metrics: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the metrics as rows, every side of each; of the sides the one that judges first."""
    return [row for metric in metrics for row in side_rows(metric)]


def judging_rows(metrics: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one row per metric: the side that is nearest to refusal, or beyond it."""
    return [side_rows(metric)[0] for metric in metrics]
