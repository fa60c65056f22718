"""A folder reads like a table of contents: more modules side by side than that have a stated reason."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("definitions", "recipes", "controller", "drivers", "virtual_bench", "analysis", "station", "faultlab")
MOST = 15
REASON = "Side by side"
"""How the reason begins, in the docstring of the package."""

FOLDERS = sorted(path.parent for room in (*ROOMS, "benchmarks") for path in (ROOT / room).rglob("__init__.py"))


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.relative_to(ROOT).as_posix())
def test_a_long_folder_says_why(folder):
    modules = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
    assert len(modules) <= MOST or REASON in (folder / "__init__.py").read_text("utf-8")
