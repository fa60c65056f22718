"""Judge the validity gates of the table `GATES`: figure against limit, and what is said of it.

A failed gate makes the verdict NOT DECIDABLE; a gate whose figure does not apply says why and decides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from analysis.errors import AnalysisError
from analysis.gate_table import GATES, Gate
from analysis.measured import Evidence

__all__ = ["GATES", "GateResult", "gate_reasons", "is_loose", "judge_gates"]


@dataclass(frozen=True)
class GateResult:
    """A gate's figure against its limit; `passed` is None where it does not apply, and the text then says why."""

    id: str
    figure: float | None
    limit: float
    unit: str
    passed: bool | None
    text: str

    def to_dict(self) -> dict[str, object]:
        """Return the object of the JSON contract."""
        return {
            "id": self.id,
            "figure": self.figure,
            "limit": self.limit,
            "unit": self.unit,
            "passed": self.passed,
            "text": self.text,
        }


def judge_gates(evidence: Evidence, limits: Mapping[str, float] | None = None) -> tuple[GateResult, ...]:
    """Judge every gate of the table; limits replace those of the table, in the gate's unit.

    A figure that is not a number fails. Raises AnalysisError for limits of gates that do not exist or are fixed.
    """
    chosen = dict(limits or {})
    for name, limit in chosen.items():
        gate = GATES.get(name)
        if gate is None or not gate.configurable or not math.isfinite(limit):
            allowed = ", ".join(key for key, row in GATES.items() if row.configurable)
            raise AnalysisError(f"validity gate '{name}': found a limit of {limit:g}; limits may be set for {allowed}")
    if evidence.facts is not None:
        chosen["missed_periods"] = evidence.facts.missed_allowed * 100.0
        chosen["sample_age"] = float(evidence.facts.sample_age_allowed_scans)
    return tuple(_judged(name, gate, evidence, chosen.get(name, gate.limit)) for name, gate in GATES.items())


def _judged(name: str, gate: Gate, evidence: Evidence, limit: float) -> GateResult:
    reading = gate.figure(evidence)
    if isinstance(reading, str):
        return GateResult(name, None, limit, gate.unit, None, f"{gate.what}: not applicable: {reading}")
    figure = reading.figure
    passed = figure >= limit if gate.least else figure <= limit
    said = _with_unit(figure, gate.unit)
    allowed = f"allowed is {_with_unit(limit, gate.unit)} {'at least' if gate.least else 'at most'}"
    if is_loose(name, limit):
        allowed += f" by the recipe, where {_with_unit(gate.limit, gate.unit)} is usual"
    if passed:
        text = f"{gate.what}: {said}, {allowed}"
    else:
        text = f"{reading.words or gate.failed}: {said}, {allowed}; {gate.action}"
    return GateResult(name, figure if math.isfinite(figure) else None, limit, gate.unit, passed, text)


def is_loose(name: str, limit: float) -> bool:
    """Say whether a limit lets more pass than that of the table does."""
    gate = GATES[name]
    return limit < gate.limit if gate.least else limit > gate.limit


def _with_unit(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return "no number"
    return f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"


def gate_reasons(gates: Sequence[GateResult], objections: Sequence[str]) -> list[str]:
    """Return why a measurement does not count, one line for each objection and each failed gate; empty if it does."""
    said = [f"measurement invalid: {objection}" for objection in objections]
    failed = [gate for gate in gates if gate.passed is False and gate.id != "record"]
    return said + [f"measurement invalid: {gate.id}: {gate.text}" for gate in failed]
