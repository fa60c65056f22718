"""Options of a call in a test, held against the same models as those of a scenario file and refused in the same words.

The place of a problem is that of the call: `test_guard.py:9:5: verb: found 'oppen', which is not a verb of io.guard`.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from recipes.text.problems import Mark, Source
from recipes.text.translation import problem_of

HIDDEN = "__tracebackhide__"
"""Local variable of functions that pytest leaves out of its tracebacks; the place of a call is outside of them."""

ModelT = TypeVar("ModelT", bound=BaseModel)


def checked(model: type[ModelT], options: Mapping[str, Any]) -> ModelT:
    """Return a section of a scenario made of a call's options.

    Raises:
        ValueError: an option is unknown, missing or wrong; a line for each with the place of the call.

    """
    __tracebackhide__ = True
    try:
        return model.model_validate(dict(options), strict=True)
    except ValidationError as error:
        source = _call(options)
        problems = [problem_of(detail, source, model) for detail in error.errors(include_url=False)]
    raise ValueError("\n".join(map(str, problems)))


def _call(options: Mapping[str, Any]) -> Source:
    """Return the call of a test as a document: its options, all at the place of the call."""
    frame = inspect.currentframe()
    while frame is not None and (frame.f_code.co_filename == __file__ or HIDDEN in frame.f_locals):
        frame = frame.f_back
    if frame is None:
        return Source("", dict(options), {})
    info = inspect.getframeinfo(frame, context=0)
    column = 0 if info.positions is None else info.positions.col_offset or 0
    mark = Mark(info.lineno, column + 1, info.lineno, column + 1)
    path, here = Path(info.filename), Path.cwd()
    shown = path.relative_to(here) if path.is_relative_to(here) else path
    return Source(str(shown), dict(options), {(): mark} | {(name,): mark for name in options})
