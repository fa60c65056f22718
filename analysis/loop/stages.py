"""Stages between a trace and its metrics, in their order, and what each one says that it has done."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

STAGES: dict[str, str] = {
    "time alignment": "channels are shifted in time to compensate their lags",
    "wind-up": "angles of both shafts combined into one angle at the output",
    "turning points": "branches found by the commanded segments or by the turning points of the curve",
    "virgin quarter": "only full branches are used: no first rise, approaches, conditioning or final unloading",
    "output torque": "torque at the output, as measured or from the input torque by the torque ratio",
    "drift": "drift of the wind-up over time, from branches of the same direction in successive cycles",
    "fixture": "fixture deflection subtracted from the wind-up, sample by sample",
    "branches": "rising and falling branch of each cycle, paired",
    "binning": "torque and angle averaged over blocks of successive samples",
    "monotone regression": "torque smoothed so that it does not reverse within a branch; equal torques are averaged",
    "reversal zones": "torque range after each turning point left out of the fit: friction still reverses there",
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
