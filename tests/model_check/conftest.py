"""Lets the model check be imported by its test, with the bench of the controller's timelines."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "controller")]
