"""Whose runs count: by the database as by the program, also where a run names no key."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select, update
from stored_runs import metric, store_run

from station.documents.manifest import attempt_text
from station.quality.figures import yield_of
from station.store.attempts import attempts_told
from station.store.metric_rows import metric_rows, runs_that_do_not_count
from station.store.quality.counts import Verdicts, failures, first_verdicts
from station.store.quality.lot import Lot, production
from station.store.quality.retests import retests_of
from station.store.stored_runs import COLUMNS, StoredRun, is_trusted
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
        view.database.let_go()  # of the store as it was when the look began
        count = [rows[0].run for rows in metric_rows(view, "lost_motion", None, None, studies=False).runs]
        others = [one.run for one in runs_that_do_not_count(view, None, None, studies=False)]
        assert count == [run for run, key in keys.items() if is_trusted(key, view.chain, view.trust)]
        assert sorted([*count, *others]) == sorted(runs)


ASIDE: dict[str, dict[str, Any]] = {"simulated": {"virtual": "P1"}, "faults injected": {"scenario": "slow.yaml"}}


@pytest.mark.parametrize("aside", ASIDE)
def test_a_unit_that_was_tried_before_without_being_one_has_its_first_attempt_ahead(
    tmp_path: Path, store_url: str | None, aside: str
) -> None:
    """What was simulated under its serial number took the first real FAIL of a unit out of first-pass yield."""
    del store_url
    store_run(tmp_path, "R9", [metric(0.4)], day=0, **ASIDE[aside])
    store_run(tmp_path, "R9", [metric(1.2, title="Lost motion")], day=1, failed="lost_motion")
    last = store_run(tmp_path, "R9", [metric(0.5)], day=2)
    with production(tmp_path) as look:
        whole = yield_of(look, Lot()).whole.verdicts
        assert (whole.first, whole.final) == (Verdicts(failed=1), Verdicts(passed=1))
        assert [one.run.run for one in retests_of(look, Lot())] == [last.id]
        assert sum(failures(look, Lot()).values()) > 0
    with look_at(tmp_path) as view, view.database.reading() as connection:
        asked = select(*COLUMNS).where(RUNS.c.run == last.id)
        rows = [StoredRun._make(row) for row in connection.execute(asked).all()]
        told = attempts_told(connection, view.chain, view.trust, rows)
    assert told[last.id] == attempt_text(3, last.manifest().before, None)
    assert f"attempt 1 {aside} PASS; attempt 2 FAIL" in told[last.id]


def test_an_attempt_that_is_lost_or_was_altered_is_never_set_aside(tmp_path: Path, store_url: str | None) -> None:
    del store_url
    runs = [store_run(tmp_path, name, [metric(0.4)], day=day, virtual="P1") for day, name in enumerate(("L", "A"))]
    manifest = runs[1].folder / "run.json"
    manifest.write_bytes(manifest.read_bytes().replace(b'"PASS"', b'"FAIL"'))
    shutil.rmtree(runs[0].folder)
    for name in "LA":
        again = store_run(tmp_path, name, [metric(0.4)], day=3)
        assert [one.aside for one in again.manifest().before or ()] == [None]
    with production(tmp_path) as look:
        assert first_verdicts(look, Lot()) == Verdicts()


BESIDES: dict[str, dict[str, Any]] = {"of a master part": {"master": "FAIL"}, **ASIDE}


@pytest.mark.parametrize(
    ("since", "until"),
    [(None, None), ("2026-01-05T00:00:00+00:00", None), ("2026-01-05T08:01:00+00:00", "2026-01-20T00:01:00+00:00")],
    ids=["all", "by whole hours", "by minutes"],
)
def test_who_is_not_believed_is_told_as_not_counted(
    tmp_path: Path, store_url: str | None, since: str | None, until: str | None
) -> None:
    del store_url
    store_run(tmp_path, "SOUND", [metric(0.4)], day=0)
    altered = [store_run(tmp_path, "ALTERED", [metric(1.4)], day=1, failed="lost_motion")]
    altered += [store_run(tmp_path, "B", [metric(0.4)], day=day, **BESIDES[why]) for day, why in enumerate(BESIDES, 2)]
    for run in altered:
        result = run.folder / "result.json"
        result.write_bytes(result.read_bytes() + b" ")
    unreadable = store_run(tmp_path, "UNREADABLE", [metric(0.4)], day=6).folder / "run.json"
    unreadable.write_bytes(b"")
    store_run(tmp_path, "STRANGE", [metric(0.4)], day=7)
    lot = Lot(since=since, until=until)
    with look_at(tmp_path), production(tmp_path) as look:
        assert look.disbelieved(lot) == 5, "also those that say to be none of the production, or nothing"
        assert look.disbelieved(lot._replace(recipe="another")) == 1
        assert [look.disbelieved(lot, serial) for serial in ("B", "SOUND")] == [3, 0]
        stranger = replace(look, keys=(STRANGE,), unsigned_count=False)
        assert stranger.disbelieved(lot) == 7 - (since is not None and since > "2026-01-05T00:00:00+00:00")
        assert stranger.disbelieved(lot, "STRANGE") == 1
