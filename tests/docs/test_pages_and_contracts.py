"""The reference pages say what the tables of the code say."""

import re
from collections import Counter
from pathlib import Path
from typing import get_args

import pytest

from definitions.faults import FAULTS
from definitions.protections import WITHOUT_INTERLOCK
from docs import generate
from docs.option_pages import BENCH_SECTIONS, RECIPE_SECTIONS, RECIPE_STEPS
from docs.profile_page import KINDS, profile_options, sections
from recipes.schema.bench_schema import Bench
from recipes.schema.calibration_schema import FixturePoint
from recipes.schema.recipe_schema import Recipe
from recipes.text.section import Section
from station.cli import COMMANDS, command_line

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("page", sorted(generate.PAGES))
def test_page_is_up_to_date(page):
    written = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert written == generate.PAGES[page](), "run 'make docs'"


def test_the_page_of_the_command_line_has_every_command_once_and_in_the_order_of_the_help():
    page = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([^`]+)`(.*)", page.partition("\n## ")[0], re.MULTILINE)
    listed = [what.split()[0] for what, _ in rows]
    assert list(dict.fromkeys(listed)) == [name for commands in COMMANDS.values() for name in commands]
    groups = {name for name, command in command_line().commands.items() if hasattr(command, "commands")}
    assert {name for name, times in Counter(listed).items() if times > 1} <= groups, "one row for each of its commands"
    for group in ("study", "faults"):
        row = " ".join(what + rest for what, rest in rows if what.startswith(group))
        missing = [name for name in command_line().commands[group].commands if name not in row]
        assert missing == []


def sections_in(model: type[Section]) -> dict[type[Section], None]:
    """Return a section with all that stand in it, wherever."""
    found: dict[type[Section], None] = {model: None}
    waiting: list[object] = [field.annotation for field in model.model_fields.values()]
    while waiting:
        kind = waiting.pop()
        waiting += get_args(kind)
        if isinstance(kind, type) and issubclass(kind, Section) and kind not in found:
            found |= sections_in(kind)
    return found


@pytest.mark.parametrize(
    ("model", "shown"), [(Bench, BENCH_SECTIONS), (Recipe, RECIPE_SECTIONS | RECIPE_STEPS)], ids=["bench", "recipe"]
)
def test_every_section_of_a_file_is_on_the_page_of_its_options(
    model: type[Section], shown: dict[str, type[Section]]
) -> None:
    told_in_the_text_of_its_section = {FixturePoint}
    assert set(sections_in(model)) - {model} - told_in_the_text_of_its_section == set(shown.values())


def test_every_section_of_a_profile_is_on_the_page_of_its_options() -> None:
    titles = re.findall(r"^### (.*)$", profile_options(), re.MULTILINE)
    for model, shipped in KINDS.values():
        assert {where for _, where in sections(model)} <= set(titles)
        assert (ROOT / "drivers" / "profiles" / shipped).is_file()
    assert "read_also (each)" in titles


def test_the_readme_counts_the_interlocks_of_the_table() -> None:
    readme = (ROOT / "README.md").read_text("utf-8")
    assert re.findall(r"\*\*(\d+) interlocks\*\*", readme) == [str(sum(1 for fault in FAULTS if fault.live_in))]


def test_the_page_on_safety_says_of_every_interlock_what_proves_it_and_what_is_left_without_it() -> None:
    assert list(WITHOUT_INTERLOCK) == [fault.id for fault in FAULTS if fault.live_in]
    rows = [line.split(" | ") for line in generate.safety().splitlines() if line.startswith("| `")]
    assert {row[0].partition(":")[0].strip("| `") for row in rows} >= set(WITHOUT_INTERLOCK)
    assert all(cell.strip() for row in rows for cell in row)
