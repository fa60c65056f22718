"""Lets the tests of the controller share their bench model and programs."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
