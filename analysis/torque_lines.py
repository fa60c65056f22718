"""What input and output torque say of the ratio, the efficiency and the zero of the output torque, without any angle.

A reducer of ratio i with friction that grows with its load, mu of it, loads along T_out = C + i/(1 + mu) · T_in and
unloads along i/(1 − mu). So the slope of a loading line over i is the efficiency, and the harmonic mean of both slopes
is i, whatever the efficiency. It is the usual relation η_backward = 2 − 1/η_forward of a gear whose friction is the
same both ways; at η_forward = 50 % the gear locks itself and there is no unloading line.

In one direction of motion the unloading line of one side and the loading line of the other meet where the load is none,
for the friction without load is the same from both sides. What the output sensor reads there is its zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from analysis.errors import AnalysisError
from analysis.measured import Measured
from analysis.quadrant_fit import fit_lines
from analysis.quadrants import QUADRANTS, Quadrants, TorqueLine

SIDES = ("positive", "negative")
CONVERTED_BY = "the lines that convert the torque"

LEAST_APART = 0.1
"""Share of the loading slope by which that of unloading must differ, for their lines to meet anywhere definite."""


class Lines(NamedTuple):
    """Each quadrant's line of T_out over T_in, and where it was measured."""

    by_quadrant: Mapping[str, TorqueLine]
    where: str

    def loading(self) -> list[float]:
        """Slopes of the loading lines of both sides."""
        return [self.by_quadrant[f"load_{side}"].slope for side in SIDES]

    def ratios(self) -> list[float]:
        """Harmonic mean of the slopes of loading and unloading, both sides: the ratio of the gear; 0 if level."""
        pairs = [(self.by_quadrant[f"load_{side}"].slope, self.by_quadrant[f"unload_{side}"].slope) for side in SIDES]
        return [2.0 * load * unload / (load + unload) if load + unload else 0.0 for load, unload in pairs]

    def zero_nm(self) -> float | None:
        """Output torque at which the lines of a direction of motion meet, N·m; mean of both; None where they do not."""
        found = []
        for side, other in (SIDES, SIDES[::-1]):
            load, unload = self.by_quadrant[f"load_{side}"], self.by_quadrant[f"unload_{other}"]
            apart = unload.slope - load.slope
            if not apart > LEAST_APART * load.slope:
                return None
            found.append((unload.slope * load.offset_nm - load.slope * unload.offset_nm) / apart)
        return sum(found) / len(found)


def lines_of(found: Measured) -> Lines | str:
    """Return the torque lines of a trace, or why it has none.

    They come from the segments that calibrate, else from the measured cycles; where one torque alone is in the trace,
    from the stored lines that convert it.
    """
    trace = found.trace
    if trace.torque_in_nm is None or trace.torque_out_nm is None:
        if isinstance(found.quadrants, Quadrants):
            return Lines({name: getattr(found.quadrants, name) for name in QUADRANTS}, CONVERTED_BY)
        return "not measured: one torque channel alone shows no torque ratio"
    calibration = [run for run in found.runs if run.role == "calibrate"]
    cycles = [one.run for pair in found.pairs for one in pair]
    try:
        fits = fit_lines(trace, calibration or cycles)
    except AnalysisError as error:
        return f"not measured: {error}"
    where = "the lines of the calibration" if calibration else "the lines of the measured cycles"
    return Lines({name: TorqueLine(fit.offset_nm, fit.slope) for name, fit in fits.items()}, where)
