"""The reference pages say what the tables of the code say."""

import importlib.util
import tomllib
from pathlib import Path

import pytest

from station.cli import app

ROOT = Path(__file__).parents[2]
SPEC = importlib.util.spec_from_file_location("generate", ROOT / "docs" / "generate.py")
generate = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(generate)


@pytest.mark.parametrize("page", sorted(generate.PAGES))
def test_page_is_up_to_date(page):
    written = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert written == generate.PAGES[page](), "run 'make docs'"


def test_drivers_are_kept_from_every_module_of_the_controller_but_the_image():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    (contract,) = [item for item in contracts if item["name"] == "Drivers know the process image only"]
    modules = {f"controller.{path.stem}" for path in (ROOT / "controller").glob("*.py")}
    assert modules - {"controller.__init__", "controller.image"} <= set(contract["forbidden_modules"])


def test_every_command_is_on_the_page_of_the_command_line():
    page = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")
    names = [info.name or info.callback.__name__.replace("_", "-") for info in app.registered_commands]
    missing = [name for name in names if f"`{name}" not in page]
    assert missing == []
