"""Master parts: what each last read on this bench, how long ago, and where it counts."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from station_samples import SETUP
from stored_runs import metric, recipe_text, store_run

from analysis.evaluation.verdict import Verdict
from recipes import RecipeError, find_bench, find_recipe, load_bench, parse_bench
from recipes.schema.bench_schema import Bench, MasterPart
from station.cli.line.stored_metric import Ask
from station.cli.line.stored_values import stored_values
from station.documents.manifest import MASTER, RecipeHead
from station.errors import StationError
from station.records.data_folder import Store
from station.records.master_parts import (
    AS_IT_SHOULD,
    GOOD_ONE_FAILED,
    NOT_AS_IT_SHOULD,
    NOT_MEASURED,
    ProductRecipe,
    master_parts,
    to_do_with_part,
)
from station.records.revisions.history import header_of
from station.records.revisions.revision import hash_of
from station.records.seal import seal

GOOD = MasterPart(serial="MASTER-1", expect="PASS", every_s=86400.0)
BAD = MasterPart(serial="MASTER-2", expect="FAIL", every_s=8 * 3600.0)


PRODUCT = ProductRecipe(RecipeHead(name="inverse", revision=1, sha256=hash_of(recipe_text("inverse", 1))), "RV")
"""What `store_run` measures by."""


def bench_with(*parts: MasterPart) -> Bench:
    bench = load_bench(find_bench("virtual"))
    header = bench.bench.model_copy(update={"name": SETUP.bench.name})
    return bench.model_copy(update={"master_parts": parts, "bench": header})


def moment(data: Path) -> datetime:
    """Return when the newest run was started."""
    return datetime.fromisoformat(Store(data).newest(1)[-1].manifest().started)


def test_a_bench_without_master_parts_has_nothing_to_say(tmp_path: Path) -> None:
    assert (
        master_parts(Store(tmp_path), bench_with(), datetime.fromisoformat("2026-01-05T08:00:00+00:00"), PRODUCT) == ()
    )


def test_a_master_part_that_was_never_measured_is_said(tmp_path: Path) -> None:
    (found,) = master_parts(
        Store(tmp_path), bench_with(GOOD), datetime.fromisoformat("2026-01-05T08:00:00+00:00"), PRODUCT
    )
    assert not found.in_order
    assert found.text.startswith(MASTER)
    assert "never" in found.text


@pytest.mark.parametrize(
    ("part", "failed", "later_h", "in_order"),
    [
        (GOOD, None, 3.0, True),
        (GOOD, None, 25.0, False),
        (GOOD, None, -1.0, False),
        (GOOD, "too wide", 3.0, False),
        (BAD, "too wide", 3.0, True),
        (BAD, "too wide", 9.0, False),
        (BAD, None, 3.0, False),
    ],
)
def test_a_master_part_speaks_for_its_bench_while_it_is_young_and_reads_right(
    tmp_path: Path, part: MasterPart, failed: str | None, later_h: float, *, in_order: bool
) -> None:
    store_run(tmp_path, part.serial, [metric(0.4)], failed=failed)
    (found,) = master_parts(Store(tmp_path), bench_with(part), moment(tmp_path) + timedelta(hours=later_h), PRODUCT)
    assert found.in_order is in_order, found.text
    assert ("PASS" if failed is None else "FAIL") in found.text or abs(later_h) in {25.0, 9.0, 1.0}


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (100.0, 104.0, "above 4 % of the metric stiffness_lsq"),
        (None, 104.0, "lower and an upper limit"),
        (100.0, None, "lower and an"),
    ],
)
def test_what_a_master_part_proves_is_how_near_its_limits_lie(
    tmp_path: Path, low: float | None, high: float | None, said: str
) -> None:
    """Its value and what it truly is lie between its limits: they are apart by no more than these."""
    stiffness = metric(102.0, id="stiffness_lsq", limits={"min": low, "max": high})
    wide = metric(0.4, limits={"min": 0.2, "max": 0.5} if low and high else {"min": None, "max": 1.0})
    store_run(tmp_path, GOOD.serial, [wide, stiffness])
    (found,) = master_parts(Store(tmp_path), bench_with(GOOD), moment(tmp_path) + timedelta(hours=1), PRODUCT)
    assert found.in_order
    assert said in found.text


def test_the_newest_run_counts_and_none_with_faults_or_of_another_bench(tmp_path: Path) -> None:
    store_run(tmp_path, GOOD.serial, [metric(0.4)])
    store_run(tmp_path, GOOD.serial, [metric(0.4)], day=0.1, failed="a fault was injected", scenario="scenario.yaml")
    store_run(tmp_path, GOOD.serial, [metric(0.4)], day=0.2, state="stopped")
    now = moment(tmp_path) + timedelta(hours=1)
    (found,) = master_parts(Store(tmp_path), bench_with(GOOD), now, PRODUCT)
    assert found.in_order
    elsewhere = bench_with(GOOD)
    other = elsewhere.model_copy(update={"bench": elsewhere.bench.model_copy(update={"name": "another"})})
    assert not master_parts(Store(tmp_path), other, now, PRODUCT)[0].in_order
    newest = store_run(tmp_path, GOOD.serial, [metric(0.4)], day=0.3)
    (newest.folder / "result.json").write_text("{}", encoding="utf-8")
    (found,) = master_parts(Store(tmp_path), bench_with(GOOD), moment(tmp_path) + timedelta(hours=1), PRODUCT)
    assert not found.in_order
    assert "altered" in found.text


@pytest.mark.parametrize(("clock", "counts"), [("virtual", False), ("wall", True)])
def test_a_master_part_that_was_simulated_says_nothing_of_the_bench(
    tmp_path: Path, clock: str, *, counts: bool
) -> None:
    real = replace(SETUP, bench=replace(SETUP.bench, embedded=False), clock=clock)
    real = replace(real, recipe=replace(SETUP.recipe, sha256=PRODUCT.head.sha256))
    run = Store(tmp_path).create(GOOD.serial, real, {})
    seal(run, state="complete", verdict="PASS")
    (found,) = master_parts(Store(tmp_path), bench_with(GOOD), moment(tmp_path) + timedelta(hours=1), PRODUCT)
    assert ("never" not in found.text) == counts


LOOSE = recipe_text("inverse", 1) + b"# limits on trial"


@pytest.mark.parametrize("model", ["RV", "another"])
def test_a_master_part_by_another_recipe_says_nothing_of_the_product(tmp_path: Path, model: str) -> None:
    """On a bench with several products it speaks for a model that is not its own by a released recipe only."""
    product = PRODUCT._replace(model=model, head=replace(PRODUCT.head, sha256="1" * 64))
    on_trial = store_run(tmp_path, BAD.serial, [metric(0.4)], failed="a good one, by limits of a trial", text=LOOSE)
    now = moment(tmp_path) + timedelta(hours=1)
    for wanted in (PRODUCT, product, None):
        (found,) = master_parts(Store(tmp_path), bench_with(BAD), now, wanted)
        assert not found.in_order
        assert all(one in found.text for one in (on_trial.id, on_trial.manifest().recipe.sha256[:8]))
        assert (wanted is not None and wanted.head.sha256[:8] in found.text) == (
            wanted is not None and wanted.model == "RV"
        )


@pytest.mark.parametrize(("model", "in_order"), [("RV", False), ("another", True)])
def test_a_released_recipe_speaks_for_other_models(tmp_path: Path, model: str, *, in_order: bool) -> None:
    text = find_recipe("rv-40e-121-quick").read_bytes()  # released by the program
    named = header_of(text)
    store_run(tmp_path, GOOD.serial, [metric(0.4)], text=text, recipe=named.name, revision=named.revision)
    product = PRODUCT._replace(model=model)
    for wanted, whether in ((product, in_order), (None, True)):
        (found,) = master_parts(Store(tmp_path), bench_with(GOOD), moment(tmp_path) + timedelta(hours=1), wanted)
        assert found.in_order is whether, found.text


def test_the_run_by_the_recipe_of_the_product_counts_whatever_was_tried_since(tmp_path: Path) -> None:
    store_run(tmp_path, GOOD.serial, [metric(0.4)])
    tried = store_run(tmp_path, GOOD.serial, [metric(0.4)], failed="limits of a trial", text=LOOSE, day=0.5)
    soon, late = (moment(tmp_path) + timedelta(hours=hours) for hours in (1.0, 13.0))
    (found,) = master_parts(Store(tmp_path), bench_with(GOOD), soon, PRODUCT)
    assert found.in_order, found.text
    (found,) = master_parts(Store(tmp_path), bench_with(GOOD), late, PRODUCT)
    assert not found.in_order
    assert tried.id in found.text, "whoever has just measured it is told by which recipe"


def test_a_master_part_is_no_unit_of_the_line(tmp_path: Path) -> None:
    for number in range(3):
        store_run(tmp_path, f"U{number}", [metric(0.4 + 0.01 * number)])
    store_run(tmp_path, GOOD.serial, [metric(0.9)], master=Verdict.PASS)
    found = stored_values(tmp_path, Ask("lost_motion"))
    assert [one.serial for one in found.values] == ["U0", "U1", "U2"]
    assert dict(found.left_out) == {"of a master part": 1}
    alone = stored_values(tmp_path, Ask("lost_motion", serial=GOOD.serial))
    assert [one.value for one in alone.values] == [0.9]
    with pytest.raises(StationError, match="no run has a usable value"):
        stored_values(tmp_path, Ask("lost_motion", serial="U9"))


def test_a_bench_file_names_each_master_part_once() -> None:
    text = find_bench("virtual").read_text(encoding="utf-8")
    parts = "master_parts:\n  - {serial: M1, expect: PASS, every: 12 h}\n  - {serial: M2, expect: FAIL}\n"
    bench = parse_bench((text + parts).encode(), "bench.yaml")
    assert [(one.serial, one.expect, one.every_s) for one in bench.master_parts] == [
        ("M1", "PASS", 43200.0), ("M2", "FAIL", 86400.0),
    ]  # fmt: skip
    assert bench.master_part("M2") == bench.master_parts[1]
    assert bench.master_part("SN-1") is None
    with pytest.raises(RecipeError, match="'M1' a second time"):
        parse_bench((text + parts.replace("M2", "M1")).encode(), "bench.yaml")


@pytest.mark.parametrize(
    ("expected", "verdict", "said"),
    [
        ("FAIL", "FAIL", AS_IT_SHOULD),
        ("FAIL", "PASS", NOT_AS_IT_SHOULD),
        ("PASS", "PASS", AS_IT_SHOULD),
        ("PASS", "FAIL", GOOD_ONE_FAILED),
        ("FAIL", "NOT DECIDABLE", NOT_MEASURED),
        ("PASS", "NOT DECIDABLE", NOT_MEASURED),
    ],
)
def test_what_is_done_with_a_master_part_follows_from_what_it_should_read(
    expected: str, verdict: str, said: str
) -> None:
    assert to_do_with_part(expected, verdict) == said
