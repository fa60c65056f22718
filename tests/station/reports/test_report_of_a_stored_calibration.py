"""A report whose torque was converted by a stored calibration says by which, of whom, until when, and its lines."""

from __future__ import annotations

import re
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import ROOT, here

ENTRY = """calibrations:
  - id: ratio-of-three
    model: RV-40E-121
    made: {made}
    due: 2099-01-02
    load_positive: {{slope: 94.7616, offset: -12.8205 N·m, u_slope: 0.00685, u_offset: 0.0202 N·m, correlation: -0.8963, residual_sd: 0.219 N·m}}
    unload_positive: {{slope: 167.964, offset: 24.8502 N·m, u_slope: 0.0346, u_offset: 0.0377 N·m, correlation: -0.8638, residual_sd: 0.464 N·m}}
    load_negative: {{slope: 94.7385, offset: 12.8276 N·m, u_slope: 0.0067, u_offset: 0.0197 N·m, correlation: 0.8962, residual_sd: 0.214 N·m}}
    unload_negative: {{slope: 167.979, offset: -24.8399 N·m}}
"""  # noqa: E501
MADE = "2026-01-02"


@pytest.fixture(scope="module")
def record(stored_once: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stored")
    text = (ROOT / "recipes" / "rv-40e-121-quick.yaml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if "- calibrate" not in line and "torque_ratio_" not in line]
    recipe = "\n".join(lines).replace("output_torque: reaction", "output_torque: calibrated\n  calibration: stored")
    bench = (ROOT / "recipes" / "benches" / "virtual.yaml").read_text(encoding="utf-8")
    assert "calibrations: []" in bench
    (folder / "recipe.yaml").write_text(recipe, encoding="utf-8")
    entry = ENTRY.format(made=MADE)
    (folder / "bench.yaml").write_text(bench.replace("calibrations: []", entry), encoding="utf-8")
    stored = stored_once("stored-ratio", str(folder / "recipe.yaml"), "--bench", str(folder / "bench.yaml"))
    found: Path = stored.record
    return found


def test_a_stored_calibration_is_named_with_its_lines(record: Path, tmp_path: Path) -> None:
    done = here("report", str(record), "--out", str(tmp_path))
    assert done.exit_code == 0, done.err
    page = unescape((tmp_path / "report.html").read_text(encoding="utf-8"))
    said = re.search(r"<dt>calibration</dt><dd>(.*?)</dd>", page)
    assert said is not None
    for part in ("ratio-of-three", "RV-40E-121", "bench virtual revision", f"made {MADE}, due 2099-01-02", "left out"):
        assert part in said[1]
    assert "a line without uncertainties is assumed known to 0.5 % of its slope and 0.5 N·m" in said[1]
    table = page.partition("T_in, stored calibration ratio-of-three</h3>")[2].partition("</table>")[0]
    found = (re.findall(r"<td[^>]*>(.*?)</td>", row) for row in table.split("</tr>"))
    rows = [row for row in found if row]
    first = ["load positive", "−12.820500", "94.761600", "0.02", "0.0069", "−0.8963", "0.219", "–", "–"]
    assert rows[0] == first
    assert rows[3][1:7] == ["−24.839900", "167.979000", "–", "–", "–", "–"]
    assert 'download="torque_ratio.csv"' not in page


def test_a_measured_calibration_has_its_id(quick_run: Any) -> None:
    page = (quick_run.record / "report.html").read_text(encoding="utf-8")
    name = f"{quick_run.record.name}-ratio"
    assert f"T_in, calibration {name} of this run</h3>" in page
    assert f"<dd>{name}: torque ratio of RV-40E-121 on bench virtual revision 1, measured by this run on " in page
