"""From `NAME` or `NAME:SEED` to the unit on the virtual bench: one of the table, or one made from a model's values."""

from __future__ import annotations

import difflib

from virtual_bench.config import Catalogue
from virtual_bench.errors import VirtualBenchError
from virtual_bench.physics.catalogue_units import CATALOGUE, VARIANTS, catalogue_unit
from virtual_bench.physics.units import UNITS, Unit, vary

DEFAULT_UNITS: dict[str, str] = {"RV-40E-121": "P1", "RV-50": "S50"}
"""The unit that is on the bench when nobody names one, by the recipe's model; for others one is made."""


def default_unit(model: str) -> str:
    """Return the name of the good unit for `model`."""
    return DEFAULT_UNITS.get(model, CATALOGUE)


def units_of(model: str) -> tuple[str, ...]:
    """Return the names of the units of a model: those of the table, and those that are made from its values."""
    return (*(name for name, unit in UNITS.items() if unit.model == model), *VARIANTS)


def find_unit(text: str, catalogue: Catalogue | None = None) -> Unit:
    """Return the unit written `NAME` or `NAME:SEED`; unknown names and bad seeds raise `VirtualBenchError`."""
    name, colon, seed_text = text.partition(":")
    allowed = [*UNITS, *VARIANTS]
    if name not in allowed:
        near = difflib.get_close_matches(name, allowed, n=2, cutoff=0.3)
        nearest = f"; nearest: {', '.join(near)}" if near else ""
        raise VirtualBenchError(f"--unit: found {name!r}, allowed {', '.join(allowed)}{nearest}")
    if name in UNITS:
        unit = UNITS[name]
    elif catalogue is None:
        raise VirtualBenchError(
            f"--unit: found {name!r}, which needs a recipe for its values. Give a recipe, or one of: {', '.join(UNITS)}"
        )
    else:
        unit = catalogue_unit(name, catalogue)
    if not colon:
        return unit
    if not (seed_text.isascii() and seed_text.isdigit()):
        raise VirtualBenchError(
            f"--unit {text}: found seed {seed_text!r}, allowed a whole number from 0, as in {name}:7"
        )
    return vary(unit, int(seed_text))
