"""What stands in the way of real time on this machine, and how to mend it. Reads the kernel's files, no more."""

from __future__ import annotations

import resource
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from station.documents.scan_report import MachineFinding as Finding
from station.documents.scan_report import Realtime
from station.scan.realtime import CAP_IPC_LOCK, CAP_SYS_NICE, FIFO_PRIORITY, has_capability

PRIVILEGE = "privilege"
MEND_PRIVILEGE = (
    f"write into /etc/security/limits.d: '@bench - rtprio {FIFO_PRIORITY}' and '@bench - memlock unlimited'; for a "
    "container, add --cap-add SYS_NICE --cap-add IPC_LOCK"
)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return ""


def kernel(root: Path) -> Finding:
    """Whether the kernel can be interrupted everywhere (PREEMPT_RT)."""
    version = _text(root / "proc/version")
    realtime = _text(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in version
    found = "realtime kernel (PREEMPT_RT)" if realtime else "no realtime kernel: the kernel can delay the scan"
    return Finding("kernel", realtime, found, "install linux-image-rt-amd64 (Debian) or a PREEMPT_RT kernel")


def governor(root: Path) -> Finding:
    """Whether the processor's clock stays up between scans."""
    files = sorted(root.glob("sys/devices/system/cpu/cpu[0-9]*/cpufreq/scaling_governor"))
    governors = sorted({_text(path) for path in files})
    if not governors:
        return Finding("governor", in_order=True, found="the kernel does not scale the processor's clock", mend="")
    found = f"frequency governor: {', '.join(governors)}"
    return Finding("governor", governors == ["performance"], found, "cpupower frequency-set --governor performance")


def isolated_core(root: Path) -> Finding:
    """Whether a core is kept free of other work."""
    cores = _text(root / "sys/devices/system/cpu/isolated")
    found = f"isolated cores: {cores}" if cores else "no isolated core: other programs run beside the scan"
    mend = "boot with isolcpus=N nohz_full=N rcu_nocbs=N to keep core N free for the scan"
    return Finding("isolated core", bool(cores), found, mend)


def cores(root: Path) -> Finding:
    """Whether there are cores enough for scan, supervisor and, embedded, the virtual bench."""
    count = len(list(root.glob("sys/devices/system/cpu/cpu[0-9]*")))
    found = f"{count} cores" if count else "the number of cores is not known"
    return Finding(
        "cores",
        count >= 3,
        found,
        "use a computer with 3 cores or more: for scan, embedded virtual bench and supervisor",
    )


def virtual_machine(root: Path) -> Finding:
    """Whether a host can take the processor away without anyone here noticing."""
    guest = " hypervisor" in _text(root / "proc/cpuinfo")
    found = "a virtual machine: its host can pause it for milliseconds" if guest else "not a virtual machine"
    return Finding(
        "host", not guest, found, "run on the bench computer itself, or pin the cores of the virtual machine"
    )


def throttling(root: Path) -> Finding:
    """Whether the kernel takes realtime processes off the processor for a share of every second."""
    runtime = _text(root / "proc/sys/kernel/sched_rt_runtime_us")
    free = runtime in ("", "-1")
    found = "realtime processes are not throttled" if free else f"realtime processes get {runtime} µs of every second"
    # The default (950 ms) only bites a process that spins; a scan with a spin tail uses a tenth.
    return Finding("throttling", free or int(runtime) >= 900_000, found, "sysctl kernel.sched_rt_runtime_us=950000")


DEEP_SLEEP_US = 50
"""Time to wake from which on a sleep of the processor is seen in the wake-up latency of a scan."""

SHORTEST_TIMER_MS = 1
SLOW_CLOCKS = ("acpi_pm", "hpet", "jiffies", "pit")


def sleep_states(root: Path) -> Finding:
    """Whether the processor sleeps so deep between two scans that it wakes late."""
    deep = {
        _text(state / "name"): latency
        for state in root.glob("sys/devices/system/cpu/cpu0/cpuidle/state*")
        if _text(state / "disable") != "1" and (latency := int(_text(state / "latency") or 0)) > DEEP_SLEEP_US
    }
    told = ", ".join(f"{name} ({latency} µs)" for name, latency in sorted(deep.items(), key=lambda one: one[1]))
    found = f"the processor needs long to wake up between scans: {told}" if deep else "the processor wakes quickly"
    return Finding("sleep states", not deep, found, "boot with processor.max_cstate=1 intel_idle.max_cstate=1")


def swap(root: Path) -> Finding:
    """Whether memory may be paged out: that of the scan is locked, that of what it waits for is not."""
    rows = _text(root / "proc/swaps").splitlines()[1:]
    found = f"memory may be paged out to {', '.join(row.split()[0] for row in rows if row)}" if rows else "no swap"
    return Finding("swap", not rows, found, "run swapoff -a, and delete the swap entry in /etc/fstab")


def clock_source(root: Path) -> Finding:
    """Whether asking for the time is quick: a scan asks a dozen times."""
    clock = _text(root / "sys/devices/system/clocksource/clocksource0/current_clocksource")
    found = f"clock source: {clock}" if clock else "the clock source is not known"
    return Finding(
        "clock source",
        clock not in SLOW_CLOCKS,
        found,
        "boot with tsc=reliable, or check the timer settings in the BIOS",
    )


def serial_latency(root: Path) -> Finding:
    """Whether a serial adapter on USB keeps what it has received for some time: an RTU device or a CAN adapter."""
    timers = {path.parent.name: _text(path) for path in root.glob("sys/bus/usb-serial/devices/*/latency_timer")}
    slow = {name: timer for name, timer in timers.items() if timer.isdigit() and int(timer) > SHORTEST_TIMER_MS}
    told = ", ".join(f"{name} waits {timer} ms" for name, timer in sorted(slow.items()))
    found = told or ("serial adapters forward data without delay" if timers else "no serial adapter on USB")
    names = " ".join(f"/sys/bus/usb-serial/devices/{name}/latency_timer" for name in sorted(slow))
    return Finding("serial adapter", not slow, found, f"echo 1 | tee {names}" if slow else "")


def privilege(root: Path) -> Finding:
    """Whether this process may have a realtime priority and locked memory: by its capabilities, or by its limits.

    Being root says nothing: a container takes both capabilities from root too.
    """
    status = root / "proc/self/status"
    priority = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    locked = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    may_hurry = has_capability(CAP_SYS_NICE, status) or priority >= FIFO_PRIORITY
    may_lock = has_capability(CAP_IPC_LOCK, status) or locked == resource.RLIM_INFINITY
    wrong = [] if may_hurry else [f"no realtime priority (rtprio limit {priority}, no CAP_SYS_NICE)"]
    wrong += [] if may_lock else [f"no locked memory (memlock limit {locked} bytes, no CAP_IPC_LOCK)"]
    found = ", ".join(wrong) or "realtime priority and locked memory allowed"
    return Finding(PRIVILEGE, not wrong, found, MEND_PRIVILEGE)


def _as_answered(found: Finding, asked: Realtime) -> Finding:
    """Return a finding on privilege, not OK when the machine has refused what the scan process asked for."""
    refused = [
        f"{name} refused: {asked.details.get(name, '')}" for name in ("fifo", "mlock") if not asked.granted(name)
    ]
    return replace(found, in_order=False, found=", ".join(refused)) if found.in_order and refused else found


CHECKS: tuple[Callable[[Path], Finding], ...] = (
    kernel,
    governor,
    isolated_core,
    cores,
    virtual_machine,
    throttling,
    sleep_states,
    swap,
    clock_source,
    serial_latency,
    privilege,
)
"""Every look, in the order of what helps most."""


def against(asked: Realtime, root: Path = Path("/")) -> tuple[Finding, ...]:
    """Return what stands in the way; nothing on a machine that has nothing against real time.

    `asked`: what the machine answered where it was asked for real time.
    """
    return tuple(finding for finding in look(root, asked) if not finding.in_order)


def resident_kb(status: Path = Path("/proc/self/status")) -> int:
    """Return the resident memory of this process [KiB]; 0 where the kernel does not tell."""
    rows = [line.split() for line in _text(status).splitlines() if line.startswith("VmRSS")]
    return int(rows[0][1]) if rows else 0


def look(root: Path = Path("/"), asked: Realtime | None = None) -> list[Finding]:
    """Look at everything; `asked`: what the machine answered where it was asked. `root` is for tests."""
    found = [check(root) for check in CHECKS]
    if asked is None:
        return found
    return [_as_answered(one, asked) if one.name == PRIVILEGE else one for one in found]
