"""`lostmotion decision`: what a decision rule risks for a process, and the guard band that keeps a risk."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from typing import NamedTuple

from analysis.evaluation.guard_band import Process, gamma_process, guard_for, normal_process, risks
from analysis.evaluation.verdict import check_limits
from station.errors import StationError

TEXTS = {
    "outside": "parts whose true value is outside the limits",
    "false_accept": "PFA: bad parts accepted (consumer's risk)",
    "false_reject": "PFR: good parts not accepted (producer's risk)",
    "false_fail": "good parts with the verdict FAIL",
    "undecided": "NOT DECIDABLE: neither PASS nor FAIL",
}
"""Field of the risks: its words."""


class Asked(NamedTuple):
    """What the command line asked for; all in the unit of the metric, u is a standard uncertainty (U / 2)."""

    mean: float | None
    sd: float | None
    gamma: tuple[float, float] | None
    low: float | None
    high: float | None
    u: float
    guard: float | None
    factor: float | None
    false_accept: float | None


def decision(asked: Asked, *, as_json: bool) -> int:
    """Print the risks of a decision rule; return the exit code.

    Raises:
        StationError, AnalysisError: what is missing, contradicts or makes no sense.

    """
    process = _process(asked)
    check_limits("of the decision", asked.low, asked.high)
    guard = _guard(asked, process)
    found = risks(process, asked.low, asked.high, asked.u, guard)
    if as_json:
        answer = {"process": process.text, "min": asked.low, "max": asked.high, "u": asked.u, **asdict(found)}
        sys.stdout.write(json.dumps(answer, ensure_ascii=False) + "\n")
        return 0
    limits = " … ".join("" if limit is None else f"{limit:g}" for limit in (asked.low, asked.high))
    expanded = 2.0 * asked.u
    lines = [
        f"process {process.text}; limits {limits}",
        f"u = {asked.u:g}, U = {expanded:g} (k = 2); guard band w = {guard:.5g} (r = w / U = {guard / expanded:.3g})",
        *(f"  {text:46}{getattr(found, name):12.5%}" for name, text in TEXTS.items()),
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def _process(asked: Asked) -> Process:
    normal = asked.mean is not None and asked.sd is not None
    if asked.gamma is not None and asked.mean is None and asked.sd is None:
        return gamma_process(*asked.gamma)
    if not normal or asked.gamma is not None:
        raise StationError(
            "process missing or given twice: give --process-mean and --process-sd, or --process-gamma SHAPE SCALE"
        )
    return normal_process(asked.mean or 0.0, asked.sd or 0.0)


def _guard(asked: Asked, process: Process) -> float:
    given = [one for one in (asked.guard, asked.factor, asked.false_accept) if one is not None]
    if len(given) > 1:
        raise StationError("--guard, --factor and --pfa each say how wide the guard band is: give one of them")
    if asked.false_accept is not None:
        return guard_for(process, asked.low, asked.high, asked.u, asked.false_accept)
    return asked.guard if asked.guard is not None else (asked.factor or 0.0) * 2.0 * asked.u
