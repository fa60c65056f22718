"""A loading line begins where the bounce out of the play is over, and nowhere else than at its share of the peak."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from check_support import CONVERTED, GOOD, judged, of
from reference_unit import RATIO

from analysis.loop.measured import measure
from analysis.torque_ratio.line_begin import BY_HALF, FELL_BACK
from analysis.torque_ratio.quadrant_fit import LOADING_RANGE, fit_quadrants
from analysis.torque_ratio.quadrants import Quadrants
from analysis.trace.runs import Run, commanded_runs
from analysis.trace.trace import Trace
from analysis.uncertainty.conditions import conditions_of
from analysis.validity.settled_lines import settled_lines

CALIBRATION = [run for run in commanded_runs(GOOD) if run.role == "calibrate"]
PEAK_NM = max(float(np.abs(run.take(GOOD.torque_out_nm)).max()) for run in CALIBRATION)


def fitted(trace: Trace) -> Quadrants:
    return fit_quadrants(trace, commanded_runs(trace))


def bounced(at: float, top: float, bottom: float) -> Trace:
    """The sound trace, whose output torque leaps from a share of the peak to another, falls back, and waits there."""
    torque = GOOD.torque_out_nm.copy()
    for run in CALIBRATION:
        for piece in run.pieces:
            torque[piece] = leapt(run, torque[piece], at, top, bottom)
    return dataclasses.replace(GOOD, torque_out_nm=torque)


def leapt(run: Run, torque: np.ndarray, at: float, top: float, bottom: float) -> np.ndarray:
    share = run.direction * torque / PEAK_NM
    so_far = np.maximum.accumulate(share)  # noise takes a sample back below a torque that was passed
    waits = (so_far > at) & (so_far < top)
    changed = np.where(waits, np.maximum(share, bottom), share)
    if waits.any():
        changed[np.flatnonzero(waits)[0]] = top
    return run.direction * changed * PEAK_NM


def test_a_branch_that_does_not_bounce_is_fitted_from_its_share_on() -> None:
    quadrants = fitted(GOOD)
    assert quadrants.begins_nm == {}
    lowest = float(quadrants.fits["load_positive"].outputs_nm.min())
    assert lowest == pytest.approx(LOADING_RANGE[0] * PEAK_NM, rel=0.1)


def test_a_bounce_is_left_out_and_as_much_again_as_it_fell_back() -> None:
    whole, found = fitted(GOOD), fitted(bounced(0.04, 0.14, 0.08))
    for name in ("load_positive", "load_negative"):
        assert found.begins_nm[name] == pytest.approx(0.2 * PEAK_NM, rel=0.01)
        assert np.abs(found.fits[name].outputs_nm).min() >= found.begins_nm[name]
        assert found.fits[name].offset_nm == pytest.approx(whole.fits[name].offset_nm, abs=0.5)
        assert found.fits[name].slope == pytest.approx(whole.fits[name].slope, rel=2e-3)
    for name in ("unload_positive", "unload_negative"):
        assert found.fits[name].offset_nm == whole.fits[name].offset_nm


@pytest.mark.parametrize(("top", "bottom", "taken_off"), [(0.42, 0.36, True), (0.45, 0.36, False)])
def test_the_checks_judge_the_line_that_the_result_has(top: float, bottom: float, *, taken_off: bool) -> None:
    """A sound unit was refused by what is on no line of it; one whose bounce stays on its line is."""
    trace = bounced(0.04, top, bottom)
    lines, result = fitted(trace), judged(trace)
    assert bool(lines.begins_nm) is taken_off
    found = of(result, "calibration_agreement")
    assert found.passed is taken_off, found.text
    slopes = [lines.fits[name].slope for name in ("load_positive", "load_negative")]
    assert of(result, "efficiency_low").figure == pytest.approx(100.0 * min(slopes) / RATIO, rel=1e-9)


def test_a_bounce_moves_neither_the_ratio_nor_the_zero_that_the_checks_read() -> None:
    shown = settled_lines(bounced(0.04, 0.3, 0.2), CALIBRATION)
    for side, (ratio, unsure) in settled_lines(GOOD, CALIBRATION).ratios.items():
        assert shown.ratios[side].value == pytest.approx(ratio, abs=0.1 + unsure)
    assert shown.zero_nm is not None
    assert abs(shown.zero_nm.value) + shown.zero_nm.expanded < 0.2


@pytest.mark.parametrize(
    ("at", "top", "bottom"),
    [
        (0.1, 0.1 + 0.5 * FELL_BACK, 0.1),
        (BY_HALF, BY_HALF + 0.1, BY_HALF + 0.05),
        (0.2, BY_HALF - 0.02, BY_HALF - 0.08),
    ],
)
def test_a_ripple_and_what_is_over_beyond_half_of_the_peak_move_no_line(at: float, top: float, bottom: float) -> None:
    """A bounce is taken off as a whole: of the last a line began at half of the peak, in the middle of it."""
    assert fitted(bounced(at, top, bottom)).begins_nm == {}


@pytest.mark.parametrize("seen", ["steps", "sags", "drops out", "spikes"])
@pytest.mark.parametrize("share", [0.015, 0.1])
def test_what_falls_without_a_leap_before_it_moves_no_line(seen: str, share: float) -> None:
    """It took the lower part of the branch off the line, and with it the sight of what the sensor did there."""
    torque = GOOD.torque_out_nm.copy()
    for run in CALIBRATION:
        rows = np.concatenate([np.arange(piece.start, piece.stop) for piece in run.pieces])
        beyond = rows[run.direction * torque[rows] > 0.2 * PEAK_NM]
        lost, sizes = {
            "steps": (beyond, 1.0),
            "sags": (beyond[:50], np.sin(np.linspace(0.0, np.pi, beyond[:50].size))),
            "drops out": (beyond[:2], 1.0),
            "spikes": (beyond[:2], -1.0),
        }[seen]
        torque[lost] -= run.direction * share * PEAK_NM * sizes
    assert fitted(dataclasses.replace(GOOD, torque_out_nm=torque)).begins_nm == {}


@pytest.mark.parametrize("held", [3, 5, 8])
def test_a_noise_that_is_held_over_some_scans_is_no_bounce(held: int) -> None:
    """Its neighbours are alike, so its second differences show less of it than there is."""
    noise = np.random.default_rng(held).normal(0.0, 0.003 * PEAK_NM, GOOD.torque_out_nm.size // held + 1)
    held_nm = np.repeat(noise, held)[: GOOD.torque_out_nm.size]
    assert fitted(dataclasses.replace(GOOD, torque_out_nm=GOOD.torque_out_nm + held_nm)).begins_nm == {}


def test_noise_is_no_bounce_and_hides_none() -> None:
    """Of five times the noise of a good sensor 1 % is within reach: a line began at 30 % for it."""
    noise = np.random.default_rng(1).normal(0.0, 0.002 * PEAK_NM, GOOD.torque_out_nm.size)
    for trace, begins in ((GOOD, set()), (bounced(0.04, 0.14, 0.08), {"load_positive", "load_negative"})):
        noisy = dataclasses.replace(trace, torque_out_nm=trace.torque_out_nm + noise)
        assert set(fitted(noisy).begins_nm) == begins


def test_the_points_of_a_line_in_the_budget_are_those_that_it_was_fitted_to() -> None:
    """Of a calibration to a larger peak than the cycles have, a line began where the cycles end, and ran backwards."""
    conditions = conditions_of(measure(bounced(0.04, 0.14, 0.08), CONVERTED))
    for peak_nm in (PEAK_NM, 0.15 * PEAK_NM):
        points = dataclasses.replace(conditions, peak_nm=peak_nm).line_points
        for name in ("load_positive", "load_negative"):
            fitted_nm = conditions.quadrants.fits[name].outputs_nm
            ends = (float(one) for one in (np.abs(fitted_nm).min(), np.abs(fitted_nm).max()))
            assert np.abs(points[name].torque_nm[[0, -1]]) == pytest.approx(list(ends))
