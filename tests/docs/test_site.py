"""The site builds without a warning, the tutorial happens as it is written, and every command on a page exists."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from docs.site import tutorial
from docs.site.build import build
from station.cli import command_line

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(DOCS.glob("**/*.md"))
FENCE = re.compile(r"^ *```(?:console)?\n(.*?)^ *```$", re.DOTALL | re.MULTILINE)
PROMPT = re.compile(r"^\s*(?:\$ )?(?:sudo -u \w+ )?(?=lostmotion )")
FROM_ELSEWHERE = ("http://", "https://", "//")


class Fetched(HTMLParser):
    """What a browser fetches by itself for a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag in {"script", "img", "iframe"} or (tag == "link" and given.get("rel") != "canonical"):
            self.addresses.append(given.get("src") or given.get("href") or "")


def test_the_site_builds_without_a_warning_and_fetches_nothing_from_elsewhere(tmp_path: Path) -> None:
    out = tmp_path / "site"
    assert build(out) == 0
    pages = sorted(out.glob("**/*.html"))
    missing = [page for page in PAGES if not (out / page.relative_to(DOCS).with_suffix(".html")).is_file()]
    assert missing == []
    for page in pages:
        fetched = Fetched(page.read_text(encoding="utf-8")).addresses
        assert [one for one in fetched if one.startswith(FROM_ELSEWHERE)] == [], page.name
    assert 'class="mermaid"' in (out / "states.html").read_text(encoding="utf-8")
    assert (out / "_static" / "mermaid" / "index.js").is_file(), "diagrams are drawn by a file of the site"
    for folder in ("howto", "schema"):
        assert (DOCS / folder).is_dir()
    assert list(out.glob("_downloads/*/result.json")), "a program gets the schemas from the site too"


def test_the_tutorial_happens_as_it_is_written(tmp_path: Path) -> None:
    assert tutorial.run(tmp_path / "tutorial") == 9


@pytest.mark.parametrize(
    ("shown", "printed", "difference"),
    [
        (("a", "b"), ["a", "b  "], ""),
        (("…", "b"), ["x", "y", "b"], ""),
        (("a", "…"), ["a", "x"], ""),
        (("of 20260131T080000.000Z-T-001",), ["of 20261125T223415.292Z-T-001"], ""),
        (("PASS",), ["FAIL"], "the page shows: PASS\nthere was:      FAIL"),
        (("…", "PASS", "…"), ["x", "FAIL"], "the page shows: PASS\nthere was:      nothing like it"),
        (("a",), ["a", "Error"], "the page shows no more, but there was: Error"),
        (("a", "b"), ["a"], "the page shows: b\nthere was:      the end"),
        ((), ["Error"], "the page shows no more, but there was: Error"),
    ],
)
def test_what_a_command_prints_is_compared_with_the_page(
    shown: tuple[str, ...], printed: list[str], difference: str
) -> None:
    assert tutorial.compare(shown, printed) == difference


def test_a_tutorial_that_says_otherwise_is_told_with_what_was_printed(tmp_path: Path) -> None:
    page = tmp_path / "wrong.md"
    page.write_text("```console\n$ echo PASS; false\nPASS\n$ echo $?\n0\n```\n", encoding="utf-8")
    with pytest.raises(tutorial.TutorialError, match=r"wrong.md: \$ echo \$\?\nthe page shows: 0\nthere was:      1"):
        tutorial.run(tmp_path / "scratch", page)


def commands_on(page: Path) -> Iterator[str]:
    for found in FENCE.finditer(page.read_text(encoding="utf-8")):
        for line in found.group(1).replace("\\\n", " ").splitlines():
            if PROMPT.match(line):
                yield PROMPT.sub("", line)


def wrong_with(line: str) -> str:
    """Return what is wrong with a command line: a command or an option that there is not."""
    words = shlex.split(line, comments=True)[1:]
    command: Any = command_line()
    while hasattr(command, "commands"):
        word = next((one for one in words if not one.startswith("-")), "")
        skipped = words[: words.index(word)] if word else words
        words = words[len(skipped) + 1 :]
        if word in {"URL", "COMMAND", "…", "..."} or not word:
            return ""
        if word not in command.commands:
            return f"{line}: there is no command {word}"
        command = command.commands[word]
    options = {name for one in command.params for name in (*one.opts, *one.secondary_opts)} | {"--help", "-h"}
    unknown = [one for one in words if re.match("--[a-z]", one) and one.split("=")[0] not in options]
    return f"{line}: there is no option {unknown[0]}" if unknown else ""


@pytest.mark.parametrize("page", [*PAGES, DOCS.parent / "README.md"], ids=lambda page: page.stem)
def test_every_command_on_a_page_is_one_that_there_is(page: Path) -> None:
    assert [wrong for line in commands_on(page) if (wrong := wrong_with(line))] == []


def test_the_search_for_commands_finds_them_and_what_is_wrong() -> None:
    assert sum(1 for page in PAGES for _ in commands_on(page)) > 60
    assert "no command quallity" in wrong_with("lostmotion quallity yield")
    assert "no command yeild" in wrong_with("lostmotion quality yeild --by month")
    assert "no option --serials" in wrong_with("lostmotion run R --serials SN")


OF_REAL_UNITS = [
    page for page in PAGES if page.parent.name == "howto" and "lostmotion quality " in page.read_text("utf-8")
]


@pytest.mark.parametrize("page", OF_REAL_UNITS, ids=lambda page: page.stem)
def test_a_how_to_whose_commands_pass_over_virtual_units_says_how_they_are_asked(page: Path) -> None:
    """Whoever comes from the tutorial has no others, and every command of quality is refused without it."""
    assert re.search(r"`--virtual`.*tutorial\.md|tutorial\.md.*`--virtual`", page.read_text("utf-8"))
