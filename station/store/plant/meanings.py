"""What the metrics of a store mean: the texts that must be the same in two runs, or their values are not of one kind.

They stand once for all runs, under a number that is made of them: so it is the same whichever run comes first, and in a
store that was made anew.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterable
from functools import lru_cache
from itertools import product
from typing import NamedTuple

from sqlalchemy import ColumnElement, Connection, select

from analysis.metrics.former_wordings import wordings
from station.store.engine import StoreError
from station.store.tables import MEANINGS, METRICS, putting

AT_ONCE = 500
"""Meanings that one statement names."""

BYTES = 8
"""Of the hash that a number is made of; the sign is left free, as databases have no number without one."""


class Meaning(NamedTuple):
    """The texts of a metric that decide what its value is; the names are those of the columns.

    band, torque_nm: JSON. choices: the words of the choices.
    """

    metric: str
    choices: str
    branch: str
    definition: str
    estimator: str
    band: str
    torque_nm: str
    unit: str


WORDED = ("definition", "estimator")
"""What is in words for people, which become better."""


@lru_cache(maxsize=10_000)
def number_of(meaning: Meaning) -> int:
    """Return the number of a meaning."""
    text = json.dumps(list(meaning), ensure_ascii=False, separators=(",", ":"))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:BYTES], "big") >> 1


def numbers_of(meaning: Meaning) -> list[int]:
    """Return the numbers of all meanings that say the same, in the words of today or of before."""
    said = [wordings(text) if name in WORDED else (text,) for name, text in meaning._asdict().items()]
    return [number_of(Meaning(*texts)) for texts in product(*said)]


def meanings_of(connection: Connection, chain: str, **texts: str) -> dict[int, Meaning]:
    """Return all meanings of a data folder in which some texts, by their name, are these."""
    columns = [MEANINGS.c[name] for name in Meaning._fields]
    asked = select(MEANINGS.c.meaning, *columns).where(MEANINGS.c.chain == chain)
    for name, text in texts.items():
        asked = asked.where(MEANINGS.c[name] == text)
    return {row[0]: Meaning(*row[1:]) for row in connection.execute(asked.order_by(MEANINGS.c.meaning))}


def meaning_of_metrics() -> ColumnElement[bool]:
    """Return the condition that a row of MEANINGS is that of a row of METRICS."""
    found: ColumnElement[bool] = (MEANINGS.c.chain == METRICS.c.chain) & (MEANINGS.c.meaning == METRICS.c.meaning)
    return found


def put_meanings(connection: Connection, chain: str, meanings: Iterable[Meaning]) -> None:
    """Put meanings into a data folder's table where they are not there yet.

    Raises:
        StoreError: a number stands for other texts already. By chance that comes once in a thousand million million
            meanings; its values would be taken for those of another kind.

    """
    wanted = {number_of(one): one for one in meanings}
    if not wanted:
        return
    rows = [{"chain": chain, "meaning": number, **one._asdict()} for number, one in wanted.items()]
    connection.execute(putting(MEANINGS), rows)
    numbers = list(wanted)
    for begin in range(0, len(numbers), AT_ONCE):
        there = meanings_named(connection, chain, numbers[begin : begin + AT_ONCE])
        for number, one in there.items():
            if one != wanted[number]:
                raise StoreError(
                    f"the number {number} stands for two meanings of a metric: {one.metric} and "
                    f"{wanted[number].metric}. Their values are not put together; report it as an error of the program"
                )


def meanings_named(connection: Connection, chain: str, numbers: Collection[int]) -> dict[int, Meaning]:
    """Return the meanings of these numbers."""
    columns = [MEANINGS.c[name] for name in Meaning._fields]
    asked = select(MEANINGS.c.meaning, *columns).where(MEANINGS.c.chain == chain, MEANINGS.c.meaning.in_(numbers))
    return {row[0]: Meaning(*row[1:]) for row in connection.execute(asked)}
