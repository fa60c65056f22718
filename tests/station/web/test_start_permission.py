"""Each condition of a start fails alone; scans are read as serial numbers or refused; the table of models is strict."""

from __future__ import annotations

import dataclasses
import shutil
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import pytest
from ended_runs import bench_of, ended, on_a_cable, recovered
from hypothesis import given
from hypothesis import strategies as st
from lostmotion_command import here
from station_samples import SETUP
from station_support import released, write_models

from recipes import RecipeError, shipped_recipes
from recipes.schema.bench_schema import MasterPart
from station.bench.request import Job
from station.documents.manifest import EarlierAttempt
from station.records.chain.chain_file import CREATED_MANIFEST
from station.records.clock_behind import ClockBehind
from station.records.data_folder import Store
from station.records.revisions.writing import save_draft
from station.records.run_record import RunRecord
from station.records.seal import CONCLUDED, seal
from station.run.way_back.begins_at import LOOKED_INTO
from station.web.bad_units import LOOKED_AT, Bad, bad_unit_of, may_be_bad, unconfirmed
from station.web.bench.way_back import WayBack
from station.web.labels.outbox import PRINTED, Awaited
from station.web.languages import words_of
from station.web.mes.previous_step import PreviousStep
from station.web.models import Model, load_models
from station.web.permission import CONDITIONS, Situation, Wanted, refusals, situation_of
from station.web.scanner import GS, ScanError, serial_of

STUDY_STEP = "study g, step 1 of 8: found unit SN-1; unit SN-2 is next. Put that unit on the bench."
SN_9 = Bad("R1", "Unit SN-9 is bad. Put it into the NOK box and confirm that.")
FAILED_BEFORE = PreviousStep("failed", away=False, silent_s=1.0, may_be_unverified=True)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Situation:
    data = tmp_path_factory.mktemp("permission") / "runs"
    write_models(data)
    return situation_of(data, load_models(data, None), Wanted("SN-1"), busy=False, confirmed=frozenset())


def run(attempt: int, verdict: str | None = "PASS", state: str = "complete") -> EarlierAttempt:
    return EarlierAttempt(attempt=attempt, run=f"R{attempt}", verdict=verdict, state=state)


def newest(state: str, started: str = "2026-01-01T00:00:00+00:00") -> SimpleNamespace:
    manifest = SimpleNamespace(started=started, verdict=None, bench=SimpleNamespace(name="bench"), records=1)
    return SimpleNamespace(id="R1", state=lambda: state, manifest=lambda: manifest)


BEHIND = ClockBehind(datetime(2026, 5, 11, tzinfo=UTC), 7, "R1", datetime(2026, 11, 27, tzinfo=UTC))


def with_master_parts(job: Job) -> Job:
    parts = (MasterPart(serial="MASTER-GOOD", expect="PASS"), MasterPart(serial="MASTER-BAD", expect="FAIL"))
    return dataclasses.replace(job, bench=job.bench.model_copy(update={"master_parts": parts}))


def cases(good: Situation, monkeypatch: pytest.MonkeyPatch) -> dict[str, Situation]:
    full = good.data / "full"
    full.mkdir(exist_ok=True)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: SimpleNamespace(free=1000 if place == full else 10**12))
    return {
        "bench_free": dataclasses.replace(good, busy=True),
        "model_known": dataclasses.replace(good, model=None, job=None),
        "scanner_tested": dataclasses.replace(good, scanner_tested=False),
        "previous_step_passed": dataclasses.replace(good, previous_step=FAILED_BEFORE),
        "recipe_in_order": dataclasses.replace(good, job=None, why_no_job="it is not there"),
        "recipe_released": dataclasses.replace(good, release=None),
        "bad_unit_put_away": dataclasses.replace(good, bad=SN_9),
        "label_read": dataclasses.replace(good, label=str(Awaited("R0", "SN-0", PRINTED))),
        "study_step": dataclasses.replace(good, study=STUDY_STEP),
        "attempts_left": dataclasses.replace(good, before=(run(1, "FAIL"), run(2, "FAIL"))),
        "retest_reason": dataclasses.replace(good, before=(run(1, "FAIL"),)),
        "bench_recovered": dataclasses.replace(good, job=on_a_cable(good.job), last=newest("fault")),
        "master_parts": dataclasses.replace(good, job=with_master_parts(good.job)),
        "room_on_disk": dataclasses.replace(good, data=full),
        "clock_plausible": dataclasses.replace(good, behind=BEHIND),
    }


def test_each_condition_fails_alone_with_its_reason(good: Situation, monkeypatch: pytest.MonkeyPatch) -> None:
    assert refusals(good) == []
    found = cases(good, monkeypatch)
    assert list(found) == [one.id for one in CONDITIONS]
    for name, situation in found.items():
        ((refused, why),) = refusals(situation)
        assert refused == name
        assert why


def test_a_code_that_was_read_twice_in_one_is_no_unit(good: Situation) -> None:
    loose = good.model.model_copy(update={"serial": "[A-Z0-9-]{4,32}"})
    for serial, allowed in (("SN-1", True), ("SN-1SN-1", False), ("SN-1SN-2", True)):
        found = refusals(dataclasses.replace(good, model=loose, wanted=Wanted(serial)))
        assert [name for name, _ in found] == ([] if allowed else ["model_known"])
    assert refusals(dataclasses.replace(good, wanted=Wanted("1111"))) == [], "half of it would be none of this model"


def test_a_bad_unit_is_named_by_its_serial_number_and_an_unreadable_record_by_its_run_too(tmp_path: Path) -> None:
    run = Store(tmp_path).create("SN-9", SETUP, {})
    seal(run, state="complete", verdict="FAIL")
    told = bad_unit_of(tmp_path, frozenset()).text
    assert ("SN-9 is bad" in told, run.id in told) == (True, False)
    (run.folder / "run.json").write_text("{", encoding="utf-8")
    told = bad_unit_of(tmp_path, frozenset()).text
    assert (run.id in told, "cannot be read" in told, "SN-9" in told) == (True, True, True)


def test_no_unit_is_measured_while_the_bench_is_jogged(good: Situation) -> None:
    ((refused, why),) = refusals(dataclasses.replace(good, jogging=True, bad=SN_9))
    assert (refused, "jog" in why) == ("bench_free", True)


def test_all_reasons_are_told_at_once(good: Situation) -> None:
    both = dataclasses.replace(good, before=(run(1),), bad=SN_9)
    assert [name for name, _ in refusals(both)] == ["bad_unit_put_away", "retest_reason"]
    assert [name for name, _ in refusals(dataclasses.replace(both, busy=True))] == ["bench_free"]


def test_a_study_is_the_reason_and_says_how_often_its_units_are_measured(good: Situation) -> None:
    often = (run(1, "FAIL"), run(2, "FAIL"), run(3, "FAIL"))
    assert refusals(dataclasses.replace(good, before=often, wanted=Wanted("SN-1", study="g", operator="Anna"))) == []


def test_a_study_that_is_not_there_measures_nothing(good: Situation) -> None:
    wanted = Wanted("SN-1", study="g", operator="Anna")
    models = load_models(good.data, None)
    ((name, why),) = refusals(situation_of(good.data, models, wanted, busy=False, confirmed=frozenset()))
    assert name == "study_step"
    assert "there is no such study. Studies here: none" in why


def test_a_retest_needs_a_reason_and_has_an_end(good: Situation) -> None:
    once, twice = (run(1, "NOT DECIDABLE"),), (run(1, "FAIL"), run(2, None, "fault"))
    again = Wanted("SN-1", "seating of the unit")
    assert refusals(dataclasses.replace(good, before=once, wanted=again)) == []
    (name, why), = refusals(dataclasses.replace(good, before=twice, wanted=again))  # fmt: skip
    assert name == "attempts_left"
    assert "attempt 1 FAIL" in why
    assert "2 are allowed" in why


def test_master_parts_may_always_be_measured_and_a_bad_one_that_failed_is_no_bad_unit(good: Situation) -> None:
    often = tuple(run(number, "FAIL") for number in range(1, 9))
    one = dataclasses.replace(good, job=with_master_parts(good.job), before=often)
    assert [name for name, _ in refusals(one)] == ["attempts_left", "master_parts"]
    assert refusals(dataclasses.replace(one, wanted=Wanted("MASTER-BAD"))) == []


@pytest.mark.parametrize(
    ("state", "lock", "allowed"),
    [("stopped", "open", True), ("stopped", "closed", False), ("fault", "open", False), ("recording", "", False)],
)
def test_a_bench_is_free_again_when_a_recovery_has_opened_the_lock(
    good: Situation, tmp_path: Path, state: str, lock: str, *, allowed: bool
) -> None:
    fault = Store(tmp_path).create("SN-1", SETUP, {})
    fault.update(state="fault", files={})
    one = dataclasses.replace(good, data=tmp_path, job=on_a_cable(good.job), last=fault)
    assert [name for name, _ in refusals(one)] == ["bench_recovered"]
    recovered(tmp_path, fault.id, SETUP, state, lock)
    assert [name for name, _ in refusals(one)] == ([] if allowed else ["bench_recovered"])


@pytest.mark.parametrize(("others", "offered"), [(0, True), (3, True), (LOOKED_INTO, False)])
def test_the_page_is_named_for_a_recovery_only_where_it_offers_one(
    good: Situation, tmp_path: Path, others: int, *, offered: bool
) -> None:
    fault = ended(tmp_path, "SN-1", None, "fault", bench_of("bench-3"))
    for number in range(others):
        ended(tmp_path, f"W-{number}", setup=bench_of("bench-4"))
    model = good.model.model_copy(update={"bench": "b.yaml"})
    one = dataclasses.replace(
        good, data=tmp_path, model=model, job=on_a_cable(good.job), last=RunRecord(tmp_path / fault)
    )
    ((_, why),) = refusals(one)
    assert ("Maintenance" in why, "recover --bench b.yaml'" in why) == (offered, True)
    assert words_of("de")(why) != why
    assert (WayBack(tmp_path).standing().fault is not None) == offered


def test_a_folder_that_is_no_run_hides_none(tmp_path: Path) -> None:
    bad = ended(tmp_path, "SN-1", "FAIL")
    (tmp_path / "20991126T160000.000Z-x").mkdir()
    assert [one.id for one in Store(tmp_path).newest(1)] == [bad]
    assert unconfirmed(tmp_path, frozenset()) == bad


@pytest.mark.parametrize("lost", ["run.json", "the folder"])
@pytest.mark.parametrize("concluded", [True, False])
def test_a_run_whose_record_is_gone_may_have_a_bad_unit(tmp_path: Path, lost: str, *, concluded: bool) -> None:
    run = ended(tmp_path, "SN-1", "FAIL") if concluded else Store(tmp_path).create("SN-1", SETUP, {}).id
    if lost == "run.json":
        (tmp_path / run / "run.json").unlink()
    else:
        shutil.rmtree(tmp_path / run)
    assert unconfirmed(tmp_path, frozenset()) == run
    assert may_be_bad(tmp_path, run), "it can be confirmed"
    assert unconfirmed(tmp_path, frozenset({run})) == ""
    assert not may_be_bad(tmp_path, "20261126T160000.000Z-x")
    assert not may_be_bad(tmp_path, "..")


def test_a_good_unit_whose_folder_was_moved_away_is_good_by_the_word_of_the_chain(tmp_path: Path) -> None:
    shutil.rmtree(tmp_path / ended(tmp_path, "SN-1"))
    assert unconfirmed(tmp_path, frozenset()) == ""


def test_a_run_that_was_killed_while_it_was_begun_has_no_bad_unit(tmp_path: Path) -> None:
    folder = Store(tmp_path).create("SN-1", SETUP, {}).folder
    (folder / "run.json").rename(folder / CREATED_MANIFEST)
    assert unconfirmed(tmp_path, frozenset()) == ""


def test_a_bad_unit_is_asked_for_until_it_is_put_away_whatever_was_measured_since(tmp_path: Path) -> None:
    first = ended(tmp_path, "SN-1", "FAIL")
    assert unconfirmed(tmp_path, frozenset()) == first
    killed = Store(tmp_path).create("SN-2", SETUP, {})
    second = ended(tmp_path, "SN-3", "FAIL")
    for number in range(3):
        ended(tmp_path, f"GOOD-{number}")
    assert unconfirmed(tmp_path, frozenset()) == second
    assert unconfirmed(tmp_path, frozenset({second})) == "", "what is older was settled before it"
    seal(killed, state="complete", verdict="FAIL")
    assert unconfirmed(tmp_path, frozenset({first})) == second
    for number in range(LOOKED_AT):
        ended(tmp_path, f"BETTER-{number}")
    assert unconfirmed(tmp_path, frozenset()) == ""


def test_a_run_that_is_concluded_late_is_asked_for(tmp_path: Path) -> None:
    settled = ended(tmp_path, "SN-1", "FAIL")
    killed = Store(tmp_path).create("SN-2", SETUP, {})
    ended(tmp_path, "SN-3")
    assert unconfirmed(tmp_path, frozenset({settled})) == ""
    seal(killed, state="complete", verdict="FAIL")
    assert unconfirmed(tmp_path, frozenset({settled})) == killed.id


def test_a_record_that_is_not_as_it_was_sealed_frees_no_bad_unit(tmp_path: Path) -> None:
    bad = ended(tmp_path, "SN-1", "FAIL")
    ended(tmp_path, "SN-2")
    manifest = tmp_path / bad / "run.json"
    content = manifest.read_bytes()
    manifest.write_bytes(content.replace(b'"verdict": "FAIL"', b'"verdict": "PASS"'))
    assert manifest.read_bytes() != content
    found = bad_unit_of(tmp_path, frozenset())
    assert found is not None
    assert found.run == bad
    assert "not as it was sealed" in found.text
    manifest.write_bytes(content)
    chain = tmp_path / "chain.jsonl"
    lines = [line for line in chain.read_bytes().splitlines(keepends=True) if b'"sealed"' not in line]
    chain.write_bytes(b"".join(lines))
    assert unconfirmed(tmp_path, frozenset()) != "", "the line that sealed it was taken out"


def test_the_line_and_the_place_of_a_sealed_record_may_come_apart(tmp_path: Path) -> None:
    bad = tmp_path / ended(tmp_path, "SN-1")
    (bad / "run.json").rename(bad / CONCLUDED)
    assert unconfirmed(tmp_path, frozenset()) == "", "its process was killed between the two"


def test_a_recipe_that_cannot_be_had_is_said(tmp_path: Path) -> None:
    models = tmp_path / "models.yaml"
    models.write_text("models:\n  - {model: A, serial: '.*', recipe: no-such-recipe}\n", encoding="utf-8")
    found = situation_of(tmp_path, load_models(tmp_path, None), Wanted("X"), busy=False, confirmed=frozenset())
    ((name, why),) = refusals(found)
    assert name == "recipe_in_order"
    assert "no-such-recipe" in why


@pytest.mark.parametrize(
    ("expect", "verdict", "bad"), [("FAIL", "FAIL", False), ("PASS", "FAIL", True), ("FAIL", "PASS", False)]
)
def test_a_master_part_is_put_away_where_it_should_not_have_failed(
    tmp_path: Path, expect: str, verdict: str, *, bad: bool
) -> None:
    setup = dataclasses.replace(SETUP, unit=dataclasses.replace(SETUP.unit, master=expect))
    newest = Store(tmp_path).create("MASTER", setup, {})
    seal(newest, state="complete", verdict=verdict)
    assert unconfirmed(tmp_path, frozenset()) == (newest.id if bad else "")


@pytest.mark.parametrize(("verdict", "bad"), [("FAIL", True), ("PASS", False), ("cannot be read", True)])
def test_the_last_bad_unit_has_to_be_put_away(tmp_path: Path, verdict: str, *, bad: bool) -> None:
    newest = Store(tmp_path).create("SN-1", SETUP, {})
    if bad and verdict != "FAIL":
        (newest.folder / "run.json").write_text("{", encoding="utf-8")
    else:
        seal(newest, state="complete", verdict=verdict)
    assert unconfirmed(tmp_path, frozenset()) == (newest.id if bad else "")
    assert unconfirmed(tmp_path, frozenset({newest.id})) == ""


@pytest.mark.parametrize(
    ("scanned", "serial"),
    [
        ("SN-1", "SN-1"),
        ("  SN-1\r\n", "SN-1"),
        ("\tSN-1\t", "SN-1"),
        ("]C10109501101530003" + "21SN-1", "SN-1"),
        (f"]d2010950110153000310LOT7{GS}21SN-1", "SN-1"),
        (f"]d221SN-1{GS}10LOT7", "SN-1"),
        (f"]d2{'11261123'}21SN-1", "SN-1"),
        ("(01)09501101530003(21)SN-1", "SN-1"),
        ("]C0SN-1", "SN-1"),
        ("]d1 SN-1\r", "SN-1"),
        ("]Q1(01)09501101530003(21)SN-1", "SN-1"),
    ],
)
def test_a_scan_is_its_serial_number(scanned: str, serial: str) -> None:
    assert serial_of(scanned) == serial


@pytest.mark.parametrize(
    "scanned",
    ["", " \r\n", "ä", "SN\x071", "x" * 129, "]C10109501101530003", "]d2010950110153000310LOT721SN-1", "]d299X",
     "(01)09501101530003", "(21)", "]d201095011", "(21)SN-1)", f"]d221SN-1 {GS}10LOT7", "]C0", "]C0 "],
)  # fmt: skip
def test_what_is_no_serial_number_is_refused(scanned: str) -> None:
    with pytest.raises(ScanError) as refused:
        serial_of(scanned)
    for language in ("de", "zh"):
        assert words_of(language)(str(refused.value)) != str(refused.value), "and said so in each language"


@pytest.mark.parametrize(
    "scanned",
    [f"]d221SN-1{GS}21SN-2", f"]d221SN-1{GS}21SN-1", "(21)SN-1(21)SN-2",
     "(01)09501101530003(21)SN-1(01)09501101530003(21)", "]C0SN-1]C0SN-2"],
)  # fmt: skip
def test_two_codes_that_arrive_as_one_are_neither_unit(scanned: str) -> None:
    with pytest.raises(ScanError, match="two codes as one") as refused:
        serial_of(scanned)
    assert "zwei Codes als einen" in words_of("de")(str(refused.value))


@given(
    st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=20),
    st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=20),
)
def test_a_lost_separator_never_gives_another_serial_number_where_the_serial_is_last(serial: str, lot: str) -> None:
    assert serial_of(f"]d210{lot}{GS}21{serial}") == serial
    try:
        found = serial_of(f"]d210{lot}21{serial}")
    except ScanError:
        return
    assert found in serial, "only a lot number that looks like the end of an element leaves a part of it"


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("models: []", "models"),
        ("models:\n  - {model: A, serial: '[', recipe: r}", "serial"),
        ("models:\n  - {model: A, serial: a, recipe: r, atempts: 1}", "atempts"),
        ("models:\n  - {model: A, serial: a}", "recipe"),
    ],
)
def test_a_wrong_table_of_models_is_refused_with_the_place(tmp_path: Path, text: str, place: str) -> None:
    (tmp_path / "models.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(RecipeError) as refused:
        load_models(tmp_path, None)
    assert place in str(refused.value)


def recipe_of(data: Path, name: str) -> Situation:
    """Look at a start whose model has this recipe."""
    (data / "models.yaml").write_text(f"models:\n  - {{model: A, serial: '.*', recipe: {name}}}\n", encoding="utf-8")
    return situation_of(data, load_models(data, None), Wanted("X"), busy=False, confirmed=frozenset())


def test_a_file_counts_as_released_by_its_bytes_alone(tmp_path: Path) -> None:
    shipped = shipped_recipes()["rv-40e-121-quick"].read_bytes()
    file = tmp_path / "plant.yaml"
    file.write_bytes(shipped)
    assert refusals(recipe_of(tmp_path, str(file))) == [], "the program has released its own recipes"
    file.write_bytes(shipped + b"# another line\n")
    assert [name for name, _ in refusals(recipe_of(tmp_path, str(file)))] == ["recipe_released"]


def test_a_name_means_its_newest_released_revision(tmp_path: Path) -> None:
    name = "rv-40e-121-quick"
    shipped = shipped_recipes()[name]
    assert recipe_of(tmp_path, name).run_options()[0] == str(shipped)
    third, fourth = (shipped.read_bytes().replace(b"revision: 2", f"revision: {one}".encode()) for one in (3, 4))
    plant = released(tmp_path, third)
    save_draft(tmp_path, fourth, "Ada")
    found = recipe_of(tmp_path, name)
    assert refusals(found) == []
    assert found.run_options()[0] == str(plant.path)
    assert found.job.recipe.recipe.revision == 3
    plant.path.write_bytes(third.replace(b"max: 1 arcmin", b"max: 9 arcmin"))
    assert [one for one, _ in refusals(recipe_of(tmp_path, name))] == ["recipe_released"], "it is another text now"


def test_a_recipe_that_only_has_drafts_starts_nothing(tmp_path: Path) -> None:
    text = shipped_recipes()["rv-40e-121-quick"].read_bytes().replace(b"name: rv-40e-121-quick", b"name: plant")
    save_draft(tmp_path, text, "Ada")
    ((refused, why),) = refusals(recipe_of(tmp_path, "plant"))
    assert refused == "recipe_in_order"
    assert "no released revision" in why


def test_the_shipped_table_measures_a_unit(tmp_path: Path) -> None:
    found = load_models(tmp_path, None).of("P1-0001")
    assert isinstance(found, Model)
    assert found.recipe == "rv-40e-121-quick"
    assert load_models(tmp_path, None).of("a b") is None


def test_what_was_judged_is_what_runs(good: Situation, tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.yaml"
    recipe.write_bytes(good.job.recipe_source.content)
    words = [word for word in good.run_options() if word.startswith("--judged")]
    assert len(words) == 2
    asked = (
        "run",
        str(recipe),
        *words,
        "--serial",
        "S",
        "--virtual-time",
        "--no-report",
        "--data",
        str(tmp_path / "r"),
    )
    recipe.write_bytes(good.job.recipe_source.content + b"\n# another\n")
    refused = here(*asked)
    assert refused.exit_code == 2
    assert "recipe.yaml" in refused.err
    assert not (tmp_path / "r").exists(), "nothing was begun"
    recipe.write_bytes(good.job.recipe_source.content)
    assert here(*asked).exit_code == 0
