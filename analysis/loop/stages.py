"""Stages between a trace and its metrics, in their order, and what each one says that it has done."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

STAGES: dict[str, str] = {
    "time alignment": "channels that lag are shifted to a common time",
    "wind-up": "angles of both shafts combined into one angle at the output",
    "turning points": "branches found by the commanded segments or by the turning points of the curve",
    "virgin quarter": "only full branches are used: no first rise, approaches, conditioning or final unloading",
    "output torque": "torque at the output, as measured or from the input torque by the torque ratio",
    "drift": "wind-up over time from branches of the same direction in successive cycles",
    "fixture": "fixture deflection subtracted from the wind-up, sample by sample",
    "branches": "rising and falling branch of each cycle, paired",
    "binning": "samples averaged in blocks along time, torque and angle alike",
    "monotone regression": "torque smoothed to rise along a rising branch; points that become equal are averaged",
    "reversal zones": "torque range after each turning point, where friction still reverses, left out of the fit",
    "fits": "linear and quadratic segments of both branches and their mean curve",
    "uncertainty": "contributions to the uncertainty of the metrics",
}
"""Name of each stage and what it is for, in the order in which they run."""


@dataclass(frozen=True)
class Figure:
    """A number with its unit; None for one that could not be had."""

    value: float | None
    unit: str


@dataclass(frozen=True)
class StageRecord:
    """What one stage did: its name (of STAGES), in words, and in figures; `applied` when it changed the data."""

    name: str
    text: str
    figures: Mapping[str, Figure] = field(default_factory=dict)
    applied: bool = False

    def to_dict(self) -> dict[str, object]:
        """Return the object of the JSON contract."""
        figures = {name: {"value": _finite(one.value), "unit": one.unit} for name, one in self.figures.items()}
        return {"stage": self.name, "text": self.text, "applied": self.applied, "figures": figures}


def _finite(value: float | None) -> float | None:
    """JSON has no other way to say that there is no number."""
    return value if value is not None and math.isfinite(value) else None
