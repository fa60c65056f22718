"""Below the metrics: gates, notes, the kind of U; the list on narrow terminals; help that answers at once."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from rich.console import Console

from station.reports.html_page import rule_text
from station.reports.result_notes import MOST_NOTES, gate_lines, note_lines, summary_line
from station.run.run_list import print_runs

ROOT = Path(__file__).parents[2]
GATES = [
    {"id": "drift", "figure": 0.31, "limit": 0.1, "unit": "%", "passed": False, "text": "too much"},
    {"id": "lag", "figure": 0.0, "limit": 0.1, "unit": "%", "passed": True, "text": "fine"},
    {"id": "clipping", "figure": None, "limit": 1.0, "unit": "%", "passed": None, "text": "no sensor"},
]


def test_each_failed_gate_is_one_line() -> None:
    assert gate_lines({"gates": GATES}) == ["drift: 0.31 %, limit 0.1 %"]
    assert gate_lines({}) == []


def test_gates_in_order_are_a_count() -> None:
    metrics = [{"uncertainty": None, "id": "windup"}]
    assert summary_line({"metrics": metrics, "gates": GATES[1:]}).endswith("1 validity gates in order, 1 do not apply.")
    assert "gates" not in summary_line({"metrics": metrics, "gates": GATES})
    assert summary_line({"metrics": []}) == ""


def test_notes_that_matter_are_warnings_and_corrections() -> None:
    stages = [
        {"stage": "drift", "text": "drift taken out", "applied": True},
        {"stage": "binning", "text": "binned", "applied": True},
        {"stage": "fixture", "text": "nothing to subtract", "applied": False},
    ]
    notes = ["recipe x is not the one of run y", "drift taken out", "binned", "nothing to subtract"]
    assert note_lines({"notes": notes, "stages": stages}) == ["recipe x is not the one of run y", "drift taken out"]
    assert note_lines({"notes": notes}) == ["recipe x is not the one of run y"]
    many = {"notes": [f"recipe {number}" for number in range(9)]}
    assert len(note_lines(many)) == MOST_NOTES + 1
    assert note_lines({}) == []


def rows() -> list[dict[str, Any]]:
    one: dict[str, Any] = {"run": "20260102T030405.678Z-SN-0000001", "serial": "SN-0000001", "attempt": 1}
    one |= {"recipe": "rv-40e-121-inverse", "revision": 1, "state": "complete", "verdict": "NOT DECIDABLE"}
    one |= {"records": 154142, "scanning": None}
    damaged = one | {"run": "x", "serial": None, "recipe": None, "state": "damaged", "verdict": None, "attempt": None}
    return [one, one | {"state": "altered", "verdict": None}, damaged]


@pytest.mark.parametrize(("width", "fits"), [(130, True), (80, True), (50, True), (80, False)])
def test_no_run_id_is_cut_off_and_no_line_is_too_long(width: int, fits: bool) -> None:  # noqa: FBT001
    stream = io.StringIO()
    print_runs(Console(file=stream, width=width), rows(), fits=fits)
    text = stream.getvalue()
    assert text.count("20260102T030405.678Z-SN-0000001") == 2
    for word in ("NOT DECIDABLE", "altered", "damaged", "rv-40e-121-inverse r1"):
        assert word in text
    if fits:
        assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    assert ("scans" in text) == (width == 130 or not fits)


def test_the_help_loads_nothing_heavy() -> None:
    heavy = "numpy scipy matplotlib pydantic pyarrow reportlab rich.table analysis recipes canopen"
    code = f"import sys, station.cli; print([name for name in {heavy.split()!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, text=True, capture_output=True, check=True)
    assert done.stdout.strip() == "[]"


def test_bad_input_of_a_statistic_is_json_for_a_program(tmp_path: Path) -> None:
    path = tmp_path / "v.csv"
    path.write_text("value\n1\nx\n3\n")
    done = here("capability", str(path), "--max", "9", "--json")
    assert done.exit_code == 2
    assert "row 2, column value: found 'x'" in done.err
    assert "row 2, column value" in done.json["errors"][0]["found"]


def test_wider_validity_limits_stand_above_the_other_notes() -> None:
    gates = [
        {"id": "drift", "figure": 0.1, "limit": 100.0, "unit": "%", "passed": True, "text": "drift"},
        {"id": "repeat", "figure": 0.1, "limit": 2.0, "unit": "%", "passed": True, "text": "repeat"},
        {"id": "points_per_bin", "figure": 9.0, "limit": 1.0, "unit": "samples", "passed": True, "text": "points"},
    ]
    first, *_ = note_lines({"gates": gates, "stages": [{"name": "a", "text": "b"}], "notes": ["other"]})
    assert first == (
        "validity limits of the recipe wider than usual (in brackets): drift 100 % (1 %), "
        "points_per_bin 1 samples (3 samples)"
    )
    assert note_lines({"gates": gates[1:2]}) == []


@pytest.mark.parametrize("rule", ["simple", "guard_band"])
def test_what_simple_acceptance_decides_within_its_uncertainty_is_said(rule: str) -> None:
    def side(value: float, uncertainty: float | None) -> dict[str, Any]:
        return {"value": value, "uncertainty": uncertainty, "verdict": "PASS"}

    metric: dict[str, Any] = {"id": "backlash_width_3pct", "branch": "both", "torque_nm": None}
    metric |= {"limits": {"min": None, "max": 1.0}, "sides": {"+": side(0.97, 0.16), "-": side(0.97, 0.02)}}
    free = metric | {"id": "windup", "limits": {"min": None, "max": None}, "sides": {"both": side(9.0, 0.1)}}
    unknown = metric | {"id": "lost_motion", "sides": {"both": side(0.99, None)}}
    result = {"decision": {"rule": rule, "guard_factor": 0.0}, "metrics": [metric, free, unknown]}
    said = (
        "nearer to its limit than its uncertainty, which rule simple leaves out: "
        "backlash_width_3pct side + 0.97 ± 0.16 (limit ≤ 1)"
    )
    assert note_lines(result) == ([said] if rule == "simple" else [])
    assert (said[1:] in rule_text(result)) == (rule == "simple")


def sided(name: str, *sides: str, limit: float | None = 108.0, **changes: Any) -> dict[str, Any]:
    """A metric of a result whose sides are those; the first one is its headline."""
    row = {"value": 115.0, "uncertainty": 0.5, "verdict": "PASS"}
    found: dict[str, Any] = {"id": name, "branch": "mean", "torque_nm": None, "choices": [], "side": sides[0]}
    found |= {"limits": {"min": limit, "max": None}, "sides": dict.fromkeys(sides, row)}
    return found | changes


@pytest.mark.parametrize(
    ("metrics", "said"),
    [
        ([sided("spring_constant", "-"), sided("k1", "+", branch="load")], "spring_constant side −, k1 load side +"),
        ([sided("spring_constant", "+", "-")], ""),
        ([sided("windup", "both")], ""),
        ([sided("gear_clearance", "both", "+", "-")], ""),
        ([sided("spring_constant", "-", limit=None)], ""),
        ([sided("torque_ratio_offset", "-", limit=0.0)], "torque_ratio_offset side −"),
        ([sided("spring_constant", "-"), sided("spring_constant", "+")], ""),
        ([sided("spring_constant", "-"), sided("spring_constant", "+", limit=None)], "spring_constant side −"),
        ([sided("k1", "-", branch="load"), sided("k1", "+", branch="unload")], "k1 load side −, k1 unload side +"),
        ([{key: value for key, value in sided("k1", "-").items() if key not in ("sides", "choices")}], ""),
        ([{key: value for key, value in sided("k1", "-").items() if key != "limits"}], ""),
    ],
)
def test_what_was_judged_on_one_side_of_two_is_said(metrics: list[dict[str, Any]], said: str) -> None:
    """The other side of such a metric may be weak, and the verdict is a PASS: a reader must see what it did not see."""
    result = {"decision": {"rule": "guard_band", "guard_factor": 1.0}, "metrics": metrics}
    assert note_lines(result) == ([f"judged on one side alone: {said}"] if said else [])
    assert (f"Judged on one side alone: {said}." in rule_text(result)) == bool(said)
