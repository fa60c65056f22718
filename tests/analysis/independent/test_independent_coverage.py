"""U of what is read off the branches holds for units of which neither bench nor analysis knows, and none is refused."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.simulated.coverage import CoverageRow
from benchmarks.simulated.kinds import KINDS
from benchmarks.simulated.types_of_units import rows_by_type

METRICS = (
    "backlash_width_3pct",
    "lost_motion",
    "stiffness_50_100 load",
    "stiffness_50_100 mean",
    "stiffness_lsq",
    "spring_constant",
    "windup",
    "hysteresis_energy",
)
UNITS = 48


@pytest.fixture(scope="module")
def found() -> tuple[dict[str, list[CoverageRow]], dict[str, int]]:
    return rows_by_type(UNITS, METRICS)


def test_uncertainty_holds_for_every_metric(found: tuple[dict[str, list[CoverageRow]], dict[str, int]]) -> None:
    """Of all types together: of 48 units with 95 % each, more than 88 % are within U."""
    rows, _ = found
    for number, metric in enumerate(METRICS):
        assert np.mean([rows[kind][number].covered for kind in KINDS]) > 0.88, metric


def test_uncertainty_holds_for_every_type(found: tuple[dict[str, list[CoverageRow]], dict[str, int]]) -> None:
    """A mask that was all or nothing had the mean stiffness of the soft type in none of its units."""
    rows, _ = found
    for kind, of in rows.items():
        for row in of:
            assert row.covered > 0.5, (kind, row.metric)
            assert abs(row.bias) < row.expanded, (kind, row.metric)


def test_no_good_unit_is_refused(found: tuple[dict[str, list[CoverageRow]], dict[str, int]]) -> None:
    assert found[1] == {}
