"""The collection of texts finds what people see, with its place."""

import re
from collections import Counter
from pathlib import Path

import pytest
from texts import DRAWN, ROOT, Seen, drawn, texts

from definitions.checks import CHECKS
from definitions.device_proofs import DEVICE_PROOFS
from definitions.faults import FAULTS
from definitions.jog import PROTECTIONS as JOG_PROTECTIONS
from definitions.metrics import METRICS
from definitions.protections import DRIVE_PROTECTIONS


@pytest.fixture(scope="module")
def found() -> list[Seen]:
    """All texts of the product: to find them takes a second, which only these tests pay."""
    return texts()


def test_every_kind_of_text_is_found_at_its_place(found):
    counts = Counter(one.kind for one in found)
    assert set(counts) == {"error", "help", "table", "line"}
    for one in found[::25]:
        name, line = one.place.split(":")
        assert 0 < int(line) <= len((ROOT / name).read_text("utf-8").splitlines())


def test_every_row_of_the_vocabulary_is_among_the_texts(found):
    said = {one.text for one in found}
    assert {fault.cause for fault in FAULTS if len(fault.cause.split()) > 2} <= said
    assert {check.action for check in CHECKS.values() if len(check.action.split()) > 2} <= said
    literal = {row.text for row in METRICS.values() if not re.fullmatch(r"k\d", row.id)}
    assert literal <= said
    assert {row.leaves_open.text for row in CHECKS.values() if row.leaves_open} <= said
    assert {text for row in DEVICE_PROOFS for text in row[1:] if len(text.split()) > 2} <= said
    protections = [text for row in (*DRIVE_PROTECTIONS, *JOG_PROTECTIONS) for text in row[1:] if isinstance(text, str)]
    assert {text for text in protections if len(text.split()) > 2} <= said


def test_what_a_check_says_of_its_failure_is_among_the_texts(found):
    """Most of it is named before it is returned, in parts: a module that measures says something."""
    measuring = [
        path for path in (ROOT / "analysis/validity").glob("*.py") if "return Reading(" in path.read_text("utf-8")
    ]
    silent = {path.name for path in measuring} - {
        Path(one.place.split(":")[0]).name for one in found if one.kind == "line"
    }
    assert silent == set()
    assert len([one for one in found if one.place.startswith("analysis/validity/")]) > 3 * len(measuring)


@pytest.fixture(scope="module")
def found_again() -> list[Seen]:
    return texts()


@pytest.mark.parametrize("seed", [1, 2])
def test_a_seed_draws_the_same_fifty(found, found_again, seed):
    assert drawn(seed, found) == drawn(seed, found_again)
    assert len({one.place for one in drawn(seed, found)}) > DRAWN // 2


GONE = re.compile(
    r"\b(desk|lateness|circumstances|durable|gates?|(?:is|are|not|^)\s?in order|anew|way of (?:that|the|its) shaft|"
    r"stands? (?:\S+ times|where)|as it was (?:left|backed up)|meanwhile|way back)\b",
    re.IGNORECASE,
)
"""Words that had a term of the field beside them, which is used now, and wording that readers did not follow."""


def test_one_thing_has_one_word(found):
    assert [one for one in found if GONE.search(one.text)] == []
