"""The protocol of a commissioning, as JSON beside the bench file: what was done, when, by whom, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from station.documents.entries import Number


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A figure that a step has measured; `unit` is empty for counts and words."""

    name: str
    value: Number | str
    unit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What a step has found, and what to do about it. `refuses`: the step has not passed because of it."""

    what: str
    cure: str
    refuses: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class StepDone:
    """A step that was done. `parts`: the entries of bench file and profiles that it depends on, as they were."""

    step: str
    passed: bool
    when: str
    by: str
    software: str
    bench_sha256: str
    figures: tuple[Figure, ...] = ()
    findings: tuple[Finding, ...] = ()
    parts: Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Protocol:
    """Every step that was done on a bench, the newest last; nothing is taken out."""

    format: int = 1
    bench: str
    steps: tuple[StepDone, ...] = ()
