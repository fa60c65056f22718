"""Numbers of things in words: one run, two runs."""

from __future__ import annotations


def counted(number: int, thing: str, things: str = "") -> str:
    """Return a number with what it counts; things: the plural, where it is not the singular with an s."""
    return f"{number} {thing if number == 1 else things or f'{thing}s'}"
