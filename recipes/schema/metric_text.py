"""A metric in one line of text, as the command line takes it: what an entry of `metrics` in a recipe says.

`stiffness_at torque=50 % branch=load` is `{id: stiffness_at, torque: 50 %, branch: load}`, read by the same schema.
Limits are not among it: what decides stands in a recipe, which has a name, a revision and a fingerprint.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from recipes.loader import load_source
from recipes.schema.metric_schema import MetricWanted
from recipes.text.document import Mark, Source
from recipes.text.problems import Problem, RecipeError, excerpt, one_of
from recipes.text.translation import options_at

OPTION = re.compile(r"(?:^|\s)([^\s=]+)\s*=")
NOWHERE = Mark(0, 0, 0, 0)
"""Place of what stands in no file."""
LIMITS = ("min", "max")
EXAMPLE = "stiffness_at torque=50% branch=load"


def read_metric(text: str, place: str, percentages: Mapping[str, float]) -> MetricWanted:
    """Return the metric that a text asks for.

    place: what messages call the text's place, `--metric`. percentages: what 100 % stands for, by the keys of
    `recipes.text.section`. Raises RecipeError with all that is wrong with it.
    """
    path = f"{place} {excerpt(text)}"
    data: dict[str, str] = {}
    problems: list[Problem] = []
    for name, value in _options(text):
        if name == "":
            found = f"{excerpt(value)} without the name of its option"
            allowed = f"the metric, then option=value with {one_of(_free_options())}"
            problems.append(Problem(path, 0, 0, "", found, allowed, f"Write it as in '{EXAMPLE}'."))
        elif name in data:
            problems.append(Problem(path, 0, 0, name, f"{name} a second time", "each option once", "Delete one."))
        elif name in LIMITS:
            allowed = "the limits of the recipe, which hold for the same definition"
            hint = "Write it in a recipe and name that with --recipe: what decides has a name and a revision."
            problems.append(Problem(path, 0, 0, name, f"a limit, {excerpt(value)}", allowed, hint))
        else:
            data[name] = value
    source = Source(path, data, {(): NOWHERE, **{(name,): NOWHERE for name in data}}, tuple(problems))
    return load_source(source, MetricWanted, percentages)


def twice(text: str, place: str) -> RecipeError:
    """Return the refusal of a definition that is asked for a second time."""
    return RecipeError([Problem(f"{place} {excerpt(text)}", 0, 0, "", "it a second time", "each metric once",
                                "Delete one of the two.")])  # fmt: skip


def _options(text: str) -> Iterator[tuple[str, str]]:
    """Yield the id and the options as written; what has no name comes with an empty one."""
    found = list(OPTION.finditer(text))
    head = text[: found[0].start()] if found else text
    for index, word in enumerate(head.replace(",", " ").split()):
        yield ("" if index else "id"), word
    ends = [match.start() for match in found[1:]]
    for match, end in zip(found, [*ends, len(text)], strict=False):
        yield match[1], text[match.end() : end].strip().rstrip(",").strip("\"' ")


def _free_options() -> list[str]:
    return [name for name in options_at(MetricWanted, ()) if name not in ("id", *LIMITS)]
