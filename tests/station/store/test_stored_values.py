"""One metric over stored runs: which runs count, which metric is meant, and what is not comparable."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from stored_runs import metric, store_lot, store_run

from analysis.metrics.former_wordings import FORMER_DEFINITIONS
from definitions.metrics import METRICS
from station.cli.line.stored_metric import Ask
from station.cli.line.stored_values import stored_values
from station.errors import StationError

ASK = Ask("lost_motion")


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    return store_lot(tmp_path)


def test_runs_that_do_not_count_are_left_out_and_counted(runs: Path) -> None:
    found = stored_values(runs, Ask("lost_motion", recipe="inverse"))
    assert [one.value for one in found.values] == [0.40, 0.42, 0.38, 0.41, 0.39, 0.5]
    assert sorted(found.left_out) == [
        "that ended as stopped", "whose measurement was invalid", "whose value could not be evaluated",
    ]  # fmt: skip
    assert not any("FAULTS" in note for note in found.notes())
    store_run(runs, "U9", [metric(0.4)], scenario="scenarios/slow-amplifier.yaml")
    with_faults = stored_values(runs, Ask("lost_motion", recipe="inverse"))
    assert "FAULTS INJECTED: in 1 of 7 runs" in with_faults.notes()
    assert with_faults.head().runs_with_faults == 1
    altered = found.runs()[0]
    (altered.folder / "recipe.yaml").write_bytes(b"changed\n")
    assert stored_values(runs, Ask("lost_motion", recipe="inverse")).left_out["altered"] == 1


def test_each_unit_counts_once_when_asked_for(runs: Path) -> None:
    for which, value in (("first", 0.40), ("last", 0.5)):
        found = stored_values(runs, Ask("lost_motion", recipe="inverse", attempts=which))
        assert {one.serial: one.value for one in found.values}["U0"] == value
        assert len(found.values) == 5


@pytest.mark.parametrize("harm", ["deleted", "altered", "damaged"])
@pytest.mark.parametrize("which", ["first", "last"])
def test_no_other_attempt_takes_the_place_of_one_that_is_lost(runs: Path, which: str, harm: str) -> None:
    ask = Ask("lost_motion", recipe="inverse", attempts=which)
    lost = next(run for run in stored_values(runs, ask).runs() if run.serial() == "U0")
    if harm == "deleted":
        shutil.rmtree(lost.folder)
    else:
        (lost.folder / ("recipe.yaml" if harm == "altered" else "run.json")).write_bytes(b"changed\n")
    found = stored_values(runs, ask)
    assert "U0" not in {one.serial for one in found.values}, "its other attempt is none the less a retest"
    assert len(found.values) == 4
    assert f"left out: 1 of units whose {which} run is missing, altered or damaged" in found.notes()
    assert "U0" in {one.serial for one in stored_values(runs, Ask("lost_motion", recipe="inverse")).values}


def test_runs_that_mean_something_else_are_refused(runs: Path) -> None:
    store_run(runs, "U9", [metric(0.4, band=0.04)])
    with pytest.raises(
        StationError, match=r"define lost_motion differently: option band is 0.03 in one and 0.04 in the other"
    ):
        stored_values(runs, ASK)


def test_a_definition_in_the_words_of_before_means_the_same(tmp_path: Path) -> None:
    for number, text in enumerate((*FORMER_DEFINITIONS["lost_motion"], METRICS["lost_motion"].text)):
        store_run(tmp_path, f"U{number}", [metric(0.4, definition=text)], day=number)
    assert len(stored_values(tmp_path, ASK).values) == 3
    store_run(tmp_path, "U9", [metric(0.4, definition="half of it")])
    with pytest.raises(StationError, match="define lost_motion differently: option definition is "):
        stored_values(tmp_path, ASK)


def test_runs_with_the_torque_of_different_sensors_are_pooled_only_when_the_recipe_is_named(tmp_path: Path) -> None:
    for number, converted in enumerate((False, False, True, None)):
        revision = 2 if converted else 1
        store_run(tmp_path, f"U{number}", [metric(0.4)], day=number, converted=converted, revision=revision)
    said = r"2 runs of output torque as measured, 1 run of output torque converted .* --recipe inverse"
    with pytest.raises(StationError, match=said):
        stored_values(tmp_path, ASK)
    pooled = stored_values(tmp_path, Ask("lost_motion", recipe="inverse"))
    assert len(pooled.values) == 4
    assert [note for note in pooled.notes() if note.startswith("MIXED")] == [
        "MIXED: 3 runs of revision 1, 1 run of revision 2",
        "MIXED: 2 runs of output torque as measured, 1 run of output torque converted from the input's",
    ]


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (Ask("unknown"), "no run has a usable value of unknown"),
        (Ask("lost_motion", side="both"), r"without side both of lost_motion \(there is \+"),
        (Ask("lost_motion", attempts="best"), "--attempts: found 'best'"),
    ],
)
def test_what_was_asked_for_wrongly_is_said(runs: Path, ask: Ask, said: str) -> None:
    with pytest.raises(StationError, match=said):
        stored_values(runs, ask)


def test_a_metric_is_named_with_its_choices(tmp_path: Path) -> None:
    """One recipe may ask for one id by several fits; each is a series of its own."""
    for number in range(3):
        several = [
            metric(0.40 + number, estimator="six"),
            metric(0.50 + number, estimator="three", choices=["three_region"]),
            metric(0.60 + number, estimator="three", choices=["centred", "three_region"]),
        ]
        store_run(tmp_path, f"C{number}", several, day=number)

    def first(name: str) -> float:
        return stored_values(tmp_path, Ask(name)).values[0].value

    assert first("lost_motion") == 0.40
    assert first("lost_motion three_region") == 0.50
    assert first("lost_motion centred three_region") == first("lost_motion centred") == 0.60
    with pytest.raises(
        StationError, match="no run has a usable value of lost_motion direct; found 3 without lost_motion direct"
    ):
        first("lost_motion direct")
    store_run(tmp_path, "C9", [metric(1.0, branch="load"), metric(2.0, branch="mean")], day=9)
    with pytest.raises(
        StationError, match=r"run .*C9 has 2 values of lost_motion: lost_motion \(load\), lost_motion \(mean\)"
    ):
        first("lost_motion")
