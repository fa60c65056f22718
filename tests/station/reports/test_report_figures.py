"""What a report states is computed again from the page alone, by nothing but what the page says."""

from __future__ import annotations

import base64
import csv
import io
import math
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lostmotion_command import here
from made_documents import made, metric
from printed_numbers import last_digit, prints

from analysis.loop.branches import Branch
from analysis.torque_ratio.neighbours import alike
from station.documents.result import Result
from station.records.run_record import RunRecord
from station.reports.budget_rows import budget_tables
from station.reports.figures.loop_plot import width_text
from station.reports.html_page import explained
from station.reports.metric_sides import side_rows
from station.reports.result_text import metric_name


@pytest.fixture(scope="module")
def page(quick_run: Any) -> str:
    found: str = (quick_run.record / "report.html").read_text(encoding="utf-8")
    return found


@pytest.fixture(scope="module")
def page_of(shipped_run: Any, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    """Return the page of a shipped recipe's run, by its name; each is made once, or was made with its run."""

    @cache
    def made(recipe: str) -> str:
        record = shipped_run(recipe).record
        out = record if (record / "report.html").exists() else tmp_path_factory.mktemp("page")
        if out != record:
            assert here("report", str(record), "--out", str(out)).exit_code == 0
        return (out / "report.html").read_text(encoding="utf-8")

    return made


def cells(html: str) -> list[list[str]]:
    """Return the rows of the tables in a piece of the page, as text."""
    wide = '<td colspan="4">([^<]*)</td>'
    html = re.sub(wide, r"<td>\1</td><td></td><td></td><td></td>", html)
    rows = re.findall(r"<tr>(<td.*?)</tr>", html, re.DOTALL)
    return [[unescape(one) for one in re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL)] for row in rows]


def figure(text: str) -> float:
    return float(text.split(maxsplit=1)[0].replace("−", "-"))


def budgets(page: str) -> dict[str, tuple[str, list[list[str]]]]:
    """Return the budgets of the page by metric: what is stated, and every row."""
    section = page.partition("<h2>Uncertainty budgets</h2>")[2].partition("<h2>")[0]
    found = re.findall(r'<h3>(.*?) <span class="soft">= (.*?)</span></h3>(.*?)(?=<h3>|$)', section, re.DOTALL)
    return {unescape(name): (stated, cells(table)) for name, stated, table in found}


RECIPES = ("rv-40e-121-quick", "rv-40e-121-output", "rv-40e-121-measurement")


@pytest.mark.parametrize("recipe", RECIPES)
def test_every_side_has_its_budget_and_gives_its_u(
    recipe: str, shipped_run: Any, page_of: Callable[[str], str]
) -> None:
    record, page = shipped_run(recipe).record, page_of(recipe)
    metrics = RunRecord(record).read(Result, "result.json").metrics
    known = [row for one in metrics for row in side_rows(one) if row.uncertainty is not None]
    found = budgets(page)
    assert list(found) == [metric_name(row) for row in known]
    assert len(found) > len(metrics)
    for row in known:
        stated, rows = found[metric_name(row)]
        single = [one for one in rows if one[1]]
        assert len(single) == len(row.budget)
        expanded = 2.0 * math.hypot(*(figure(one[4]) for one in single))
        total = next(one for one in rows if one[0].startswith("all"))
        printed, computed = re.search(r"± ([0-9.]+)", stated), re.search(r"U = 2·u = ([0-9.e−]+)", total[0])
        assert printed is not None
        assert computed is not None
        assert figure(computed[1]) == pytest.approx(expanded, rel=1e-3)
        assert figure(total[4]) == pytest.approx(expanded / 2.0, rel=1e-3)
        if row.id == "grade":
            assert total[4].endswith(" arcmin")
            assert "of the backlash" in total[0]
        else:
            # of contributions that were printed: each is as wrong as its own rounding
            assert figure(printed[1]) == pytest.approx(expanded, rel=1e-3, abs=0.51 * last_digit(printed[1]))
            assert expanded == pytest.approx(row.uncertainty, rel=1e-3)
        summed = [one for one in rows if not one[1] and not one[0].startswith("all")]
        large = rows[: len(rows) - len(summed) - 1 - (int(summed[0][0].split()[0]) if summed else 0)]
        assert 2.0 * math.hypot(*(figure(one[4]) for one in large + summed)) == pytest.approx(expanded, rel=1e-3)
        for one in single:
            assert figure(one[4]) == pytest.approx(abs(figure(one[2]) * figure(one[3])), rel=2e-3, abs=1e-12)


def torque_ratio_points(page: str) -> dict[str, list[tuple[float, float]]]:
    """Return the points of torque_ratio.csv of the page by quadrant."""
    found = re.search(r'download="torque_ratio.csv" href="data:text/plain;base64,([^"]+)"', page)
    assert found is not None
    points: dict[str, list[tuple[float, float]]] = {}
    for row in csv.DictReader(io.StringIO(base64.b64decode(found[1]).decode())):
        points.setdefault(row["quadrant"], []).append((float(row["torque_in_nm"]), float(row["torque_out_nm"])))
    return points


def test_the_lines_of_the_torque_ratio_are_fitted_again(page: str, quick_run: Any, tmp_path: Path) -> None:
    points = torque_ratio_points(page)
    table = cells(page.partition("<h3>Torque ratio")[2].partition("</table>")[0])
    assert [row[0].replace(" ", "_") for row in table] == list(points)
    fitted = {}
    for row in table:
        x, y = np.array(points[row[0].replace(" ", "_")]).T
        (slope, offset), *_ = np.linalg.lstsq(np.stack([x, np.ones(x.size)], axis=1), y, rcond=None)
        left = y - offset - slope * x
        s = math.sqrt(float(left @ left) / (x.size - 2))
        assert prints(row[1], offset)
        assert prints(row[2], slope)
        assert prints(row[6], s)
        assert row[7] == str(x.size)
        larger = math.sqrt(alike(left))  # of points along a branch, whose neighbours err alike; a table has no order
        u_slope = s / math.sqrt(float(np.square(x - x.mean()).sum()))
        assert prints(row[4], larger * u_slope)
        fitted[row[0]] = (slope, offset)
        alone = tmp_path / "alone.csv"
        alone.write_text("\n".join(["torque_in_nm,torque_out_nm", *(f"{a},{b}" for a, b in zip(x, y, strict=True))]))
        (line,) = here("torque-ratio", str(alone), "--json").json["lines"]
        assert line["u_slope"] == pytest.approx(u_slope, rel=1e-6)
        assert prints(row[3], larger * line["u_offset_nm"])
        assert prints(row[5], line["correlation"])
    metrics = {one.id: one.sides for one in RunRecord(quick_run.record).read(Result, "result.json").metrics}
    for sign, name, turn in (("+", "load positive", 1.0), ("-", "load negative", -1.0)):
        slope, offset = fitted[name]
        assert slope == pytest.approx(metrics["torque_ratio_slope"][sign].value, rel=1e-8)
        assert turn * offset == pytest.approx(metrics["torque_ratio_offset"][sign].value, rel=1e-7)


SHARE_OF_U = 0.2
WITHOUT_VERDICT = {
    "rv-40e-121-quick": "torque_ratio_offset, side +: could not be evaluated",
    "rv-40e-121-output": "measurement invalid: late_torque",
    "rv-40e-121-measurement": "measurement invalid: loop_closure",
}
"""What docs/reports.md says of why `loop.csv` of a recipe has no verdict."""


@pytest.mark.parametrize("recipe", WITHOUT_VERDICT)
def test_the_loop_of_a_page_has_values_and_no_verdict(
    recipe: str, shipped_run: Any, page_of: Callable[[str], str], tmp_path: Path
) -> None:
    record, page = shipped_run(recipe).record, page_of(recipe)
    for name, content in re.findall(r'download="([^"]+)" href="data:text/plain;base64,([^"]+)"', page):
        (tmp_path / name).write_bytes(base64.b64decode(content))
    asked = ("analyze", str(tmp_path / "loop.csv"), "--recipe", str(tmp_path / "recipe.yaml"), "--json")
    again = here(*asked).json
    with_bench = here(*asked, "--bench", str(tmp_path / "bench.yaml")).json
    for one, other in zip(again["metrics"], with_bench["metrics"], strict=True):
        assert one["value"] == other["value"], "a bench's fixture is not taken out of a wind-up a second time"
    assert again["verdict"] == "NOT DECIDABLE"
    assert any(reason.startswith(WITHOUT_VERDICT[recipe]) for reason in again["reasons"])
    values = {metric_name(row): row.value for one in made(Result, again).metrics for row in side_rows(one)}
    for one in RunRecord(record).read(Result, "result.json").metrics:
        if not one.id.startswith("torque_ratio"):
            for row in side_rows(one):
                # Where friction has turned is told from the points of the page, and of the run: the curve through both
                # differs by a small part of what is known of it.
                most = max(1e-4 * abs(row.value), SHARE_OF_U * (row.uncertainty or 0.0))
                assert abs(values[metric_name(row)] - row.value) <= most, metric_name(row)


def side(value: float, share: float) -> dict[str, Any]:
    row = {"quantity": "q", "u": 0.1, "unit": "1", "sensitivity": value, "contribution": 0.1 * value, "share": share}
    return {
        "value": value,
        "uncertainty": 0.2 * value,
        "budget": [row],
        "standard_deviation": value / 100,
        "per_cycle": [value, value],
        "verdict": "PASS",
    }


def test_the_side_that_judges_comes_first_each_with_its_own_figures() -> None:
    sides = {"+": side(1.0, 1.0), "-": side(3.0, 1.0)}
    limits = {"min": None, "max": 5.0}
    shown = {"id": "backlash", "branch": "width", "side": "+", "definition": "width", "coverage_factor": 2.0}
    found = metric(**shown, limits=limits, sides=sides, **sides["+"])
    tables = budget_tables([found])
    assert [(one.metric, one.expanded) for one in tables] == [
        ("backlash side −", "3.00 ± 0.60 arcmin"),
        ("backlash side +", "1.00 ± 0.20 arcmin"),
    ]
    assert [one.rows[0][4] for one in tables] == ["0.3 arcmin", "0.1 arcmin"]
    assert explained(found) == "width. cycles (side −) 3.000, 3.000; s = 0.03. cycles (side +) 1.000, 1.000; s = 0.01"


def test_an_energy_is_told_in_joules_too() -> None:
    named = {"id": "hysteresis_energy", "branch": "width", "unit": "N·m·arcmin", "definition": "area"}
    found = metric(**named, value=312.0, uncertainty=2.7, value_j=312.0 * math.pi / 10_800)
    assert explained(found) == "area. In joules: 0.09076 ± 0.00079 J"
    assert explained(replace(found, uncertainty=None)) == "area. In joules: 0.09076 J"
    assert explained(replace(found, value=0.0, value_j=0.0)) == "area. In joules: 0 J"


def test_the_picture_has_the_width_that_the_table_has() -> None:
    torque = np.linspace(-20.0, 20.0, 41)
    zero = Branch(torque, torque / 100.0)
    falling = [Branch(torque, torque / 100.0 + width) for width in (0.9, 1.0)]
    assert width_text([zero, zero], falling, 12.0) == "0.950′, mean of 2 cycles"
    assert width_text([zero], falling[:1], 12.0) == "0.900′"
