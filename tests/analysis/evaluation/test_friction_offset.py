"""The friction of the input side against the catalogue's: told where they differ, as a sensor with hysteresis does."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.evaluation.friction_offset import friction_offset_note
from analysis.torque_ratio.line_fit import fit_torque_ratio
from analysis.torque_ratio.quadrants import Quadrants, TorqueLine

CATALOGUE_NM = -13.9


def measured(hysteresis_nm: float) -> Quadrants:
    """Return loading and unloading lines of both sides, seen by an output sensor with hysteresis."""
    lines, fits = {}, {}
    for side, sign in (("positive", 1.0), ("negative", -1.0)):
        for move, slope, offset, rising in (("load", 94.7, -13.9, 1.0), ("unload", 168.0, 24.8, -1.0)):
            torque_in = sign * np.linspace(0.5, 4.5, 50)
            torque_out = slope * torque_in + sign * offset - sign * rising * hysteresis_nm
            fit = fit_torque_ratio(torque_in, torque_out)
            fits[f"{move}_{side}"] = fit
            lines[f"{move}_{side}"] = TorqueLine(fit.offset_nm, fit.slope)
    return Quadrants(**lines, fits=fits)


@pytest.mark.parametrize(
    ("hysteresis_nm", "told"), [(0.0, False), (4.0, False), (-4.0, False), (5.5, True), (-5.5, True), (9.0, True)]
)
def test_hysteresis_of_the_output_sensor_shows_in_the_friction(hysteresis_nm: float, *, told: bool) -> None:
    note = friction_offset_note(measured(hysteresis_nm), CATALOGUE_NM)
    assert bool(note) is told
    assert not told or "catalogue" in note


def test_nothing_is_told_where_nothing_is_known() -> None:
    stored = measured(9.0)
    without_fits = Quadrants(stored.load_positive, stored.unload_positive, stored.load_negative, stored.unload_negative)
    assert friction_offset_note(None, CATALOGUE_NM) == ""
    assert friction_offset_note(without_fits, CATALOGUE_NM) == ""
    assert friction_offset_note(measured(9.0), None) == ""
