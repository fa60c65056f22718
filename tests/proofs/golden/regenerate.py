"""Makes the golden runs anew: `make golden`. It says what has changed; look at that before committing it."""

from __future__ import annotations

import sys

from golden_file import read_golden, write_golden
from golden_runs import GOLDEN_RUNS, job, make, program_of

from controller.controller import Controller
from station.records.samples.event_log import state_name
from station.records.samples.table import table_of
from station.results.replay import Replayed, replay


def stored() -> dict[str, bytes]:
    """Return the golden runs that there are, by name."""
    found: dict[str, bytes] = {}
    for golden in GOLDEN_RUNS:
        if golden.path.exists():
            found[golden.name] = read_golden(golden.path, found.get(GOLDEN_RUNS[0].name, b""))
    return found


def _was(before: Replayed | None, *, same_bytes: bool) -> str:
    if before is None:
        return "new"
    if before.difference is not None:
        return f"the controller decides differently from scan {before.difference.scan} on"
    return "unchanged" if same_bytes else "the bench behaves differently"


def main() -> None:
    """Make all golden runs anew and say what each one was and now is."""
    work = job()
    old = stored()
    total = 0
    base = b""
    for golden in GOLDEN_RUNS:
        content = make(golden, work)
        there = old.get(golden.name)
        before = None if there is None else replay(there, Controller(program_of(golden, work)))
        write_golden(golden.path, content, base)
        base = base or content
        last = table_of(content)[-1]["orders"]
        size = golden.path.stat().st_size
        total += size
        end = f"{state_name(last['state'])} (fault {last['fault']})"
        was = _was(before, same_bytes=there == content)
        sys.stdout.write(f"{golden.name:22}{len(table_of(content)):6} scans  {end:20}{size:7} bytes  {was}\n")
    sys.stdout.write(f"{total} bytes in all\n")


if __name__ == "__main__":
    main()
