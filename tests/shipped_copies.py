"""Shipped recipes with another rule of decision, or with fewer scans."""

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


def at_4_ms(folder: Path, name: str) -> str:
    """Return a copy of a shipped recipe with a period of 4 ms: a quarter of the scans, and all else as shipped."""
    text = find_recipe(name).read_text("utf-8")
    assert text.count("\n  period: 1 ms\n") == 1
    path = folder / f"{name}.yaml"
    path.write_text(text.replace("\n  period: 1 ms\n", "\n  period: 4 ms\n"), encoding="utf-8")
    return str(path)
