"""When a process was started: with its id this names it for good."""

from __future__ import annotations

from pathlib import Path


def process_birth(pid: int) -> str:
    """Return when a process was started, in the kernel's ticks since boot, or '' when there is none.

    With the process id it names a process for good: ids are used again.
    """
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ""
    fields = stat.rpartition(")")[2].split()
    return "" if fields[0] == "Z" else fields[19]
