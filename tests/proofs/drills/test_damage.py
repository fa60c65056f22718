"""A few damages of one run among twenty; a hundred are `python tests/proofs/drills/damage_drill.py`."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from damage import NOT_EVIDENCE, OWN, Folder

from station.own_place import PLACE

SEED, DAMAGES = 12, 4


def test_a_damaged_run_harms_no_other_and_is_named(golden_run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PLACE, str(tmp_path / OWN))
    folder = Folder(tmp_path, golden_run.record, report=False)
    assert len(folder.ids) == 20
    states = {row["state"] for row in folder.rows().values()}
    assert {"complete", "stopped", "interrupted", "not concluded", "recording"} <= states
    drawn = random.Random(SEED)  # noqa: S311 - to be drawn again
    for damage in folder.damages(SEED, DAMAGES):
        found = folder.judge(damage, drawn, others=1)
        assert not found.wrong, f"{damage}: {found.wrong}"
        assert found.named or damage.file in NOT_EVIDENCE, damage
