"""What an evaluation says of a wanted metric: its value on each side, its uncertainty, verdict and reasons."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.evaluation.verdict import Verdict, worst
from analysis.loop.method import MetricWanted
from analysis.uncertainty.budget import Budget
from analysis.uncertainty.scatter import USUAL
from definitions.metrics import Metric
from definitions.units import RAD_PER_ARCMIN


@dataclass(frozen=True)
class SideValue:
    """A metric on one side ("+", "-" or "both"): mean over cycles, each cycle's value, and its verdict."""

    side: str
    value: float | None
    uncertainty: float | None
    """Expanded, U = k·u of the budget; None where nothing is known: no figures of the sensors, and one cycle."""
    standard_deviation: float | None
    per_cycle: tuple[float, ...]
    """Of a magnitude below zero where a cycle fell on the other side than their mean."""
    verdict: Verdict
    reason: str
    budget: Budget | None = None
    """Of a grade: the budget of its backlash."""

    @property
    def budget_rows(self) -> list[dict[str, object]]:
        """Rows of the budget as plain data, largest contribution first."""
        return [] if self.budget is None else [row._asdict() for row in self.budget.rows]

    @property
    def drawn(self) -> dict[str, object] | None:
        """Monte Carlo beside the budget as plain data; None without. Of a grade: of its backlash [arcmin]."""
        found = None if self.budget is None else self.budget.monte_carlo
        return None if found is None else found._asdict()

    @property
    def coverage_factor(self) -> float:
        """The k of its uncertainty."""
        return (USUAL if self.budget is None else self.budget.coverage).factor

    @property
    def uncertainty_kind(self) -> str | None:
        """What the uncertainty contains, the kind of `Budget`; None without any."""
        return None if self.budget is None else self.budget.kind


@dataclass(frozen=True)
class MetricResult:
    """A wanted metric: its definition and, headline first, the value of each side. The worse side judges."""

    wanted: MetricWanted
    definition: Metric
    branch: str
    estimator: str
    band: float | None
    torque_nm: float | None
    sides: tuple[SideValue, ...]
    choices: tuple[str, ...] = ()
    """What was chosen otherwise than the definition does by itself."""

    @property
    def headline(self) -> SideValue:
        """The side that is asked for, or the positive one."""
        return self.sides[0]

    @property
    def limited(self) -> bool:
        """Say whether the metric has a limit."""
        return self.wanted.limited

    @property
    def verdict(self) -> Verdict | None:
        """Worst of the sides; None for a value that was asked for without a limit: it decides nothing."""
        return worst(side.verdict for side in self.sides) if self.limited else None

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the metric does not pass, or could not be evaluated."""
        return tuple(side.reason for side in self.sides if side.reason)

    def _limits(self) -> dict[str, float | None]:
        spread = self.wanted.max_standard_deviation
        of_spread = {} if spread is None else {"max_standard_deviation": spread}
        return {"min": self.wanted.min, "max": self.wanted.max, **of_spread}

    def to_dict(self) -> dict[str, object]:
        """Return the object of the JSON contract."""
        shown, cycles = self.headline, self.headline.per_cycle
        found: dict[str, object] = {
            "id": self.wanted.id,
            "title": self.definition.title,
            "definition": self.definition.text,
            "value": shown.value,
            "unit": self.definition.unit,
            "uncertainty": shown.uncertainty,
            "coverage_factor": None if shown.uncertainty is None else shown.coverage_factor,
            "uncertainty_kind": shown.uncertainty_kind,
            "budget": shown.budget_rows,
            "branch": self.branch,
            "side": shown.side,
            "estimator": self.estimator,
            "choices": list(self.choices),
            "band": self.band,
            "torque_nm": self.torque_nm,
            "cycles": len(cycles),
            "mean": shown.value,
            "standard_deviation": shown.standard_deviation,
            "per_cycle": list(cycles),
            "limits": self._limits(),
            "verdict": None if self.verdict is None else self.verdict.value,
            "reasons": list(self.reasons),
            "sides": {
                side.side: {
                    "value": side.value,
                    "uncertainty": side.uncertainty,
                    "budget": side.budget_rows,
                    "monte_carlo": side.drawn,
                    "standard_deviation": side.standard_deviation,
                    "per_cycle": list(side.per_cycle),
                    "verdict": side.verdict.value if self.limited else None,
                }
                for side in self.sides
            },
        }
        if shown.drawn is not None:
            found["monte_carlo"] = shown.drawn
        if self.wanted.id == "hysteresis_energy":
            found["value_j"] = None if shown.value is None else shown.value * RAD_PER_ARCMIN
        return found
