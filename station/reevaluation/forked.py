"""What every process that evaluates begins with, loaded once by the server that they are forks of.

A process that is replaced then answers at once: modules, units and the hash of the program's files are there.
"""

from __future__ import annotations

from recipes import find_recipe, load_recipe, shipped_recipes
from station.reevaluation.evaluate_one import software_key
from station.results.evaluation import load_ahead

load_ahead()
READY = software_key(), load_recipe(find_recipe(next(iter(shipped_recipes()))))
"""Which program it is, and the units that recipes are read with."""
