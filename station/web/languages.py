"""Languages of the pages: gettext catalogues in `locale/`, one a language; English is what the program says itself.

What a page shows comes from several rooms, from answers and from records that were written long ago, all in English. So
a text is looked up as it stands, and where it holds values, by the message whose place holders leave the rest of it:
"Unit {serial} failed." also translates "Unit SN-1 failed.". A place holder may hold another message, such as the reason
of a refusal, which is looked up too. What no catalogue has stays English, and is never guessed.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

from babel.messages.pofile import read_po

HERE = Path(__file__).parent / "locale"
ENGLISH = "en"
LANGUAGES = {ENGLISH: "English", "de": "Deutsch", "zh": "中文"}
COOKIE = "lostmotion_language"
DECIMAL_SIGNS = {"de": ","}
FULL_WIDTH = {"zh": str.maketrans(",;:.", "，；：。")}
"""Marks between parts of a sentence, by the languages that write them as wide as a sign and without a blank."""
HOLDER = re.compile(r"\{(\w+)\}")
COUNT = "count"
"""The place holder of a whole number: '{count} runs.' is no sentence that merely ends so."""
FILE = "file"
"""The place holder of the name of a file in a record: one word, and never the sentence before it."""


class _Pattern(NamedTuple):
    """A message with place holders: what it matches, and what it becomes."""

    match: re.Pattern[str]
    becomes: str


class Words:
    """What a page says, in one language."""

    def __init__(self, language: str) -> None:
        """Read the catalogue of a language of `LANGUAGES`; any other one is English."""
        self.language = language if language in LANGUAGES else ENGLISH
        self._texts = messages(self.language)
        # The longest first: of two that match, the one with more words of its own says more.
        rows = sorted(self._texts.items(), key=lambda row: -len(HOLDER.sub("", row[0])))
        self._patterns = [_Pattern(_matching(text), becomes) for text, becomes in rows if HOLDER.search(text)]

    def __call__(self, text: str, **values: object) -> str:
        """Return a text in this language; values: of its place holders, where it is given with them."""
        if values:
            return HOLDER.sub(lambda found: str(values[found[1]]), self._texts.get(text, text))
        return self._found(text, self._held)

    def _held(self, text: str) -> str:
        """Return what a place holder holds: a message has several words, and what has one may be anybody's name."""
        return self._found(text, str) if " " in text else text

    def _found(self, text: str, held: Callable[[str], str]) -> str:
        """Return a text as a catalogue has it; held: gives what is written for what its place holders hold."""
        there = self._texts.get(text)
        if there is not None:
            return there
        found = ((one, one.match.fullmatch(text)) for one in self._patterns)
        one, match = next(((one, match) for one, match in found if match is not None), (None, None))
        if one is None or match is None:
            return text
        parts = match.groupdict()
        return HOLDER.sub(lambda holder: held(parts[holder[1]]), one.becomes)

    def counted(self, number: int, one: str, more: str, **values: object) -> str:
        """Return the message for one thing or the one for several, in which the number is `{count}`."""
        return self(one if number == 1 else more, count=number, **values)

    def number(self, text: str) -> str:
        """Return the figures of a text as this language writes them: with its decimal sign."""
        sign = DECIMAL_SIGNS.get(self.language, ".")
        return text if sign == "." else re.sub(r"(?<=\d)\.(?=\d)", sign, text)

    def whole(self, text: str) -> str:
        """Return what was put together of several messages, with the marks of this language between them."""
        wide = FULL_WIDTH.get(self.language)
        if wide is None:
            return text
        text = re.sub(r"(?<=[\u4e00-\u9fff])[,;:.](?= |$)", lambda found: found[0].translate(wide), text)
        return re.sub(r"(?<=[，；：。]) +", "", text)


@cache
def words_of(language: str) -> Words:
    """Return the words of a language, read once."""
    return Words(language)


def messages(language: str) -> dict[str, str]:
    """Return the messages of a language by their English text; none for English."""
    if language == ENGLISH:
        return {}
    with (HERE / f"{language}.po").open("rb") as file:
        catalogue = read_po(file, locale=language)
    return {str(one.id): str(one.string) for one in catalogue if one.id and one.string}


def _matching(text: str) -> re.Pattern[str]:
    parts = HOLDER.split(text)
    held = {COUNT: r"\d+", FILE: r"\S+"}
    made = (f"(?P<{one}>{held.get(one, '.+?')})" if place % 2 else re.escape(one) for place, one in enumerate(parts))
    return re.compile("".join(made), re.DOTALL)
