"""pytest plug-in: the fixture `lostmotion_bench`, on which a plant writes its own tests of faults and reactions.

Installed with the package, so it is there in every test of that environment: its name is one that nobody else takes.
The bench runs in virtual time with the recipe of the test's marker:

    @pytest.mark.lostmotion(recipe="my-recipe.yaml", bench="my-bench.yaml", unit="P1", seed=1)
    def test_guard_in_a_ramp(lostmotion_bench):
        lostmotion_bench.until(state="ramp_pos", after_scans=300)
        lostmotion_bench.inject("io.guard", "open")
        lostmotion_bench.expect(event="guard_open", within_scans=12)
        lostmotion_bench.expect(reaction="quick_stop", within_scans=0)
        lostmotion_bench.expect(final_state="fault")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from faultlab.bench_under_test import BenchUnderTest

OPTIONS = ("recipe", "bench", "unit", "seed")
"""What the marker may say, each by its name."""


@pytest.fixture
def lostmotion_bench(request: pytest.FixtureRequest) -> BenchUnderTest:
    """Return a virtual bench with a run that has not begun yet; see the module's text."""
    from faultlab.bench_under_test import BenchUnderTest  # noqa: PLC0415 - brings the virtual bench; pytest loads this for all
    from recipes import RecipeError  # noqa: PLC0415 - the same
    from station.errors import StationError  # noqa: PLC0415 - the same
    from virtual_bench.errors import VirtualBenchError  # noqa: PLC0415 - the same

    options = _options(request.node.get_closest_marker("lostmotion"))
    try:
        return BenchUnderTest(**options)
    except (RecipeError, StationError, VirtualBenchError) as error:
        refused = str(error)
    pytest.fail(refused, pytrace=False)


def _options(marker: pytest.Mark | None) -> dict[str, Any]:
    """Return what a marker says; one that cannot be followed as it stands fails its test."""
    if marker is None:
        return {}
    wrong = [repr(value) for value in marker.args] + [repr(name) for name in marker.kwargs if name not in OPTIONS]
    if wrong:
        allowed = f"{', '.join(OPTIONS[:-1])} or {OPTIONS[-1]}, each as NAME=VALUE"
        pytest.fail(f"pytest.mark.lostmotion: found {', '.join(wrong)}; allowed: {allowed}", pytrace=False)
    return dict(marker.kwargs)


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    text = "lostmotion(recipe, bench, unit, seed): what the fixture `lostmotion_bench` runs"
    config.addinivalue_line("markers", text)
