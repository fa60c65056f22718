"""Shipped recipes with another rule of decision."""

from __future__ import annotations

from pathlib import Path

from recipes import find_recipe


def simple_acceptance(folder: Path, name: str) -> str:
    """Return a copy of a shipped recipe that compares the value itself: of a trace whose sensors nobody knows."""
    text = find_recipe(name).read_text("utf-8")
    assert text.count("rule: guard_band") == 1
    path = folder / f"{name}-simple.yaml"
    path.write_text(text.replace("rule: guard_band", "rule: simple"), encoding="utf-8")
    return str(path)
