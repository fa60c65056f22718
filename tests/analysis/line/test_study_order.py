"""The order of a study: each measurement once, in blocks of an operator, trial after trial, the same by its seed."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from analysis.line.study_order import Cell, study_order

NAMES = st.lists(st.text(min_size=1, max_size=6), min_size=1, max_size=6, unique=True)
SEEDS = st.integers(0, 2**32)


@given(parts=NAMES, operators=NAMES, trials=st.integers(1, 5), seed=SEEDS)
def test_every_measurement_stands_in_the_order_once(
    parts: list[str], operators: list[str], trials: int, seed: int
) -> None:
    order = study_order(parts, operators, trials, seed)
    wanted = {Cell(*one) for one in itertools.product(parts, operators, range(1, trials + 1))}
    assert set(order) == wanted
    assert len(order) == len(wanted)
    assert order == study_order(parts, operators, trials, seed)


@given(parts=NAMES, operators=NAMES, trials=st.integers(1, 5), seed=SEEDS)
def test_an_operator_measures_every_part_before_the_next_one_begins(
    parts: list[str], operators: list[str], trials: int, seed: int
) -> None:
    order = study_order(parts, operators, trials, seed)
    blocks = [order[begin : begin + len(parts)] for begin in range(0, len(order), len(parts))]
    for block in blocks:
        assert {one.part for one in block} == set(parts)
        assert len({(one.operator, one.trial) for one in block}) == 1
    heads = [(block[0].trial, block[0].operator) for block in blocks]
    assert [trial for trial, _ in heads] == sorted(trial for trial, _ in heads), "a trial is complete before the next"
    assert len(set(heads)) == len(operators) * trials


@given(parts=st.permutations(list("ABCDE")), operators=st.permutations(["Anna", "Ben"]), seed=SEEDS)
def test_the_order_does_not_go_by_how_the_names_were_given(parts: list[str], operators: list[str], seed: int) -> None:
    assert study_order(parts, operators, 2, seed) == study_order(sorted(parts), sorted(operators), 2, seed)


def test_parts_and_operators_change_their_places() -> None:
    """Over 200 seeds each of five parts is first in a block about as often as the others: 200 ± 4 σ of 1000 blocks."""
    firsts = [one.part for seed in range(200) for one in study_order(list("ABCDE"), [""], 5, seed)[::5]]
    assert all(abs(firsts.count(part) - 200) < 4 * (1000 * 0.2 * 0.8) ** 0.5 for part in "ABCDE")
