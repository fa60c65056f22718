"""What input and output torque say of the ratio and of the efficiency of a unit, without any angle.

A reducer of ratio i with friction that grows with its load, mu of it, loads along T_out = C + i/(1 + mu) · T_in and
unloads along i/(1 − mu). So the slope of a loading line over i is the efficiency, and the harmonic mean of both slopes
is i, whatever the efficiency. It is the usual relation η_backward = 2 − 1/η_forward of a gear whose friction is the
same both ways; at η_forward = 50 % the gear locks itself and there is no unloading line.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from analysis.errors import AnalysisError
from analysis.measured import Measured
from analysis.quadrant_fit import fit_lines
from analysis.quadrants import QUADRANTS, Quadrants

SIDES = ("positive", "negative")
CONVERTED_BY = "the lines that convert the torque"


class Slopes(NamedTuple):
    """Slope of each quadrant's line, T_out over T_in, and where it was measured."""

    by_quadrant: Mapping[str, float]
    where: str

    def loading(self) -> list[float]:
        """Slopes of the loading lines of both sides."""
        return [self.by_quadrant[f"load_{side}"] for side in SIDES]

    def ratios(self) -> list[float]:
        """Harmonic mean of the slopes of loading and unloading, for both sides: the ratio of the gear."""
        pairs = [(self.by_quadrant[f"load_{side}"], self.by_quadrant[f"unload_{side}"]) for side in SIDES]
        return [2.0 * load * unload / (load + unload) for load, unload in pairs]


def slopes_of(found: Measured) -> Slopes | str:
    """Return the slopes of the torque lines of a trace, or why it has none.

    They come from the segments that calibrate, else from the measured cycles; where one torque alone is in the trace,
    from the stored lines that convert it.
    """
    trace = found.trace
    if trace.torque_in_nm is None or trace.torque_out_nm is None:
        if isinstance(found.quadrants, Quadrants):
            return Slopes({name: getattr(found.quadrants, name).slope for name in QUADRANTS}, CONVERTED_BY)
        return "not measured: one torque channel alone shows no torque ratio"
    calibration = [run for run in found.runs if run.role == "calibrate"]
    cycles = [one.run for pair in found.pairs for one in pair]
    try:
        fits = fit_lines(trace, calibration or cycles)
    except AnalysisError as error:
        return f"not measured: {error}"
    where = "the lines of the calibration" if calibration else "the lines of the measured cycles"
    return Slopes({name: fit.slope for name, fit in fits.items()}, where)
