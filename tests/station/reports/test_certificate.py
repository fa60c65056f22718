"""The certificate: one page with its code, which says genuine, altered or unknown."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from reportlab.graphics.barcode.qr import QrCodeWidget
from station_samples import SETUP
from stored_runs import metric, store_run

from station.errors import RecordError
from station.records.certificate_code import ALTERED, GENUINE, UNKNOWN, CodeError, check_code, code_of
from station.records.data_folder import Store
from station.reports.certificate import CERTIFICATE, certificate_of
from station.reports.report_of_run import made_report
from station.reports.stored_result import stored_result


@pytest.fixture(scope="module")
def data(worn_run: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a unit that failed."""
    copied = tmp_path_factory.mktemp("certificate") / "runs"
    shutil.copytree(worn_run.data, copied)
    return copied


def test_a_certificate_says_what_the_record_says(data: Path) -> None:
    run = Store(data).newest(1)[0]
    (data / CERTIFICATE).write_text(
        "maker: [Example Gears, '<b>Road</b>']\ncustomer: [A & B]\norder: '4711'\n", encoding="utf-8"
    )
    result = stored_result(run)
    found = certificate_of(run, result)
    assert found is not None
    assert (found.verdict, found.code) == (result.verdict, code_of(run))
    limited = {one.title for one in result.metrics if one.limits}
    assert {row.title for row in found.rows} == limited
    assert {row.verdict for row in found.rows} >= {"FAIL"}
    assert dict(found.facts)["Order"] == "4711"
    passed = sum(check.passed is True for check in result.gates)
    assert f"{passed} checks passed" in found.checks
    html, pdf = made_report(run, keep=False)
    text = html.decode()
    assert text.index('class="certificate"') < text.index("Annex") < text.index("<h2>Metrics")
    assert found.checks in text[: text.index("Annex")], "whether the measurement is valid stands on the first page"
    assert "&lt;b&gt;Road" in text
    assert "A &amp; B" in text
    square = re.search(r'class="code" alt="[^"]*" src="data:image/svg\+xml;base64,([^"]+)"', text)
    assert square is not None
    modules = QrCodeWidget(found.code, barLevel="M")
    modules.draw()
    border = modules.barBorder
    dark = {(x + border, y + border) for y, row in enumerate(modules.qr.modules) for x, one in enumerate(row) if one}
    rows = re.findall(r'<rect x="(\d+)" y="(\d+)" width="(\d+)" height="1"/>', base64.b64decode(square[1]).decode())
    drawn = {(int(x) + n, int(y)) for x, y, width in rows for n in range(int(width))}
    assert drawn == dark, "every module of the square is drawn, and no other"
    assert pdf == made_report(run, keep=False)[1], "the same record gives the same bytes"


def test_heads_that_are_wrong_make_no_certificate(data: Path) -> None:
    (data / CERTIFICATE).write_text("makers: [Example]\n", encoding="utf-8")
    run = Store(data).newest(1)[0]
    try:
        with pytest.raises(RecordError, match="makers"):
            certificate_of(run, stored_result(run))
    finally:
        (data / CERTIFICATE).unlink()


@pytest.mark.parametrize("changes", [{"state": "fault"}, {"altered": ("x",)}])
def test_what_has_no_end_or_was_altered_has_no_certificate(data: Path, changes: dict[str, Any]) -> None:
    run = Store(data).newest(1)[0]
    assert certificate_of(run, dataclasses.replace(stored_result(run), **changes)) is None


def test_a_code_is_genuine_altered_or_unknown(data: Path, tmp_path: Path) -> None:
    copied = tmp_path / "runs"
    shutil.copytree(data, copied)
    run = Store(copied).newest(1)[0]
    code = code_of(run)
    found = check_code(copied, f"  {code.upper().replace(run.id.upper(), run.id)}\r\n")
    assert (found.standing, found.verdict, found.serial) == (GENUINE, "FAIL", run.serial())
    for typed in (code.lower(), code.upper()):
        assert (check_code(copied, typed).standing, check_code(copied, typed).run) == (GENUINE, run.id)
    other_hash = code.replace(code[4:12], "00000000")
    assert check_code(copied, other_hash).standing == ALTERED
    assert check_code(copied, code.replace(run.id, "20200101T000000.000Z-NONE")).standing == UNKNOWN
    for text in ("", "LM1", code[: -len(run.id) - 1], "x" * 500, "LM1." + "g" * 64 + ".R"):
        with pytest.raises(CodeError):
            check_code(copied, text)
    answer = here("verify", "--code", code, "--data", str(copied), "--json")
    assert (answer.exit_code, answer.json["certificate"], answer.json["verdict"]) == (0, GENUINE, "FAIL")
    result = run.folder / "result.json"
    result.write_text(result.read_text(encoding="utf-8").replace('"FAIL"', '"PASS"'), encoding="utf-8")
    forged = check_code(copied, code)
    assert (forged.standing, forged.verdict) == (ALTERED, None)
    assert here("verify", "--code", code, "--data", str(copied)).exit_code == 1
    shutil.rmtree(run.folder)
    assert (check_code(copied, code).standing, check_code(copied, code).verdict) == (GENUINE, "FAIL")
    assert check_code(copied, other_hash).standing == ALTERED


def test_a_genuine_code_says_what_its_verdict_is_worth_by_now(tmp_path: Path) -> None:
    runs = [
        store_run(tmp_path, "SN-1", [metric(0.4)]),
        store_run(tmp_path, "SN-1", [metric(9.9)], failed="lost_motion"),
        store_run(tmp_path, "SN-2", [metric(0.4)], virtual="P1"),
    ]
    first_code, again = code_of(runs[0]), "attempt 2 FAIL lost_motion"
    first, second, simulated = (check_code(tmp_path, code_of(run)) for run in runs)
    assert {one.standing for one in (first, second, simulated)} == {GENUINE}
    assert (first.verdict, [str(one) for one in first.since], first.aside) == (
        "PASS",
        [again],
        None,
    )
    assert (second.verdict, second.since) == ("FAIL", ())
    assert (simulated.verdict, simulated.aside) == ("PASS", "simulated")
    shown = here("verify", "--code", code_of(runs[0]), "--data", str(tmp_path)).out
    assert "since    attempt 2 FAIL" in shown
    assert "PASS, simulated" in here("verify", "--code", code_of(runs[2]), "--data", str(tmp_path)).out
    shutil.rmtree(runs[0].folder)
    gone = check_code(tmp_path, first_code)
    assert ([str(one) for one in gone.since], gone.verdict) == ([again], "PASS"), "the chain knows both"


def test_a_forged_manifest_is_no_genuine_record(data: Path, tmp_path: Path) -> None:
    copied = tmp_path / "runs"
    shutil.copytree(data, copied)
    run = Store(copied).newest(1)[0]
    manifest = run.folder / "run.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text("utf-8")) | {"verdict": "PASS"}), encoding="utf-8")
    assert check_code(copied, code_of(run)).standing == ALTERED, "its own hash is not the one in the chain"


def test_a_run_that_was_not_concluded_has_no_certificate(tmp_path: Path) -> None:
    run = Store(tmp_path).create("S", SETUP, {})
    assert check_code(tmp_path, code_of(run)).standing == ALTERED
