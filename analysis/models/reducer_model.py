"""A reducer as a model that can be played: angle sequence in, torque sequence out; written to JSON and read back.

For robot simulators: the file holds every parameter with its unit and uncertainty, and the equations in words.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from analysis.models import maxwell_slip
from analysis.models.identify import Identified
from analysis.models.path import PathState
from analysis.models.table import checked_values, model_named
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

FORMAT = "lostmotion reducer model"
VERSION = 1
EXPORT = "Use a file that 'lostmotion model --out' wrote"


@dataclass(frozen=True)
class ReducerModel:
    """A model by name (one of MODELS, or maxwell_slip) with its parameters by name, checked against the table."""

    model: str
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the parameters; AnalysisError names the wrong one."""
        check = maxwell_slip.checked_maxwell_slip if self.model == maxwell_slip.NAME else None
        checked = check(self.values) if check else checked_values(self.model, self.values)
        object.__setattr__(self, "values", checked)

    def play(self, angle_arcmin: FloatArray, state: PathState | None = None) -> tuple[FloatArray, PathState]:
        """Torque [N·m] at the output for a sequence of wind-ups [arcmin], and the state after the last one.

        state: where the model stands; None is a unit at rest, wound up to the first angle. Playing a sequence in
        pieces, each from the state of the one before, gives the same torques: a simulator may step it sample by sample.
        The elements depend on the path only, not on time. Raises AnalysisError for angles that are not finite.
        """
        begin = PathState() if state is None else state
        if self.model == maxwell_slip.NAME:
            return maxwell_slip.play_maxwell_slip(self.values, angle_arcmin, begin)
        return model_named(self.model).play(self.values, angle_arcmin, begin)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each parameter."""
        if self.model == maxwell_slip.NAME:
            return maxwell_slip.parameter_units(self.values)
        return {name: parameter.unit for name, parameter in model_named(self.model).parameters.items()}


def model_to_json(found: Identified, unit_under_test: str = "") -> str:
    """Write an identified model as JSON.

    Raises AnalysisError when the loop does not determine a parameter: a simulator would take a number that could be any
    other. Merged Maxwell-slip elements are not part of the model and do not count.
    """
    if found.refused and found.model != maxwell_slip.NAME:
        reasons = "; ".join(f"{refusal.parameter} {refusal.reason}" for refusal in found.refused)
        raise AnalysisError(
            f"model {found.model}: not exported: {reasons}; fix the parameter to a known value, or load the unit higher"
        )
    model = ReducerModel(found.model, found.values)
    row = None if found.model == maxwell_slip.NAME else model_named(found.model)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "unit_under_test": unit_under_test,
        "model": found.model,
        "equations": row.equations if row else maxwell_slip.EQUATIONS,
        "text": row.text if row else maxwell_slip.TEXT,
        "angle": "wind-up at the output, arcmin (1 arcmin = π/10800 rad)",
        "torque": "torque at the output, N·m",
        "parameters": [
            {"name": name, "value": value, "unit": model.units[name], "standard_uncertainty": _or_none(found.u[name])}
            for name, value in model.values.items()
        ],
        "correlation": {
            "of": list(found.free),
            "matrix": [[_or_none(float(entry)) for entry in line] for line in found.correlation],
        },
        "at_bound": list(found.at_bound),
        "residual_pct_of_peak": found.residual_pct,
        "worst_residual_pct_of_peak": found.worst_pct,
        "identified_to_nm": found.peak_nm,
        "identified_within_arcmin": list(found.angle_range_arcmin),
        "samples": found.samples,
    }
    return json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False) + "\n"


def model_from_json(text: str, source: str = "model file") -> ReducerModel:
    """Read a model back; AnalysisError says what is missing, malformed or out of its range, and where."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise AnalysisError(f"{source}: not JSON: {error}; expected a file written by the model export") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT or document.get("version") != VERSION:
        raise AnalysisError(f"{source}: expected a JSON object with format '{FORMAT}' and version {VERSION}. {EXPORT}")
    entries = document.get("parameters")
    if not isinstance(document.get("model"), str) or not isinstance(entries, list):
        raise AnalysisError(f"{source}: expected 'model' (a name) and 'parameters' (a list). {EXPORT}")
    values: dict[str, float] = {}
    for number, entry in enumerate(entries, start=1):
        name, value = _entry(entry, f"{source}: parameters[{number}]")
        if name in values:
            raise AnalysisError(f"{source}: parameters[{number}]: {name} is there twice; keep one")
        values[name] = value
    try:
        return ReducerModel(document["model"], values)
    except AnalysisError as error:
        raise AnalysisError(f"{source}: {error}") from error


def _entry(entry: Any, where: str) -> tuple[str, float]:
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise AnalysisError(f"{where}: found {entry!r:.60}; expected an object with name and value")
    value = entry.get("value")
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > 1e300:
        raise AnalysisError(f"{where}.value: found {value!r:.60}; expected a finite number")
    return entry["name"], float(value)


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
