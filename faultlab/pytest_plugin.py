"""pytest plug-in: the fixture `bench`, on which a plant writes its own tests of faults and reactions.

Installed with the package. The bench runs in virtual time with the recipe of the test's marker:

    @pytest.mark.lostmotion(recipe="my-recipe.yaml", bench="my-bench.yaml", unit="P1", seed=1)
    def test_guard_in_a_ramp(bench):
        bench.until(state="ramp_pos", after_scans=300)
        bench.inject("io.guard", "open")
        bench.expect(event="guard_open", within_scans=12)
        bench.expect(order="quick_stop", within_scans=0)
        bench.expect(final_state="fault")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from faultlab.bench_under_test import BenchUnderTest


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> BenchUnderTest:
    """Return a virtual bench with a run that has not begun yet; see the module's text."""
    from faultlab.bench_under_test import BenchUnderTest  # noqa: PLC0415 - brings numba; pytest loads this for all

    marker = request.node.get_closest_marker("lostmotion")
    return BenchUnderTest(**({} if marker is None else marker.kwargs))


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    config.addinivalue_line("markers", "lostmotion(recipe, bench, unit, seed): what the fixture `bench` runs")
