"""What the tests of wrong files share: every problem of a file, as it is told."""

from __future__ import annotations

import pytest

from recipes import RecipeError, parse_recipe


def problems(text: str | bytes, parse=parse_recipe) -> list[str]:
    raw = text if isinstance(text, bytes) else text.encode()
    with pytest.raises(RecipeError) as caught:
        parse(raw, "r.yaml")
    return [str(problem) for problem in caught.value.problems]
