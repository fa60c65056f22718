"""The plan of a guided study: what is measured, on what, by whom, how often and in which order.

It stands in the first line of the study's file (`records.studies`) and never changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from station.documents.entries import Count, Number, left_out, one_of
from station.documents.manifest import CountFrom1, Finite, Large, Name, PathText

TYPE_ONE, GAGE = "type1", "gage"
KINDS = (TYPE_ONE, GAGE)
CALLED = {TYPE_ONE: "type 1", GAGE: "gage"}
"""How a study of each kind is called: a type 1 study, a gage study."""

StudyKind = Annotated[str, one_of(*KINDS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyMetric:
    """A metric that is judged, in its own unit: known value of the part in a type 1 study, and the tolerance.

    tolerance: upper minus lower limit; None: that of the recipe.
    """

    id: Name
    reference: Finite | None = left_out()
    tolerance: Finite | None = left_out()


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyCell:
    """One measurement of the plan: part by its serial number, operator ('' where nobody is named), trial from 1."""

    part: Name
    operator: str
    trial: CountFrom1

    def __str__(self) -> str:
        by = f", operator {self.operator}" if self.operator else ""
        return f"unit {self.part}{by}, trial {self.trial}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyPlan:
    """A study: recipe and bench by the hash of their files, and every measurement in its order.

    units: on the virtual bench, the virtual unit of each part. seed: of the order. share: of the tolerance, in %.
    """

    kind: StudyKind
    metrics: tuple[StudyMetric, ...]
    recipe: Name
    revision: Count
    recipe_file: PathText
    recipe_sha256: str
    bench: Name
    bench_file: PathText
    bench_sha256: str
    virtual: bool
    parts: tuple[Name, ...]
    units: Mapping[str, str]
    operators: tuple[Name, ...]
    trials: CountFrom1
    share: Number
    seed: Large
    order: tuple[StudyCell, ...]
