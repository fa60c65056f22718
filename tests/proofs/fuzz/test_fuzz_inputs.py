"""Every input target with its corpus and with bent copies of it; the long search is `make fuzz`."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from make_corpus import seeds
from targets import TARGETS

CORPUS = Path(__file__).parent / "corpus"
EXAMPLES = {"recipe_file": 40, "bench_file": 40}
"""Examples of the slow targets; the others get more."""


@pytest.fixture(autouse=True)
def _quiet():
    """The libraries' own warnings of every bad frame are switched off in a run as well."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(before)


def corpus(target: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((CORPUS / target).iterdir())]


@st.composite
def bent(draw: st.DrawFn, target: str) -> bytes:
    """A seed with a few bytes changed, left out or put in; now and then any bytes at all."""
    data = bytearray(draw(st.sampled_from([*corpus(target), b""])))
    for _ in range(draw(st.integers(1, 6))):
        at = draw(st.integers(0, len(data)))
        gone = draw(st.integers(0, 4))
        data[at : at + gone] = draw(st.binary(max_size=6))
    return bytes(data)


@pytest.mark.parametrize("target", TARGETS)
def test_corpus(target):
    inputs = corpus(target)
    assert inputs
    for data in inputs:
        TARGETS[target](data)


@pytest.mark.parametrize("target", TARGETS)
def test_bent_inputs(target):
    @settings(max_examples=EXAMPLES.get(target, 120), deadline=None, suppress_health_check=list(HealthCheck))
    @given(data=st.one_of(bent(target), bent(target), st.binary(max_size=300)))
    def check(data: bytes) -> None:
        TARGETS[target](data)

    check()


def test_corpus_is_small_and_holds_every_seed():
    files = [path for path in CORPUS.rglob("*") if path.is_file()]
    assert {path.parent.name for path in files} == set(TARGETS)
    assert len(files) < 100
    assert sum(path.stat().st_size for path in files) < 100_000
    for place in seeds():
        assert (CORPUS / place).is_file(), "run 'python tests/proofs/fuzz/make_corpus.py'"
