from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from made_documents import alarm, left, manifest, metric, result, timing
from test_headline import told

from recipes import shipped_recipes
from station.bench.request import load_job
from station.documents.result import DecisionRule
from station.records.samples.history import conditions_of
from station.records.samples.layout import CURRENT
from station.records.samples.table import Table
from station.reports.html_page import report_html
from station.reports.result_text import guarded_text

RUN = manifest()


def page(conditions: dict[str, str] | None = None, **changes: Any) -> str:
    shown = result(**{"clock": "virtual", "attempt": 1, "timing": timing()} | changes)
    return report_html(shown, RUN, [], {}, {}, conditions=conditions).decode()


def test_a_fault_heads_the_report_and_it_says_how_the_bench_was_left() -> None:
    late = alarm(id="late", reaction="hold", first=False, text="Samples late")
    text = page(state="fault", verdict="NOT DECIDABLE", alarms=[alarm(), late], left=told(left()))
    for part in ("BENCH FAULT: Guard opened<small>NOT DECIDABLE", "VIRTUAL BENCH", "VIRTUAL TIME", "lock closed"):
        assert part in text
    assert "ended in a fault" in text
    assert text.count('<tr class="alarm">') == 1
    assert text.count('<tr class="note">') == 1
    assert text.count("First cause:") == 1


def test_notes_that_no_stage_says_are_in_the_report_beside_the_stages() -> None:
    """As that a start condition was bypassed, a master part was not in order, the clock was behind."""
    stages = [{"stage": "drift", "text": "drift taken out", "applied": True}]
    for there in (stages, []):
        text = page(notes=["drift taken out", "MASTER-1 was never measured"], stages=there)
        assert text.count("<li>MASTER-1 was never measured</li>") == 1
        assert text.count("<li>drift taken out</li>") == (not there), "stages are not said twice"


def test_a_bench_that_did_not_open_has_a_bullet_per_device_and_no_timing() -> None:
    text = page(
        state="fault", verdict="NOT DECIDABLE", reasons=["drive: silent\nbrake: silent"], timing=timing(scans=0)
    )
    assert "<li>drive: silent</li>" in text
    assert "<li>brake: silent</li>" in text
    assert "<h2>Timing</h2>" not in text


def test_what_was_asked_of_the_machine_and_what_is_in_its_way_is_in_the_report() -> None:
    realtime = {"fifo": False, "mlock": True, "details": {"fifo": "not <permitted>", "mlock": "all pages"}}
    realtime["machine"] = [{"name": "kernel", "in_order": False, "found": "no realtime kernel", "mend": "install one"}]
    late = {"p50": 1.0, "p99": 2.0, "p999": 3.0, "max": 4.0}
    found = timing(clock="real", realtime=realtime, lateness_us=late, work_us=late)
    text = report_html(result(attempt=1, timing=found), manifest(clock="real"), [], {}, {}).decode()
    assert "<dt>fifo</dt><dd>refused: not &lt;permitted&gt;</dd>" in text
    assert "<dt>mlock</dt><dd>granted: all pages</dd>" in text
    assert "no realtime kernel; remedy: install one" in text


def test_temperatures_and_zeroes_are_in_the_report() -> None:
    program = load_job(str(shipped_recipes()["rv-40e-121-quick"]), None).program
    rows = np.zeros(2, dtype=CURRENT.dtype)
    table = Table(rows)
    rows["orders"]["state"] = 1
    assert conditions_of(table, program) == {}
    rows["orders"]["state"] = 2
    rows["image"]["housing_temp_c"] = (22.0, 23.5)
    rows["orders"]["torque_out_tare_nm"] = -0.25
    found = conditions_of(table, program)
    assert found["housing temperature"] == "22.0 °C at the start, 23.5 °C at the end, highest 23.5 °C"
    assert found["zero of the output torque"] == "−0.250 N·m, subtracted"
    assert "23.5 °C" in page(found)


def test_guard_banded_limits_are_numbers() -> None:
    limited = metric(uncertainty=0.1, limits={"min": None, "max": 1.0})
    guard_band = DecisionRule(rule="guard_band", guard_factor=0.5)
    assert guarded_text(limited, guard_band) == "accept ≤ 0.950"
    assert guarded_text(limited, DecisionRule()) == ""
    assert guarded_text(replace(limited, uncertainty=None), guard_band) == ""
