"""The collection of texts finds what people see, with its place."""

import re
from collections import Counter

import pytest
from texts import DRAWN, ROOT, drawn, texts

from definitions.checks import CHECKS
from definitions.faults import FAULTS
from definitions.metrics import METRICS

TEXTS = texts()


def test_every_kind_of_text_is_found_at_its_place():
    counts = Counter(one.kind for one in TEXTS)
    assert set(counts) == {"error", "help", "table", "line"}
    for one in TEXTS[::25]:
        name, line = one.place.split(":")
        assert 0 < int(line) <= len((ROOT / name).read_text("utf-8").splitlines())


def test_every_row_of_the_vocabulary_is_among_the_texts():
    found = {one.text for one in TEXTS}
    assert {fault.cause for fault in FAULTS if len(fault.cause.split()) > 2} <= found
    assert {check.action for check in CHECKS.values() if len(check.action.split()) > 2} <= found
    literal = {row.text for row in METRICS.values() if not re.fullmatch(r"k\d", row.id)}
    assert literal <= found


@pytest.mark.parametrize("seed", [1, 2])
def test_a_seed_draws_the_same_fifty(seed):
    assert drawn(seed, TEXTS) == drawn(seed, texts())
    assert len({one.place for one in drawn(seed, TEXTS)}) > DRAWN // 2
