"""Order of the measurements of a study: each cell once, in blocks, random within them, and the same for the same seed.

In each trial every operator measures every part once before anybody begins the next trial, so that a slow drift of the
bench lies between the trials and not between the operators. Within a trial the operators follow each other in random
order, one after the other (blocks), and each measures the parts in a random order of their own: nobody expects the
value of the part before. Source: AIAG Measurement Systems Analysis, 4th edition, chapter III.

The order is that of SHA-256 over seed, trial, operator and part: whoever has the seed has the order, with any program.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import NamedTuple


class Cell(NamedTuple):
    """One measurement: part, operator, trial from 1."""

    part: str
    operator: str
    trial: int


def study_order(parts: Sequence[str], operators: Sequence[str], trials: int, seed: int) -> tuple[Cell, ...]:
    """Return every part by every operator in every trial, in the order in which they are measured.

    Args:
        parts: serial numbers, each once.
        operators: names, each once; ('',) where nobody is named.
        trials: how often each operator measures each part, 1 or more.
        seed: of the order.

    """
    found: list[Cell] = []
    for trial in range(1, trials + 1):
        for operator in sorted(operators, key=lambda one: _place(seed, trial, one, "")):
            block = [Cell(part, operator, trial) for part in parts]
            found += sorted(block, key=lambda one: _place(seed, one.trial, one.operator, one.part))
    return tuple(found)


def _place(seed: int, trial: int, operator: str, part: str) -> bytes:
    return hashlib.sha256(f"{seed}\n{trial}\n{operator}\n{part}".encode()).digest()
