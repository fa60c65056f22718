"""SIGKILL of the scan process and of the desk at odd moments; `make kill-tests` does it a hundred times each."""

from __future__ import annotations

import pytest
from kills import kill
from warm_desk import load, warm

pytestmark = pytest.mark.wires


@pytest.mark.parametrize("after_s", [0.003, 0.8, 7.31])
def test_a_killed_scan_process_loses_no_written_record(after_s, tmp_path):
    left = kill("scan", after_s, tmp_path)
    assert left.problems() == []
    assert left.state == "interrupted"


def test_a_run_whose_desk_was_killed_is_unloaded_without_it(tmp_path):
    left = kill("desk", 4.27, tmp_path)
    assert left.problems() == []
    assert left.state == "stopped"
    assert any("the desk gave no sign" in note for note in left.notes)


def test_a_new_desk_takes_over_a_run_that_goes_on(tmp_path):
    load()  # the scan waits 2 s for a new desk: a command that starts cold takes half of that to load itself
    left = kill("desk", 1.9, tmp_path, resume=True, start=warm)
    assert left.problems() == []
    assert left.state == "complete"


def test_a_scan_that_nobody_can_start_any_more_ends(tmp_path):
    left = kill("desk", 0.0, tmp_path, since="opening")
    assert left.problems() == []
    # Stopped where the scan could still say so, before anything was enabled.
    assert left.state in ("interrupted", "stopped")
    assert left.verdict == "NOT DECIDABLE"
    assert not any("operator" in reason for reason in left.reasons), left.reasons
    if left.state == "stopped":
        assert any("the desk was gone before it had started the run" in reason for reason in left.reasons)
