"""Below the metrics: gates, notes, the kind of U; the list on narrow terminals; help that answers at once."""

from __future__ import annotations

import io
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from made_documents import checks, metric, result
from rich.console import Console

from definitions.checks import CHECKS
from station.cli.say import Grid, print_grid
from station.documents.entries import plain
from station.documents.manifest import MASTER
from station.plain_text import HANDLER
from station.reports.content import checks_line
from station.reports.headline import remaining_reasons
from station.reports.html_page import rule_text
from station.reports.result_notes import MOST_NOTES, check_lines, note_lines, summary_lines
from station.reports.result_view import metrics_table, result_console, show_result, titled_name, verdict_panel
from station.run.run_list import RunRow, print_runs

ROOT = Path(__file__).parents[3]
GATES = [
    {"id": "drift", "figure": 0.31, "limit": 0.1, "unit": "%", "passed": False, "text": "too much"},
    {"id": "lag", "figure": 0.0, "limit": 0.1, "unit": "%", "passed": True, "text": "fine"},
    {"id": "clipping", "figure": None, "limit": 1.0, "unit": "%", "passed": None, "text": "no sensor"},
]


def test_each_failed_check_is_one_line_with_title_figure_limit_and_id() -> None:
    (line,) = check_lines(result(gates=GATES))
    assert all(part in line for part in (CHECKS["drift"].title, "0.31 %", "0.1 %", "drift"))
    assert check_lines(result()) == []
    unknown = check_lines(result(gates=[GATES[0] | {"id": "of_an_older_version"}]))
    assert unknown == ["0.31 %, limit 0.1 %  of_an_older_version"]


def test_checks_are_counts() -> None:
    assert checks_line(checks(*GATES)) == "1 check failed, 1 check passed, 1 not applicable"
    assert checks_line(checks(*[GATES[1]] * 29, *[GATES[2]] * 6)) == "29 checks passed, 6 not applicable"
    assert checks_line([]) == ""
    assert checks_line(checks(*GATES)) in summary_lines(result(metrics=[metric()], gates=GATES))
    assert summary_lines(result(gates=GATES)) == []


def test_what_the_checks_leave_open_is_said_with_its_size() -> None:
    unseen = [
        {"id": "ratio_agreement", "figure": 1.274, "unit": "%", "text": "gain"},
        {"id": "torque_bend", "figure": None, "unit": "N·m", "text": "hysteresis"},
    ]
    (line,) = [one for one in summary_lines(result(metrics=[metric()], not_excluded=unseen)) if "cannot exclude" in one]
    assert "gain: up to 1.3 %" in line
    assert "hysteresis: not checked" in line
    assert not any("cannot exclude" in one for one in summary_lines(result(metrics=[metric()])))


@pytest.mark.parametrize("in_budget", [True, False])
def test_it_is_said_whether_what_is_left_open_is_in_u(*, in_budget: bool) -> None:
    unseen = [{"id": "ratio_agreement", "figure": 1.3, "unit": "%", "text": "gain", "in_budget": in_budget}]
    (line,) = [one for one in summary_lines(result(metrics=[metric()], not_excluded=unseen)) if "cannot exclude" in one]
    assert ("not in U" in line) is not in_budget


@pytest.mark.parametrize(
    ("notes", "run", "said"), [((), "R", True), ((f"{MASTER}M-1 read",), "R", False), ((), None, False)]
)
def test_a_bench_without_a_master_part_is_told_what_one_would_show(
    notes: tuple[str, ...], run: str | None, *, said: bool
) -> None:
    unseen = [{"id": "drive_torque_agreement", "figure": 10.0, "unit": "%", "text": "gain of both torques alike"}]
    shown = replace(result(metrics=[metric()], not_excluded=unseen), notes=notes, run=run)
    (line,) = [one for one in summary_lines(shown) if "cannot exclude" in one]
    assert ("master_parts" in line) is said


def test_a_metric_on_screen_has_its_title_with_its_id_below() -> None:
    assert titled_name(metric(title="Wind-up")).plain == "Wind-up\nwindup"
    assert titled_name(metric(title="")).plain == "windup"


def test_reasons_are_shown_by_title_with_the_id_behind() -> None:
    reasons = ["windup, side -: 9 arcmin", "measurement invalid: drift: 2 %", "measurement invalid: lost", "gone: 1"]
    title = CHECKS["drift"].title
    assert remaining_reasons(result(metrics=[metric(title="Wind-up")], reasons=reasons)) == [
        "Wind-up, side − [windup]: 9 arcmin",
        f"Measurement invalid. {title} [drift]: 2 %",
        *reasons[2:],
    ]


@pytest.mark.parametrize(("passed", "notes"), [(None, 1), (True, 0), (False, 0)])
def test_a_gain_that_nothing_held_against_the_ratio_is_said_beside_the_verdict(
    *, passed: bool | None, notes: int
) -> None:
    gate = {"id": "ratio_agreement", "figure": None, "limit": 0.25, "unit": "%", "passed": passed, "text": "one torque"}
    assert len([one for one in note_lines(result(gates=[gate])) if "not cross-checked" in one]) == notes


def test_notes_that_matter_are_warnings_and_corrections() -> None:
    stages = [
        {"stage": "drift", "text": "drift taken out", "applied": True},
        {"stage": "binning", "text": "binned", "applied": True},
        {"stage": "fixture", "text": "nothing to subtract", "applied": False},
    ]
    notes = ["recipe x is not the one of run y", "drift taken out", "binned", "nothing to subtract"]
    assert note_lines(result(notes=notes, stages=stages)) == ["recipe x is not the one of run y", "drift taken out"]
    assert note_lines(result(notes=notes)) == ["recipe x is not the one of run y"]
    many = result(notes=[f"recipe {number}" for number in range(9)])
    assert len(note_lines(many)) == MOST_NOTES + 1
    odd = "recipe r.yaml:4:3: metrics[0].min: found 'lost_motion' with min alone; usual is a max, the side that decides"
    assert odd in note_lines(result(notes=[*(f"other {number}" for number in range(9)), odd], stages=stages))
    assert note_lines(result()) == []


@pytest.mark.parametrize("name", ["[/b]x", "[red]", ":smile:"])
def test_brackets_and_colons_of_names_are_shown_as_they_are(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    console = result_console()
    console.print(f"measured by {name}", highlight=False)
    show_result(console, result(serial=f"SN{name}", operator=name, record=f"/data/{name}/run"))
    said = capsys.readouterr().out
    for text in (f"measured by {name}", f"SN{name}", f"record  /data/{name}/run"):
        assert text in said


def rows() -> list[RunRow]:
    one = RunRow(
        run="20260102T030405.678Z-SN-0000001",
        serial="SN-0000001",
        attempt=1,
        recipe="rv-40e-121-inverse",
        revision=1,
        state="complete",
        verdict="NOT DECIDABLE",
        records=154142,
    )
    return [one, replace(one, state="altered", verdict=None), RunRow(run="x", state="damaged", records=154142)]


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


WHY = (
    "backlash_width_3pct side + 1.166 is above its limit, and the attempt before was stopped by hand at " + "9 N·m " * 9
)
GRIDS = {
    "numbers": Grid(
        ("metric", "limit", "n", "mean", "Cpk", "95%", "no verdict", "other side"),
        [(f"stiffness_{one}", "≤ 1 arcmin", "10", f"{one}04.8 N·m/arcmin", "45.1", f"−0.0{one}31 … 0.37{one}",
          "0", "0.156") for one in range(3, 7)],
        right=(2, 3, 4, 5, 6, 7),
    ),
    "texts": Grid(
        ("run", "serial", "attempt", "recipe", "verdict", "problems, attempts before"),
        [(f"20261127T113311.632Z-MASTER-{one}", f"MASTER-{one}", str(one), "rv-40e-121-quick", "NOT DECIDABLE", WHY)
         for one in range(10, 14)],
        right=(2,),
    ),
    "one word": Grid(("", ""), [("file", "/runs/" + "long" * 60)]),
    "no rows": Grid(("run", "why", "n"), [], right=(2,)),
    "nothing": Grid(("run", "why"), [("", ""), ("x", "")], right=(1,)),
}  # fmt: skip


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("width", [40, 80, 110, 200])
def test_no_cell_of_a_table_is_cut_and_no_number_is_folded(name: str, width: int, *, terminal: bool) -> None:
    stream, grid = io.StringIO(), GRIDS[name]
    print_grid(Console(file=stream, width=width, force_terminal=terminal, color_system=None), grid)
    text = stream.getvalue()
    said, cells = Counter(word.rstrip(";") for word in text.split()), [cell for row in grid.rows for cell in row]
    assert Counter(" ".join(cells).split()) <= said
    assert all(row[number] in text for row in grid.rows for number in grid.right)
    lines = text.splitlines()
    if terminal and name != "one word":
        assert max((len(line.rstrip()) for line in lines), default=0) <= width
    elif not terminal and WHY not in cells:
        assert len(lines) == 1 + len(list(grid.rows))


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
    (told,) = done.json["errors"]
    assert (told["file"], told["row"], told["column"], told["found"]) == (str(path), 2, "value", "'x'")


def test_wider_validity_limits_stand_above_the_other_notes() -> None:
    gates = [
        {"id": "drift", "figure": 0.1, "limit": 100.0, "unit": "%", "passed": True, "text": "drift"},
        {"id": "repeat", "figure": 0.1, "limit": 2.0, "unit": "%", "passed": True, "text": "repeat"},
        {"id": "points_per_bin", "figure": 9.0, "limit": 1.0, "unit": "samples", "passed": True, "text": "points"},
    ]
    first, *_ = note_lines(result(gates=gates, stages=[{"name": "a", "text": "b"}], notes=["other"]))
    assert first == (
        "validity limits wider than usual in the recipe (usual ones in brackets): drift 100 % (1 %), "
        "points_per_bin 1 samples (3 samples)"
    )
    assert note_lines(result(gates=gates[1:2])) == []


NARROW = "guard_factor {:g}, usual is 0.82 or more"
FAR, NEAR = "backlash_width_3pct side + 0.90 ± 0.16 (limit ≤ 1)", "backlash_width_3pct side − 0.97 ± 0.16 (limit ≤ 1)"


@pytest.mark.parametrize(
    ("rule", "factor", "why", "names"),
    [
        ("simple", 0.0, "rule simple ignores U", [FAR, NEAR]),
        ("simple", 0.8225, "rule simple ignores U", [FAR, NEAR]),
        ("guard_band", 0.0, NARROW.format(0), [FAR, NEAR]),
        ("guard_band", 0.5, NARROW.format(0.5), [FAR]),
        ("guard_band", 0.82, "", []),
        ("guard_band", 1.0, "", []),
    ],
)
def test_what_is_decided_within_its_uncertainty_is_said(rule: str, factor: float, why: str, names: list[str]) -> None:
    def side(value: float, uncertainty: float | None) -> dict[str, Any]:
        return {"value": value, "uncertainty": uncertainty, "verdict": "PASS"}

    limits = {"min": None, "max": 1.0}
    sides = {"+": side(0.9, 0.16), "-": side(0.97, 0.16)}
    both = metric(id="backlash_width_3pct", branch="both", limits=limits, sides=sides)
    known = metric(id="gear_clearance", branch="both", limits=limits, sides={"both": side(0.97, 0.02)})
    free = metric(id="windup", branch="both", sides={"both": side(9.0, 0.1)})
    unknown = metric(id="lost_motion", branch="both", limits=limits, sides={"both": side(0.99, None)})
    found = result(decision={"rule": rule, "guard_factor": factor}, metrics=[both, known, free, unknown])
    said = [f"decided within the uncertainty of the limit ({why}): {', '.join(names)}"] if names else []
    assert note_lines(found) == said
    assert [one for one in said if one[1:] in rule_text(found)] == said


def sided(name: str, *sides: str, limit: float | None = 108.0, **changes: Any) -> dict[str, Any]:
    """A metric of a result whose sides are those; the first one is its headline."""
    row = {"value": 115.0, "uncertainty": 0.5, "verdict": "PASS"}
    found = plain(metric(id=name, side=sides[0], limits={"min": limit, "max": None}, sides=dict.fromkeys(sides, row)))
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
    found = result(decision={"rule": "guard_band", "guard_factor": 1.0}, metrics=metrics)
    assert note_lines(found) == ([f"judged on one side only: {said}"] if said else [])
    assert (f"one side only: {said}." in rule_text(found)) == bool(said)


def test_on_a_narrow_terminal_a_metric_keeps_its_whole_name() -> None:
    stream, limits = io.StringIO(), {"min": None, "max": 1.0}
    near = metric(id="backlash_width_3pct", limits=limits, verdict="NOT DECIDABLE", uncertainty=0.61)
    Console(file=stream, width=55).print(metrics_table([near]))
    assert "…" not in stream.getvalue()
    assert "NOT DECIDABLE" in stream.getvalue()


def test_signs_that_a_terminal_lacks_are_replaced_before_anything_is_laid_out() -> None:
    near = metric(id="backlash_width_3pct", limits={"min": None, "max": 1.0}, verdict="NOT DECIDABLE", uncertainty=0.61)
    shown = result(metrics=[near, metric(id="windup")], reasons=["width ± 0.6 is near 1 ≤ x ≤ 2 … 3 " * 9])
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors=HANDLER)
    console = Console(file=stream, width=80)
    console.print(metrics_table(shown.metrics, console.encoding))
    console.print(verdict_panel(shown, console.encoding))
    print_grid(console, GRIDS["numbers"])
    stream.seek(0)
    lines = stream.read().splitlines()
    box = next(number for number, line in enumerate(lines) if line.startswith("+-"))
    end = next(number for number, line in enumerate(lines) if line.startswith("+-") and number > box)
    for part in (lines[:box], lines[box : end + 1], lines[end + 1 :]):
        assert len({len(line) for line in part}) == 1, part
    assert any("+/-" in line for line in lines[:box])
    assert any("..." in line for line in lines[end + 1 :])
