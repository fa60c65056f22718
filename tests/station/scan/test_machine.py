"""The look at the machine, on machines made of files."""

from __future__ import annotations

import os
import resource
from dataclasses import replace
from pathlib import Path

import pytest

from station.documents.scan_report import Realtime
from station.scan.machine import CHECKS, against, look, privilege
from station.scan.realtime import request_affinity

GOOD = {
    "proc/version": "Linux version 6.1.0-rt PREEMPT_RT",
    "sys/devices/system/cpu/isolated": "3",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "performance",
    "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor": "performance",
    "sys/devices/system/cpu/cpu2/cpufreq/scaling_governor": "performance",
    "proc/cpuinfo": "flags : fpu sse2",
    "proc/sys/kernel/sched_rt_runtime_us": "950000",
    "proc/swaps": "Filename Type Size Used Priority\n",
    "sys/devices/system/cpu/cpu0/cpuidle/state1/name": "C1",
    "sys/devices/system/cpu/cpu0/cpuidle/state1/latency": "2",
    "sys/devices/system/cpu/cpu0/cpuidle/state2/name": "C6",
    "sys/devices/system/cpu/cpu0/cpuidle/state2/latency": "170",
    "sys/devices/system/cpu/cpu0/cpuidle/state2/disable": "1",
    "sys/devices/system/clocksource/clocksource0/current_clocksource": "tsc",
    "sys/bus/usb-serial/devices/ttyUSB0/latency_timer": "1",
}
BAD = {
    "sleep states": {"sys/devices/system/cpu/cpu0/cpuidle/state2/disable": "0"},
    "swap": {"proc/swaps": "Filename Type Size Used Priority\n/dev/sda2 partition 8 0 -2\n"},
    "clock source": {"sys/devices/system/clocksource/clocksource0/current_clocksource": "hpet"},
    "serial adapter": {"sys/bus/usb-serial/devices/ttyUSB1/latency_timer": "16"},
    "kernel": {"proc/version": "Linux version 6.1.0 PREEMPT_DYNAMIC"},
    "governor": {"sys/devices/system/cpu/cpu1/cpufreq/scaling_governor": "powersave"},
    "isolated core": {"sys/devices/system/cpu/isolated": "\n"},
    "host": {"proc/cpuinfo": "flags : fpu hypervisor sse2"},
    "throttling": {"proc/sys/kernel/sched_rt_runtime_us": "500000"},
}


def machine(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


def test_a_good_machine_has_nothing_in_the_way(tmp_path: Path) -> None:
    found = {one.name: one.in_order for one in look(machine(tmp_path, GOOD))}
    assert len(found) == len(CHECKS)
    del found["privilege"]  # this user's, whatever the files say
    assert all(found.values()), found


@pytest.mark.parametrize("name", sorted(BAD))
def test_each_obstacle_is_found_with_a_way_to_mend_it(tmp_path: Path, name: str) -> None:
    found = {one.name: one for one in look(machine(tmp_path, GOOD | BAD[name]))}
    assert not found[name].in_order
    assert found[name].found
    assert found[name].mend
    assert [one for one in found if not found[one].in_order and one != "privilege"] == [name]


def test_a_machine_without_these_files_is_looked_at_too(tmp_path: Path) -> None:
    assert len(look(tmp_path)) == len(CHECKS)


LIMITS = {resource.RLIMIT_RTPRIO: 0, resource.RLIMIT_MEMLOCK: 8 << 20}
BOTH, NEITHER = "CapEff:\t0000000000804000\n", "Name:\tx\nCapEff:\t0000003fff7fbfff\n"
"""Capability masks with SYS_NICE and IPC_LOCK alone, and with everything but these two, as in a container."""


@pytest.fixture
def limited(monkeypatch: pytest.MonkeyPatch) -> dict[int, int]:
    """Limits of this process as a plain user's, for a test to change."""
    limits = dict(LIMITS)
    monkeypatch.setattr(resource, "getrlimit", lambda which: (limits[which], limits[which]))
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    return limits


def test_root_without_the_capabilities_has_no_privilege(tmp_path: Path, limited: dict[int, int]) -> None:
    found = privilege(machine(tmp_path, {"proc/self/status": NEITHER}))
    assert not found.in_order
    assert "rtprio limit 0, no CAP_SYS_NICE" in found.found
    assert "no CAP_IPC_LOCK" in found.found
    assert "--cap-add SYS_NICE" in found.mend
    assert privilege(machine(tmp_path, {"proc/self/status": BOTH})).in_order
    limited |= {resource.RLIMIT_RTPRIO: 80, resource.RLIMIT_MEMLOCK: resource.RLIM_INFINITY}
    assert privilege(machine(tmp_path, {"proc/self/status": NEITHER})).in_order
    assert privilege(tmp_path / "no proc").in_order


@pytest.mark.usefixtures("limited")
def test_what_was_refused_all_the_same_stands_in_the_way(tmp_path: Path) -> None:
    good = machine(tmp_path, GOOD | {"proc/self/status": BOTH})
    given = Realtime(fifo=True, mlock=True, details={"fifo": "not permitted", "mlock": "all"})
    assert against(given, good) == ()
    (one,) = against(replace(given, fifo=False), good)
    assert (one.name, one.found) == ("privilege", "fifo refused: not permitted")


def test_no_isolated_core_is_a_refusal_with_its_reason(tmp_path: Path) -> None:
    for grant in (request_affinity(tmp_path / "absent"), request_affinity(machine(tmp_path, {"i": "\n"}) / "i")):
        assert not grant.granted
        assert "isolcpus" in grant.detail


def test_the_page_on_real_time_has_a_row_for_each_look() -> None:
    page = (Path(__file__).parents[3] / "docs" / "realtime.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1].strip() for line in page.splitlines() if line.startswith("| ")]
    names = [finding.name for finding in look(Path("/"))]
    assert [row for row in rows if row in names] == names
