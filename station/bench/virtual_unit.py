"""What is on the virtual bench in a run: the unit by its name, the values of its model, and the seed of the noise.

Kept apart from what assembles the bench: a real bench has none of it, and this brings no physics.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass

from virtual_bench.config import Catalogue

FIXED_SEED = 1
"""Seed of runs that are compared with one another, and not repeated: fault matrix, exits, tests."""

NOT_NAMED = "not named"
"""Name of the unit on a virtual bench that was started by itself and has not said which one it serves."""

SEEDS = 1_000_000_000
"""Seeds that are drawn are below this: short enough to be typed again."""


@dataclass(frozen=True)
class VirtualUnit:
    """The unit on a virtual bench; `name` is NAME[:SEED], `seed` that of the noise of the bench's sensors."""

    name: str
    seed: int
    catalogue: Catalogue | None = None

    def __str__(self) -> str:
        return self.name


def drawn_seed() -> int:
    """Return a seed that nobody has chosen."""
    return secrets.randbelow(SEEDS)
