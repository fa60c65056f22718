"""The same seed gives the same bytes in two processes, and replays; `make seeds` does it a thousand times."""

from __future__ import annotations

from dataclasses import replace

from seeds import both, draw, make, problems

SEEDS = range(1, 7)


def test_every_seed_gives_the_same_bytes_twice_and_replays():
    made = list(both(SEEDS))
    assert [one.seed for one, _ in made] == list(SEEDS)
    assert [problems(one, other) for one, other in made] == [[]] * len(SEEDS)
    assert len({one.sha256 for one, _ in made}) == len(SEEDS), "every seed is another run"
    assert len({one.end for one, _ in made}) > 1
    assert len({draw(seed)[0] for seed in SEEDS}) == len(SEEDS)


def test_every_seed_can_be_drawn():
    assert {draw(seed)[2].scenario.name for seed in range(2000)} == {f"seed {seed}" for seed in range(2000)}


def test_a_run_that_differs_or_was_not_replayed_is_told():
    one = make(2, replayed=True)
    assert problems(one, replace(one, replayed=False)) == []
    assert "differ" in problems(one, replace(one, replayed=False, sha256="0"))[0]
    assert "replayed" in problems(one, one)[0]
    assert problems(replace(one, wrong="does not replay"), replace(one, replayed=False)) == ["does not replay"]
