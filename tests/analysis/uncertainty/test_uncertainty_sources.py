"""Error sources and their distributions: the tables, the draws, and the rounding of an encoder."""

import dataclasses
import math

import numpy as np
import pytest
from budget_support import CERTIFIED, METHOD, QUIET
from reference_unit import FIGURES

from analysis.loop.measured import measure
from analysis.trace.errors import AnalysisError
from analysis.uncertainty.conditions import Points, conditions_of
from analysis.uncertainty.distributions import DISTRIBUTIONS
from analysis.uncertainty.figures import AngleFigures, LineCovariance, SensorFigures, TorqueFigures
from analysis.uncertainty.shapes import ROUNDINGS, Setting
from analysis.uncertainty.sources import SOURCES
from definitions.units import ARCMIN_PER_RAD


def test_tables_are_complete() -> None:
    ids = [source.id for source in SOURCES]
    assert len(ids) == len(set(ids))
    for source in SOURCES:
        assert {source.distribution(figures) for figures in (FIGURES, CERTIFIED, SensorFigures())} <= set(DISTRIBUTIONS)
        assert source.text
        assert source.unit
        assert source.shapes


@pytest.mark.parametrize("name", list(DISTRIBUTIONS))
def test_draws_have_the_standard_uncertainty_of_their_distribution(name: str) -> None:
    row = DISTRIBUTIONS[name]
    components = {"cyclic": 2, "quantised": ROUNDINGS}.get(name, 1)
    drawn = row.draw(np.random.default_rng(5), 3.0, 200_000, components)
    assert drawn.shape == (200_000, components)
    assert drawn.std(axis=0) == pytest.approx(3.0 / row.divisor, rel=0.01)


def rounding_between(counts: float, figures: SensorFigures) -> float:
    """Standard deviation, in counts, of the rounding of two places of the locked shaft that are so far apart."""
    step_nm = FIGURES.angle_out.step_rad * ARCMIN_PER_RAD * METHOD.fixture_stiffness_nm_per_arcmin
    torque = np.array([0.0, counts * step_nm])
    points = Points(torque, torque / 100.0, 1, None, 0.0, None, 0.0)
    setting = Setting(points, conditions_of(measure(QUIET, METHOD)), figures)
    (source,) = [one for one in SOURCES if one.id == "angle_out_step"]
    apart = [np.diff(shape(setting).angle_arcmin)[0] * 60.0 for shape in source.shapes]
    return math.hypot(*apart) / math.sqrt(12.0)


EXACT_SHAFT = dataclasses.replace(
    FIGURES, angle_out=dataclasses.replace(FIGURES.angle_out, interpolation_rad=0.0), fixture_fraction=0.0
)


@pytest.mark.parametrize("counts", [0.0, 0.25, 0.5, 0.75, 1.0, 16.0, 16.25])
def test_two_readings_of_an_encoder_differ_by_its_rounding(counts: float) -> None:
    """Two places so many counts apart, anywhere on the scale: rounding makes d or d - 1 of a distance of d counts."""
    part = counts % 1.0
    assert rounding_between(counts, EXACT_SHAFT) == pytest.approx(math.sqrt(part * (1.0 - part)), rel=0.12, abs=1e-6)


@pytest.mark.parametrize("without", ["interpolation", "fixture"])
def test_places_some_counts_apart_are_not_rounded_alike(without: str) -> None:
    """Found by the coverage study: 206 and 412 N·m are eight counts apart, and the error within a line moves them."""
    encoder = dataclasses.replace(FIGURES.angle_out, interpolation_rad=math.radians(0.5 / 3600.0))
    figures = dataclasses.replace(FIGURES, angle_out=encoder, fixture_fraction=0.0)
    if without == "interpolation":
        figures = dataclasses.replace(EXACT_SHAFT, fixture_fraction=0.05)
    assert rounding_between(16.0, figures) == pytest.approx(math.sqrt(1.0 / 6.0), rel=0.35)
    assert rounding_between(0.0, figures) == 0.0


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: TorqueFigures(0.0),
        lambda: TorqueFigures(5.0, gain_fraction=-1e-3),
        lambda: AngleFigures(math.nan),
        lambda: LineCovariance(0.1, 0.1, 1.5),
        lambda: SensorFigures(skew_s=-1e-3),
        lambda: TorqueFigures(5.0, stated_by="hearsay"),
    ],
)
def test_figures_that_make_no_sense_are_refused(wrong: object) -> None:
    with pytest.raises(AnalysisError, match="found"):
        wrong()
