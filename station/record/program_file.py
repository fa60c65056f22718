"""The program of a run as it is stored in program.json, and where another program differs from it."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from controller.program import Program

PROGRAM = "program.json"


def plain_program(program: Program) -> dict[str, Any]:
    """Return a program as plain data; infinities are None: JSON has no other way to say that there is no limit."""
    plain: dict[str, Any] = _plain(asdict(program))
    return plain


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def program_differences(recorded: Any, program: Program) -> list[str]:
    """Return where a program differs from a recorded one, one text for each place."""
    return list(_walk("program", recorded, plain_program(program)))


def _walk(path: str, before: Any, now: Any) -> list[str]:
    if isinstance(before, dict) and isinstance(now, dict):
        keys = dict.fromkeys((*before, *now))
        return [text for key in keys for text in _walk(f"{path}.{key}", before.get(key), now.get(key))]
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = enumerate(zip(before, now, strict=True))
        return [text for index, (a, b) in pairs for text in _walk(f"{path}[{index}]", a, b)]
    return [] if before == now else [f"{path}: recorded {_short(before)}, now {_short(now)}"]


def _short(value: Any) -> str:
    return f"{len(value)} entries" if isinstance(value, list) else str(value)
