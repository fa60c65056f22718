"""The reference pages say what the tables of the code say."""

import re
from collections import Counter
from pathlib import Path

import pytest
from typer.main import get_command

from docs import generate
from station.cli import COMMANDS, app

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
    assert [name for name, times in Counter(listed).items() if times > 1] == ["faults"]
    for group in ("study", "faults"):
        row = " ".join(what + rest for what, rest in rows if what.startswith(group))
        missing = [name for name in get_command(app).commands[group].commands if name not in row]
        assert missing == []
