"""AQDEF files: read back by another program with the same values, and malformed ones refused by our own checker."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from aqdef_reader import by_another_program
from lostmotion_command import here
from stored_runs import START, metric, store_run

from definitions.metrics import METRICS
from station.quality.dfq.check import DfqError, DfqFile, checked_dfq
from station.quality.dfq.fields import ENCODING, FIELDS, IN_A_VALUE, INSTEAD, LIMITS
from station.quality.dfq.write import dfq_of_lot
from station.store.quality.lot import Lot, production

LOT = Lot(recipe="inverse")
FROM = 10
"""Days from the 15th on: the other program takes the 5th of January for the 1st of May, against the format."""

VALUES = (0.1 + 0.2, 1.0 / 3.0, 0.4, 5.0e-7)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four units and one measured twice, with a metric on two sides, one with both limits, and one without a value."""
    data = tmp_path_factory.mktemp("dfq") / "runs"
    for number, value in enumerate(VALUES):
        store_run(data, f"SN-{number}", both_metrics(value, None if number == 2 else 115.0 + number), day=FROM + number)
    store_run(data, "AGAIN", both_metrics(1.5, 115.0), day=FROM + 5, failed="lost_motion")
    store_run(data, "AGAIN", both_metrics(0.5, 115.0), day=FROM + 6)
    store_run(data, "MASTER", both_metrics(9.0, 9.0), day=FROM + 7, master="PASS")
    return data


def both_metrics(lost_motion: float, stiffness: float | None) -> list[dict[str, object]]:
    limits = {"min": 108.0, "max": 130.5}
    changes = {"id": "spring_constant", "unit": "N·m/arcmin", "side": "both", "sides": {}, "limits": limits}
    return [metric(lost_motion), metric(stiffness, **changes)]


@pytest.fixture(scope="module")
def good(folder: Path) -> bytes:
    with production(folder) as look:
        return dfq_of_lot(look, LOT, "a test").files[0].content


@pytest.mark.parametrize("name", METRICS)
def test_every_definition_and_unit_can_be_written(name: str, tmp_path: Path) -> None:
    row = METRICS[name]
    store_run(tmp_path, "SN", [metric(0.4, id=name, definition=row.text, unit=row.unit, estimator=row.estimator)])
    with production(tmp_path) as look:
        told = checked_dfq(dfq_of_lot(look, LOT, "a test").files[0].content).characteristics[0]["K2900"]
    assert len(told) == len(row.text)
    assert told.translate(INSTEAD) == told


def test_a_lot_is_read_back_with_value_limits_serial_and_events(good: bytes) -> None:
    ours: DfqFile = checked_dfq(good)
    part = by_another_program(good).get_part(0)
    assert [row.serial for row in ours.rows] == ["SN-0", "SN-1", "SN-2", "SN-3", "AGAIN", "AGAIN"]
    assert len(ours.characteristics) == 3
    for number, one in enumerate(ours.characteristics, start=1):
        theirs = part.get_characteristic_by_index(number)
        for key, value in one.items():
            assert str(theirs.get_data(key)) == value
        there = [row.values[number - 1] for row in ours.rows if row.values[number - 1].value is not None]
        for own, found in zip(there, theirs.get_measurements(), strict=True):
            assert (found.value, found.attribute) == (own.value, own.attribute)
            assert found.datetime == own.moment
            assert found.event == ",".join(map(str, own.events))
    first = [row.values[0] for row in ours.rows]
    assert [one.value for one in first] == pytest.approx([*VALUES, 1.5, 0.5], rel=1e-11)
    assert [one.events for one in first] == [(), (), (), (), (2, 4), (1,)]
    assert ours.rows[2].values[2].value is None
    limits = [{key: one.get(key) for key in (*LIMITS, *LIMITS.values())} for one in ours.characteristics]
    assert limits[0] == {"K2110": "0", "K2111": "1", "K2120": "2", "K2121": "1"}, "no backlash is below zero"
    assert limits[2] == {"K2110": "108", "K2111": "130.5", "K2120": "1", "K2121": "1"}
    assert first[0].moment == datetime(2026, 1, 15, 8)  # noqa: DTZ001 - UTC by the format


@pytest.mark.parametrize(
    ("name", "limits", "kinds"),
    [
        ("lost_motion", {"max": 1.0}, {"K2110": "0", "K2111": "1", "K2120": "2", "K2121": "1"}),
        ("lost_motion", {"min": 0.1, "max": 1.0}, {"K2110": "0.1", "K2111": "1", "K2120": "1", "K2121": "1"}),
        ("lost_motion", {}, {"K2110": None, "K2111": None, "K2120": "0", "K2121": "0"}),
        ("spring_constant", {"min": 108.0}, {"K2110": "108", "K2111": None, "K2120": "1", "K2121": "0"}),
        ("grade", {"min": 1.0}, {"K2110": "1", "K2111": "2", "K2120": "1", "K2121": "2"}),
        ("grade", {"max": 1.0}, {"K2110": "1", "K2111": "1", "K2120": "2", "K2121": "1"}),
        ("torque_ratio_offset", {"max": 1.0}, {"K2110": None, "K2111": "1", "K2120": "0", "K2121": "1"}),
    ],
)
def test_opposite_the_one_limit_stands_the_natural_one_of_the_metric(
    name: str, limits: dict[str, float], kinds: dict[str, str | None], tmp_path: Path
) -> None:
    store_run(tmp_path, "SN", [metric(0.4, id=name, unit=METRICS[name].unit, limits=limits, side="both", sides={})])
    with production(tmp_path) as look:
        content = dfq_of_lot(look, LOT, "a test").files[0].content
    theirs = by_another_program(content).get_part(0).get_characteristic_by_index(1)
    for key, value in kinds.items():
        read = theirs.get_data(key)
        assert (None if read is None else str(read)) == value, key


def test_one_run_and_a_lot_by_the_commands(folder: Path, tmp_path: Path) -> None:
    one, lot = tmp_path / "one.dfq", tmp_path / "lot.dfq"
    told = here("export", "SN-1", "--data", str(folder), "--format", "dfq", "--out", str(one), "--json")
    assert (told.exit_code, told.json["runs"]) == (0, 1)
    assert [row.serial for row in checked_dfq(one.read_bytes()).rows] == ["SN-1"]
    assert here("quality", "dfq", "--data", str(folder), "--out", str(lot)).exit_code == 0
    assert len(checked_dfq(lot.read_bytes()).rows) == 6


def by_limits(data: Path) -> None:
    """Store three units by revision 2 and limit 1, two by revision 3 and 0.3, and one of these on another fit."""
    for number in range(5):
        revision, highest = (2, 1.0) if number < 3 else (3, 0.3)
        one = metric(0.4, limits={"min": None, "max": highest})
        store_run(data, f"M-{number}", [one], day=FROM + number, revision=revision)
    changed = metric(0.4, limits={"min": None, "max": 0.3}, band=0.04)
    store_run(data, "M-5", [changed], day=FROM + 5, revision=3)


def test_runs_by_other_limits_or_definitions_get_files_of_their_own(tmp_path: Path) -> None:
    data, lot = tmp_path / "runs", tmp_path / "lot.dfq"
    by_limits(data)
    told = here("quality", "dfq", "--data", str(data), "--out", str(lot))
    assert told.exit_code == 0, told.err
    assert not lot.exists()
    assert f"{tmp_path / 'lot-1.dfq'}: 3 runs, 2 characteristics; RV, inverse revision 2" in told.out
    found = [checked_dfq((tmp_path / f"lot-{number}.dfq").read_bytes()) for number in (1, 2, 3)]
    assert [one.part["K1002"] for one in found] == [f"inverse revision {number}" for number in (2, 3, 3)]
    assert [one.characteristics[0]["K2111"] for one in found] == ["1", "0.3", "0.3"]
    assert [[row.serial for row in one.rows] for one in found] == [["M-0", "M-1", "M-2"], ["M-3", "M-4"], ["M-5"]]
    of_json = here("quality", "dfq", "--data", str(data), "--out", str(lot), "--json").json
    assert [one["runs"] for one in of_json["files"]] == [3, 2, 1]


def test_a_file_of_the_whole_name_is_not_left_beside_its_parts(tmp_path: Path) -> None:
    data, lot = tmp_path / "runs", tmp_path / "lot.dfq"
    by_limits(data)
    lot.write_bytes(b"of yesterday")
    told = here("quality", "dfq", "--data", str(data), "--out", str(lot))
    assert told.exit_code == 2
    assert "this lot needs 3 files, lot-1.dfq and so on" in told.err
    assert [path.name for path in tmp_path.glob("*.dfq")] == ["lot.dfq"]


def test_a_run_that_lacks_a_metric_is_in_the_file_of_those_that_have_it(tmp_path: Path) -> None:
    for number in range(3):
        store_run(tmp_path, f"U{number}", both_metrics(0.4, 115.0)[: 2 - number % 2], day=FROM + number)
    store_run(tmp_path, "NONE", [], day=FROM + 4, reasons=["measurement invalid: drift"])
    with production(tmp_path) as look:
        found = dfq_of_lot(look, LOT, "a test")
    assert [(one.runs, one.characteristics) for one in found.files] == [(3, 3)]
    assert found.left_out == 1
    rows = checked_dfq(found.files[0].content).rows
    assert [row.values[2].value for row in rows] == [115.0, None, 115.0]


@pytest.mark.parametrize("looked", [False, True])
def test_an_altered_record_is_refused_as_a_file_cannot_say_that_it_is_one(tmp_path: Path, *, looked: bool) -> None:
    data, out = tmp_path / "runs", tmp_path / "one.dfq"
    run = store_run(data, "SN", [metric(0.4)])
    words = ("export", run.id, "--data", str(data), "--format", "dfq", "--out", str(out))
    assert here(*words).exit_code == 0
    out.unlink()
    result = (run.folder / "result.json").read_text(encoding="utf-8")
    (run.folder / "result.json").write_text(result.replace("0.4", "0.3"), encoding="utf-8")
    if looked:
        here("capability", "--data", str(data))  # the store knows it since
    told = here(*words)
    assert (told.exit_code, out.exists()) == (3, False), told
    for text in ("RECORD ALTERED", "record altered: result.json: was changed", "was not written"):
        assert text in told.err
    assert here(*words, "--json").json["file"] is None


@pytest.mark.parametrize("serial", ["S" * 41, "Ω-1"])
def test_a_serial_number_that_does_not_fit_is_named_with_its_run_and_what_to_do(tmp_path: Path, serial: str) -> None:
    """Of a lot of thousands nobody finds it by the line of a file that was not written."""
    data, runs = tmp_path / "runs", list[str]()
    for day, one in enumerate(("SN-1", serial, "SN-2", serial)):
        runs.append(store_run(data, one, [metric(0.5)], day=day).id)
    found = here("quality", "dfq", "--data", str(data), "--out", str(tmp_path / "x.dfq"))
    assert found.exit_code == 2
    for run in (runs[1], runs[3]):
        assert f"run {run}, serial number '{serial}': K0014: " in found.err
    assert "--since and --until" in found.err
    assert "line " not in found.err
    first = (START + timedelta(days=0.5)).isoformat()
    apart = here("quality", "dfq", "--data", str(data), "--out", str(tmp_path / "x.dfq"), "--until", first)
    assert (apart.exit_code, (tmp_path / "x.dfq").is_file()) == (0, True)


@pytest.mark.parametrize(
    ("serial", "said"), [("S" * 41, "K0014: 41 characters; at most 40"), ("Ω-1", "the sign 'Ω' cannot be written")]
)
def test_what_has_no_place_in_the_format_is_refused_and_not_cut(tmp_path: Path, serial: str, said: str) -> None:
    store_run(tmp_path / "runs", serial, [metric(0.5)])
    found = here("quality", "dfq", "--data", str(tmp_path / "runs"), "--out", str(tmp_path / "x.dfq"))
    assert found.exit_code == 2
    assert said in found.err
    assert not (tmp_path / "x.dfq").exists()


def swap(old: str, new: str) -> Callable[[str], str]:
    def changed(text: str) -> str:
        assert old in text, old
        return text.replace(old, new, 1)

    return changed


VALUE = "0.3\x140\x1415.01.2026/08:00:00\x14"
MALFORMED: dict[str, tuple[Callable[[str], str], str]] = {
    "empty": (lambda _: "", "cut short"),
    "cut in the last line": (lambda text: text[:-1], "cut short"),
    "cut in the middle": (lambda text: text[: len(text) // 2], "line"),
    "lines of another system": (lambda text: text.replace("\r\n", "\n"), "carriage return"),
    "an empty line": (swap("K1001/1", "\r\nK1001/1"), "an empty line"),
    "no number of characteristics": (swap("K0100 3\r\n", ""), "K0100: is missing"),
    "number not first": (lambda text: text.replace("K0100 3\r\n", "", 1).replace("K2001/1", "K0100 3\r\nK2001/1", 1),
                         "K0100: stands once, in the first line"),
    "number twice": (swap("K1001/1", "K0100 3\r\nK1001/1"), "in the first line"),
    "number that is none": (swap("K0100 3", "K0100 three"), "expected a whole number"),
    "number too large": (swap("K0100 3", "K0100 4"), "3 values for 4 characteristics"),
    "number too small": (swap("K0100 3", "K0100 2"), "expected a characteristic from 1 to 2"),
    "number zero": (swap("K0100 3", "K0100 0"), "1 or more"),
    "number of many digits": (swap("K0100 3", "K0100 999999"), "at most 5"),
    "no part number": (swap("K1001/1 RV\r\n", ""), "K1001: is missing"),
    "empty part number": (swap("K1001/1 RV", "K1001/1  "), "K1001: is empty"),
    "part number too long": (swap("K1001/1 RV", "K1001/1 " + 31 * "R"), "at most 30"),
    "part number twice": (swap("K1001/1 RV", "K1001/1 RV\r\nK1001/1 RV"), "K1001: stands twice"),
    "second part": (swap("K1001/1", "K1001/2"), "there is one part"),
    "unknown field": (swap("K1001/1", "K9999/1"), "K9999: is no field"),
    "no blank behind a key": (swap("K2142/1 ", "K2142/1"), "expected a key such as"),
    "key of three digits": (swap("K2142/1", "K214/1"), "expected a key such as"),
    "characteristic without index": (swap("K2002/1", "K2002"), "from 1 to 3"),
    "characteristic zero": (swap("K2002/1", "K2002/0"), "from 1 to 3"),
    "characteristic beyond": (swap("K2002/1", "K2002/4"), "from 1 to 3"),
    "no unit": (swap("K2142/1 arcmin\r\n", ""), "K2142/1: is missing"),
    "control character": (swap("K2142/1 arcmin", "K2142/1 arc\x07min"), "control character"),
    "same number twice": (swap("K2001/2 2", "K2001/2 1"), "same number"),
    "kind that is none of ours": (swap("K2004/1 0", "K2004/1 1"), "expected 0"),
    "limit that is no number": (swap("K2111/1 1", "K2111/1 one"), "expected a number"),
    "limit with a decimal comma": (swap("K2111/3 130.5", "K2111/3 130,5"), "with a point"),
    "limit that is infinite": (swap("K2111/1 1", "K2111/1 1e999"), "expected a number"),
    "limit where none is": (swap("K2121/1 1", "K2121/1 0"), "K2111/1: a limit stands exactly where K2121 is 1 or 2"),
    "natural limit without its value": (swap("K2110/1 0\r\n", ""), "K2110/1: a limit stands exactly"),
    "natural limits alone": (swap("K2121/1 1", "K2121/1 2"), "K2120/1: a natural limit stands only opposite"),
    "kind of limit that is none": (swap("K2120/1 2", "K2120/1 3"), "expected 0 or 1 or 2"),
    "specified limit below the natural one": (swap("K2111/1 1", "K2111/1 -1"), "K2110/1: 0 is above the upper limit"),
    "no limit where one is": (swap("K2111/1 1\r\n", ""), "K2111/1: a limit stands exactly"),
    "limits exchanged": (swap("K2110/3 108", "K2110/3 131"), "is above the upper limit"),
    "field behind the values": (lambda text: text + "K2900/1 late\r\n", "behind the first line of values"),
    "value that is no number": (swap(VALUE, VALUE.replace("0.3", "0.3x")), "expected a number"),
    "value that is not there": (swap(VALUE, VALUE.replace("0.3", "")), "K0001: is empty"),
    "value that is not a number by name": (swap(VALUE, VALUE.replace("0.3", "nan")), "expected a number"),
    "attribute unknown": (swap(VALUE, VALUE.replace("\x140\x14", "\x147\x14")), "expected 0 or 255"),
    "attribute left out": (swap(VALUE, VALUE.replace("\x140\x14", "\x14")), "3 entries; expected 4"),
    "month thirteen": (swap("15.01.2026", "15.13.2026"), "a date and time such as"),
    "day of another country": (swap("15.01.2026", "2026-01-15"), "a date and time such as"),
    "event that is none": (swap(VALUE, VALUE + "99"), "numbers of quality events"),
    "a value too many": (swap("\r\nK0014/0 SN-0", "\x0f" + VALUE + "\r\nK0014/0 SN-0"), "4 values for 3"),
    "no serial number": (swap("K0014/0 SN-0\r\n", ""), "without a K0014"),
    "empty serial number": (swap("K0014/0 SN-0", "K0014/0  "), "K0014: is empty"),
    "serial number of one characteristic": (swap("K0014/0 SN-0", "K0014/1 SN-0"), "index 0"),
    "serial number twice": (swap("K0014/0 SN-0", "K0014/0 SN-0\r\nK0014/0 SN-0"), "behind no values"),
    "no values at all": (lambda text: text[: text.index(VALUE)], "there are no values"),
    "last serial number missing": (lambda text: text[: text.rindex("K0014/0")], "the last values have no K0014"),
}  # fmt: skip
"""Files that other readers take, and what is wrong with each."""


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_file_is_refused(good: bytes, name: str) -> None:
    change, said = MALFORMED[name]
    with pytest.raises(DfqError, match="line") as refused:
        checked_dfq(change(good.decode(ENCODING)).encode(ENCODING))
    assert any(said in problem for problem in refused.value.problems), refused.value.problems


def test_a_byte_of_no_character_is_refused(good: bytes) -> None:
    assert len(MALFORMED) >= 40
    with pytest.raises(DfqError, match="byte 9 is no character"):
        checked_dfq(good[:8] + b"\x81" + good[9:])


def test_every_field_says_what_it_is() -> None:
    assert all(row.meaning and row.length > 0 for row in FIELDS.values())
    assert all(FIELDS[key].level == "value" for key in IN_A_VALUE)
    assert all(FIELDS[key].form == "number" and FIELDS[kind].choices for key, kind in LIMITS.items())
