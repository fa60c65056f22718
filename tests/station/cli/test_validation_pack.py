"""The validation pack: what is met is met by evidence, what is open is said, and a pack that was changed is noticed."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from stored_runs import metric, store_run

from recipes import find_bench
from station.cli.quality import validation
from station.documents.validation import ATTACHED, MET, NOT_MET, OPEN, PARTS, STATED, STATES, Evidence, ValidationPack
from station.errors import StationError
from station.quality.validation.operation import SELF_TEST, SelfTest, operation, report_of_tests
from station.quality.validation.pack import counts, fulfilled
from station.quality.validation.performance import GageFigure, known_part, performance
from station.store.quality.lot import Lot

REPORT = '<testsuites><testsuite tests="{}" failures="{}" errors="0" skipped="{}" hostname="bench-3"/></testsuites>'

YIELD = "Yield of the lot, of which nothing is required"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("validation") / "runs"
    for number in range(12):
        for attempt in range(4):
            value = 0.5 + 0.01 * number + 0.0005 * (attempt % 2)
            store_run(data, f"U{number}", [metric(value)], day=number + attempt / 10, operator="AB"[attempt // 2])
    for number in range(26):
        store_run(data, "MASTER", [metric(0.5 + 0.001 * (number % 5))], day=number, master="PASS")
    return data


@pytest.fixture
def report(tmp_path: Path) -> Path:
    file = tmp_path / "tests.xml"
    file.write_text(REPORT.format(12, 0, 1), encoding="utf-8")
    return file


def states(pack: Any, start: str) -> list[str]:
    return [one["state"] for one in pack["evidence"] if one["asked"].startswith(start)]


def test_a_pack_is_filled_from_the_installation_and_signed(folder: Path, report: Path, tmp_path: Path) -> None:
    plan = tmp_path / "form.txt"
    plan.write_text("emergency stop tried by A. Tester", encoding="utf-8")
    out = tmp_path / "pack"
    words = ("quality", "validation", "--data", str(folder), "--out", str(out), "--bench", "example-socketcan")
    given = ("--tests", str(report), "--type1", "MASTER:lost_motion:0.502", "--gage", "lost_motion")
    made = here(*words, *given, "--evidence", str(plan), "--json")
    assert made.exit_code == 1, "this computer is no bench, and the bench was not commissioned"
    pack = json.loads((out / "validation.json").read_text(encoding="utf-8"))
    assert pack == made.json["pack"]
    assert states(pack, "No run is missing or altered") == [MET]
    assert states(pack, "Recipe released").count(MET) >= 7
    assert states(pack, "The tests of the software") == [MET]
    assert set(states(pack, "Watchdogs of the drive")) == {OPEN}
    assert states(pack, "Units of known verdict") == [OPEN]
    assert states(pack, "Process capability") == [MET]
    assert states(pack, "Gage study") == [MET]
    assert {one["state"] for one in pack["evidence"]} <= set(STATES)
    assert {one["part"] for one in pack["evidence"]} == set(PARTS)
    assert made.json["counts"] == {state: sum(one["state"] == state for one in pack["evidence"]) for state in STATES}
    page = (out / "validation.html").read_text(encoding="utf-8")
    assert all(title in page for title in PARTS.values())
    assert "form.txt" in page
    assert (out / "evidence" / "form.txt").read_bytes() == plan.read_bytes()
    assert (out / "evidence" / "coverage.md").is_file(), "evidence of the maker, where the sources are"

    assert here("quality", "validation", "--check", str(out)).exit_code == 0
    assert here(*words).exit_code == 2, "a pack is never written over"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda out: (out / "validation.html").write_text("all is met", "utf-8"), "validation.html: was changed"),
        (lambda out: (out / "evidence" / "form.txt").unlink(), "evidence/form.txt: is missing"),
        (lambda out: (out / "more.txt").write_text("x", "utf-8"), "more.txt: does not belong to the pack"),
        (
            lambda out: (out / "files.json").write_text(
                (out / "files.json").read_text("utf-8").replace('"software": "', '"software": "9'), "utf-8"
            ),
            "files.json: is not what ed25519:",
        ),
    ],
    ids=["changed", "missing", "added", "list"],
)
def test_a_pack_that_was_changed_does_not_pass(folder: Path, tmp_path: Path, change: Any, told: str) -> None:
    plan = tmp_path / "form.txt"
    plan.write_text("x", encoding="utf-8")
    out = tmp_path / "pack"
    assert here(
        "quality", "validation", "--data", str(folder), "--out", str(out), "--evidence", str(plan)
    ).exit_code == 1  # fmt: skip
    change(out)
    checked = here("quality", "validation", "--check", str(out))
    assert checked.exit_code == 1
    assert told in checked.out
    assert checked.out.endswith("NOT PASSED\n")


def test_a_pack_by_a_key_that_nobody_knows_does_not_pass(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "pack"
    here("quality", "validation", "--data", str(folder), "--out", str(out))
    signature = json.loads((out / "signature.json").read_text(encoding="utf-8"))
    monkeypatch.setenv("LOSTMOTION_STATE", str(tmp_path / "elsewhere"))
    checked = here("quality", "validation", "--check", str(out), "--json")
    assert (checked.exit_code, checked.json["known"], checked.json["problems"]) == (1, False, [])
    assert "DOES NOT KNOW" in here("quality", "validation", "--check", str(out)).out
    assert here("key", "--trust", signature["key"]).exit_code == 0
    assert here("quality", "validation", "--check", str(out)).exit_code == 0


def test_figures_are_those_of_the_studies(folder: Path) -> None:
    parts = (known_part("MASTER:lost_motion:0.502"), known_part("NOBODY:lost_motion:0.5"))
    gages = (
        GageFigure("lost_motion", 8.0, None, 12, "12 parts"),
        GageFigure("lost_motion", 8.0, 31.0, 12, "12 parts"),
        GageFigure("lost_motion", 8.0, 9.0, 4, "12 parts"),
        "lost_motion: every run is of one operator",
    )
    found = list(performance(folder, None, Lot(), parts, gages))
    type_one = [one for one in found if one.asked.startswith("Type 1")]
    assert [one.state for one in type_one] == [OPEN, OPEN]
    assert "has one limit" in type_one[0].found, "no tolerance, and so no Cg: never met by silence"
    assert "NOBODY" in type_one[1].found
    gage = [one for one in found if one.asked.startswith("Gage")]
    assert [one.state for one in gage] == [MET, NOT_MET, NOT_MET, OPEN]
    (due,) = (one for one in found if one.asked.startswith("Master parts"))
    assert due.state == OPEN
    (lot,) = (one for one in found if one.asked == YIELD)
    assert lot.found.startswith("12 units: first-pass 12, final 12 of 12 passed")


def test_a_yield_is_stated_and_not_met_as_nothing_is_required_of_it(tmp_path: Path) -> None:
    for number in range(5):
        value, failed = (0.5 + 0.01 * number, None) if number == 0 else (1.5 + 0.01 * number, "lost_motion")
        store_run(tmp_path, f"U{number}", [metric(value)], day=number, failed=failed)
    (lot,) = (one for one in performance(tmp_path, None, Lot(), (), ()) if one.asked == YIELD)
    assert lot.found.startswith("5 units: first-pass 1, final 1 of 5 passed")
    assert lot.state == STATED


def virtual_gage(data: Path) -> Path:
    """Store a gage study of virtual units: 12 parts, two operators, twice each."""
    for number in range(12):
        for attempt in range(4):
            value = 0.5 + 0.01 * number + 0.0005 * (attempt % 2)
            when = {"day": number + attempt / 10, "operator": "AB"[attempt // 2], "virtual": f"P{number}"}
            store_run(data, f"V{number}", [metric(value)], **when)
    return data


def of_performance(data: Path, out: Path, *words: str) -> dict[str, Any]:
    asked = ("--data", str(data), "--out", str(out), "--gage", "lost_motion", "--recipe", "inverse", *words)
    made = here("quality", "validation", *asked, "--json")
    return {one["asked"].split(":")[0]: one for one in made.json["pack"]["evidence"] if one["part"] == "performance"}


def test_virtual_units_count_where_they_are_asked_for_and_are_marked(tmp_path: Path) -> None:
    data = virtual_gage(tmp_path / "runs")
    real = of_performance(data, tmp_path / "real")["Gage study"]
    assert real["state"] == OPEN
    assert "There are 48 runs of virtual units: add --virtual" in real["found"]
    found = of_performance(data, tmp_path / "virtual", "--virtual")
    assert found["Gage study"]["state"] == MET
    marked = [found[name] for name in ("Gage study", "Process capability", YIELD)]
    assert all(one["found"].startswith("VIRTUAL units: ") for one in marked)


def test_the_time_of_the_lot_holds_for_its_studies_too(folder: Path, tmp_path: Path) -> None:
    early = of_performance(folder, tmp_path / "early", "--until", "2026-01-09T00:00")["Gage study"]
    assert "4 parts, 2 by operator" in early["found"]
    late = of_performance(folder, tmp_path / "late", "--since", "2030-01-01", "--type1", "MASTER:lost_motion:0.502")
    assert (late["Gage study"]["state"], late["Type 1 study of lost_motion on MASTER"]["state"]) == (OPEN, OPEN)
    assert "the chosen lot has no run of a real unit" in late["Gage study"]["found"]
    assert "no valid run" in late["Type 1 study of lost_motion on MASTER"]["found"]


def test_a_figure_is_shown_again_by_the_command_beside_it(tmp_path: Path) -> None:
    data = virtual_gage(tmp_path / "the runs")
    chosen = ("--virtual", "--until", "2026-01-09T00:00")
    found = of_performance(data, tmp_path / "pack", *chosen, "--type1", "V1:lost_motion:0.51")
    for name, shown in (("Process capability", "4 "), (YIELD, "4 of 4"), ("Gage study", "4 parts")):
        words = shlex.split(found[name]["again"].replace("--out DIR", f"--out '{tmp_path / 'again'}'"))
        assert words[0] == "lostmotion"
        told = here(*words[1:], *(("--json",) if "validation" in words else ()))
        assert shown in told.out, (name, words)
    assert "--virtual" in found["Type 1 study of lost_motion on V1"]["again"]


def test_what_was_not_shown_is_open_and_what_went_wrong_is_not_met(tmp_path: Path) -> None:
    found = list(operation(None, (), ()))
    assert [one.state for one in found] == [OPEN, OPEN, OPEN]
    tests = (
        SelfTest("P1", "PASS", "PASS", replay=True),
        SelfTest("worn", "FAIL", "PASS", replay=True),
        SelfTest("soft", "FAIL", "FAIL", replay=False),
        SelfTest("tight", "FAIL", "no verdict", replay=False),
    )
    assert [one.state for one in operation(None, (), tests)][2:] == [MET, NOT_MET, NOT_MET, NOT_MET]
    shipped = list(operation(str(find_bench("virtual")), (), ()))
    assert "a virtual bench" in shipped[0].found
    for numbers, state in (((12, 0, 1), MET), ((12, 1, 0), NOT_MET), ((0, 0, 0), NOT_MET), ((3, 0, 3), NOT_MET)):
        file = tmp_path / "t.xml"
        file.write_text(REPORT.format(*numbers), encoding="utf-8")
        assert report_of_tests(file).state == state, numbers


def test_nothing_open_and_nothing_not_met_is_what_ends_with_0() -> None:
    def pack(*found: str) -> ValidationPack:
        rows = tuple(
            Evidence(part=part, asked="a", found="f", state=one) for part, one in zip(PARTS, found, strict=False)
        )
        return ValidationPack(made="now", data="runs", bench=None, evidence=rows)

    assert fulfilled(pack(MET, ATTACHED))
    assert not fulfilled(pack(MET, OPEN))
    assert not fulfilled(pack(MET, NOT_MET))
    assert counts(pack(MET, OPEN, OPEN)) == {MET: 1, NOT_MET: 0, OPEN: 2, STATED: 0, ATTACHED: 0}


@pytest.mark.long
def test_the_self_test_measures_a_unit_and_replays_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert dict(SELF_TEST)["P1"] == "PASS"
    assert {verdict for unit, verdict in SELF_TEST if unit != "P1"} == {"FAIL"}
    monkeypatch.setattr(validation, "SELF_TEST", (("P1", "PASS"),))
    assert list(validation._self_test()) == [SelfTest("P1", "PASS", "PASS", replay=True)]


@pytest.mark.parametrize(
    "text", ["", "MASTER", "MASTER:lost_motion", "MASTER:lost_motion:x", ":lost_motion:1", "M:l:inf", "M:l:nan"]
)
def test_a_part_that_is_not_named_rightly_is_refused(text: str) -> None:
    with pytest.raises(StationError, match=r"--type1: found .*; expected SERIAL:METRIC:VALUE"):
        known_part(text)


def test_a_serial_number_may_have_colons() -> None:
    assert known_part("A:B:lost_motion:0.5").serial == "A:B"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--tests", "NOTES"), "this is not a test report: "),
        (("--tests", "PAGE"), "its outermost element is html"),
        (("--tests", "NOBODY"), "cannot be read: No such file or directory"),
        (("--evidence", "NOTES", "--evidence", "NOTES"), "two files are called notes.xml; rename one"),
        (("--bench", "NOBODY"), "no such file"),
    ],
)
def test_bad_input_is_refused_and_nothing_is_written(
    folder: Path, tmp_path: Path, words: tuple[str, ...], told: str
) -> None:
    notes, page, out = tmp_path / "notes.xml", tmp_path / "page.xml", tmp_path / "pack"
    notes.write_text("all passed", encoding="utf-8")
    page.write_text("<html/>", encoding="utf-8")
    named = {"NOTES": str(notes), "PAGE": str(page), "NOBODY": str(tmp_path / "nobody.xml")}
    given = [named.get(word, word) for word in words]
    refused = here("quality", "validation", "--data", str(folder), "--out", str(out), *given)
    assert refused.exit_code == 2
    assert told in refused.err
    assert not out.exists()


def test_a_pack_needs_a_place_and_a_check_needs_a_pack(folder: Path, tmp_path: Path) -> None:
    assert "--out is missing" in here("quality", "validation", "--data", str(folder)).err
    assert "this is not a validation pack" in here("quality", "validation", "--check", str(tmp_path)).err
    assert here("quality", "validation", "--data", str(tmp_path / "no"), "--out", str(tmp_path / "x")).exit_code == 2
