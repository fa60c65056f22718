"""Tests over wires where the machine stood still under them: repeated, and undecided where it did so every time.

What such a test says then is about the machine. It is undecided, and never passed: pytest counts it as skipped and
prints how long the machine stood still. A test that fails while the machine gave it its time has failed.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol

sys.path.insert(0, str(Path(__file__).parent))

from machine_watch import MachineWatch

TRIES = 2
"""How often a test over wires is tried whose failure the machine may have caused."""


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a test over wires, once more where it failed while the machine was held up."""
    if item.get_closest_marker("wires") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for _ in range(TRIES):
        item._initrequest()  # type: ignore[attr-defined]
        with MachineWatch() as watch:
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
        failed = any(report.failed for report in reports)
        if not (failed and watch.held_up):
            break
        why = f"{item.nodeid}: failed while the machine stood still for {1e3 * watch.longest_s:.0f} ms"
        sys.stderr.write(f"\n{why}\n")
    for report in reports:
        if failed and watch.held_up and report.failed:
            report.outcome = "skipped"
            report.longrepr = (str(item.path), item.location[1] or 0, f"undecided: {why}")
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
