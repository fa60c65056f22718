"""Where the published tables and curves are."""

from pathlib import Path

DATA = Path(__file__).parent.parent / "data"
