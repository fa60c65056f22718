"""Whose runs count: by the database as by the program, also where a run names no key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import update
from stored_runs import metric, store_run

from station.store.metric_rows import metric_rows, runs_that_do_not_count
from station.store.stored_runs import is_trusted
from station.store.tables import RUNS
from station.store.view import look_at

STRANGE = "ed25519:" + "0" * 64


@pytest.mark.parametrize("old_runs_count", [True, False])
def test_a_run_counts_or_is_named_as_one_that_does_not(
    tmp_path: Path, store_url: str | None, *, old_runs_count: bool
) -> None:
    del store_url
    runs = [store_run(tmp_path, f"U{number}", [metric(0.4)], day=number).id for number in range(3)]
    with look_at(tmp_path) as view:
        assert view.chain.start is not None
        own = view.chain.start.key
        if not old_runs_count:
            view.trust = replace(view.trust, keys=frozenset({STRANGE}))
        keys = dict(zip(runs, (own, STRANGE, None), strict=True))
        with view.database.writing() as connection:
            for run, key in keys.items():
                connection.execute(update(RUNS).where(RUNS.c.run == run).values(key=key))
        count = [rows[0].run for rows in metric_rows(view, "lost_motion", None, None, studies=False).runs]
        others = [one.run for one in runs_that_do_not_count(view, None, None, studies=False)]
        assert count == [run for run, key in keys.items() if is_trusted(key, view.chain, view.trust)]
        assert sorted([*count, *others]) == sorted(runs)
