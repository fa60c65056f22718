"""The look at the machine, on machines made of files."""

from __future__ import annotations

from pathlib import Path

import pytest

from station.scan.machine import CHECKS, look
from station.scan.realtime import request_affinity

GOOD = {
    "proc/version": "Linux version 6.1.0-rt PREEMPT_RT",
    "sys/devices/system/cpu/isolated": "3",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "performance",
    "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor": "performance",
    "sys/devices/system/cpu/cpu2/cpufreq/scaling_governor": "performance",
    "proc/cpuinfo": "flags : fpu sse2",
    "proc/sys/kernel/sched_rt_runtime_us": "950000",
}
BAD = {
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


def test_no_isolated_core_is_a_refusal_with_its_reason(tmp_path: Path) -> None:
    for grant in (request_affinity(tmp_path / "absent"), request_affinity(machine(tmp_path, {"i": "\n"}) / "i")):
        assert not grant.granted
        assert "isolcpus" in grant.detail
