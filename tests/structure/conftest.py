"""The syntax of every module is held until all that look at it are done: there is little to collect meanwhile."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

SELDOM = 100_000
"""Objects between two collections: by the default, 700, two fifths of the time went to looking for garbage."""


@pytest.fixture(scope="package", autouse=True)
def _collected_seldom() -> Iterator[None]:
    usual = gc.get_threshold()
    gc.set_threshold(SELDOM, *usual[1:])
    yield
    gc.set_threshold(*usual)
