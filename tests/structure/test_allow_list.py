"""What a package may import is a list, and what is not on it is named with its place."""

import re
import tomllib
from pathlib import Path

from allow_list import refused_imports, refused_reach
from grimp import ImportGraph

ROOT = Path(__file__).parents[2]
MOST_FILES = 15
"""Files side by side in a room; more want another room, or a reason."""


def graph_of(*imports):
    graph = ImportGraph()
    for importer, imported in imports:
        graph.add_import(importer=importer, imported=imported, line_number=7, line_contents="")
    return graph


def test_what_is_not_on_the_list_is_named_with_its_place():
    graph = graph_of(
        ("analysis.trace", "numpy"), ("analysis.trace", "station.run"), ("analysis.trace", "analysis.loop")
    )
    graph.add_module("analysis")
    assert refused_imports(graph, "analysis", {"analysis", "numpy"}) == [("analysis.trace", "station.run", 7)]


def test_a_name_that_only_begins_alike_is_not_allowed():
    graph = graph_of(("analysis.trace", "numpydoc"))
    graph.add_module("analysis")
    assert refused_imports(graph, "analysis", {"analysis", "numpy"}) == [("analysis.trace", "numpydoc", 7)]


def test_a_room_apart_has_a_list_of_its_own():
    graph = graph_of(("station.cli.faults", "faultlab"), ("station.run", "faultlab"))
    graph.add_module("station")
    assert refused_imports(graph, "station", {"station"}, {"station.cli.faults"}) == [("station.run", "faultlab", 7)]


def test_what_a_process_brings_with_it_is_followed_to_its_end():
    graph = graph_of(
        ("station.scan", "drivers.bus"),
        ("drivers.bus", "can"),
        ("drivers.bus", "station.scan"),
        ("drivers", "pydantic"),
        ("drivers.other", "numpy"),
        ("station", "recipes"),
    )
    ours = {"station.scan", "can"}
    refused = [("drivers", "pydantic", 7), ("station", "recipes", 7)]
    assert refused_reach(graph, {"station.scan"}, {*ours, "drivers"}) == refused
    refused = [("station", "recipes", 7), ("station.scan", "drivers.bus", 7)]
    assert refused_reach(graph, {"station.scan"}, ours) == refused


def test_every_package_has_a_list():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    config = project["tool"]["importlinter"]
    lists = {one["package"] for one in config["contracts"] if one["type"] == "allow_list"}
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"benchmarks", "docs"}
    assert packages == lists == set(config["root_packages"])


def rooms_of_the_analysis():
    return [path for path in sorted((ROOT / "analysis").iterdir()) if (path / "__init__.py").is_file()]


def test_every_room_of_the_analysis_stands_in_the_contract_of_its_order():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    (order,) = [item for item in contracts if item.get("containers") == ["analysis"]]
    named = {room for layer in order["layers"] for room in re.split(r"[ :|]+", layer)}
    assert named == {path.name for path in rooms_of_the_analysis()}


def test_a_room_of_the_analysis_has_few_files_and_hands_nothing_on():
    for path in rooms_of_the_analysis():
        assert len(list(path.glob("*.py"))) <= MOST_FILES, path
        assert "import" not in (path / "__init__.py").read_text(encoding="utf-8"), path
    assert [path.name for path in (ROOT / "analysis").glob("*.py")] == ["__init__.py"]
