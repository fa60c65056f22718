"""What `lostmotion timing` says of figures that a good machine never shows."""

from __future__ import annotations

import made_reports
import pytest
from made_reports import gap

from station.cli.bench.timing import explain, histogram
from station.records.scan_times import ScanTimes
from station.timing.report import TimingReport


def report(missed: int, work_us: float = 160.0, late_us: float = 40.0, cause: str = "waking") -> TimingReport:
    late = {"p50": 12.0, "p99": late_us, "p999": 2 * late_us, "max": 900.0}
    work = {"p50": work_us, "p99": work_us, "p999": work_us, "max": work_us}
    gaps = [gap(8, missed, cause)] if missed else []
    return made_reports.report(missed=missed, gaps=gaps, lateness_us=late, work_us=work)


def test_a_calm_machine() -> None:
    told = " ".join(explain(report(0)))
    assert "160 µs of 1000 µs (16%)" in told
    assert "None of 1000 scan periods was missed" in told
    assert "stands in the way" not in told


def test_missed_periods_name_their_share_and_cause() -> None:
    told = " ".join(explain(report(3, cause="write")))
    assert "3 of 1000 scan periods were missed (0.300%" in told
    assert "sending to the bus took long" in told
    assert "same processor" in told


def test_too_much_work_and_late_waking_are_said() -> None:
    told = " ".join(explain(report(0, work_us=700.0, late_us=400.0)))
    assert "longer period" in told
    assert "too late for this period" in told


@pytest.mark.parametrize(
    ("scans", "told"),
    [((2353, 4753, 9153, 11453, 11653), True), ((2353, 4790, 9120, 11403, 11670), False), ((2353, 4753), False)],
)
def test_gaps_that_keep_a_rhythm_are_the_hosts(scans: tuple[int, ...], *, told: bool) -> None:
    found = made_reports.report(missed=3, gaps=[gap(n, 1, "waking") for n in scans])
    assert ("interrupted every 100 ms" in " ".join(explain(found))) == told


def test_histogram_rows_hold_every_scan() -> None:
    times = ScanTimes()
    for number in range(500):
        times.add(number, 0, number * 7000, (0, 1, 2, 3, 4))
    rows = histogram(times.histograms_us()["lateness"])
    assert sum(int(row.split("µs")[1].split()[0]) for row in rows) == 500
