"""Lets the pages be made by their test, from any folder."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
