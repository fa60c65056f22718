"""One scan for the counters of the timing proof, with so many microseconds in each part."""

from __future__ import annotations

from station.records.scan_times import PARTS, ScanTimes


def scan(times: ScanTimes, number: int, missed: int = 0, lateness_us: int = 10, **parts_us: int) -> None:
    marks = [0]
    for part in PARTS:
        marks.append(marks[-1] + 1000 * parts_us.get(part, 20))
    times.add(number, missed, 1000 * lateness_us, tuple(marks))
