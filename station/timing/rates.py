"""Which scan rates hold on this machine, how many a bus could carry, and which of the two is the limit.

A rate holds when fewer than 0.1 % of its periods were missed; one that the machine disturbed, and nothing of ours, is
measured a second time. An embedded bench has no bus that could be full; what a real one carries follows from its bit
rate: SYNC, one receive and two transmit PDOs go over it per scan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import NamedTuple

from station.records.scan_times import CAUSES
from station.timing.report import TimingReport

PERIODS_US = (1000, 667, 500, 400, 333, 250, 200, 167, 125, 100)
"""Periods that are tried, slowest first."""

MISSED_ALLOWED = 0.001
MACHINE = "waking"
"""The cause of `CAUSES` that is not the scan's own."""

HEAD = f"  {'scan rate':>9} {'missed':>9} {'work p99':>10} {'of period':>10} {'bench CPU':>10} {'bus':>6}   outcome"


class Rate(NamedTuple):
    """What one measurement said: period, share of missed periods, work, its cause when it does not hold."""

    period_us: int
    missed_share: float
    work_p99_us: float
    bench_share: float | None  # of a processor that an embedded virtual bench took
    cause: str
    disturbed: bool = False  # by the machine, once; this is the better of two measurements

    @property
    def holds(self) -> bool:
        """Whether it counts as one that holds."""
        return self.missed_share < MISSED_ALLOWED

    @property
    def hz(self) -> float:
        """Scans per second."""
        return 1e6 / self.period_us

    def row(self, bus_us: float) -> str:
        """Return it as a row of the table; bus_us: how long the frames of a scan occupy the bus."""
        bench = "-" if self.bench_share is None else f"{self.bench_share:.0%}"
        outcome = "holds" if self.holds else f"fails: {CAUSES[self.cause]}"
        outcome += "; measured twice" if self.disturbed else ""
        return (
            f"  {f'{self.hz:.0f} Hz':>9}{self.missed_share:>10.3%}{self.work_p99_us:>8.0f} µs"
            f"{self.work_p99_us / self.period_us:>11.0%}{bench:>11}{bus_us / self.period_us:>7.0%}   {outcome}"
        )


def rate_of(report: TimingReport) -> Rate:
    """Return what a report of `lostmotion timing` says of its rate."""
    causes = [gap.before.cause for gap in report.gaps]
    duration_s = report.periods * report.period_ns * 1e-9
    bench_s = report.virtual_bench_cpu_s
    return Rate(
        period_us=report.period_ns // 1000,
        missed_share=report.missed / report.periods,
        work_p99_us=report.work_us.p99,
        bench_share=None if bench_s is None else bench_s / duration_s,
        cause=max(set(causes), key=causes.count) if causes else MACHINE,
    )


def measured(measure: Callable[[int], TimingReport]) -> Iterator[Rate]:
    """Measure one rate after the other, `measure(period_us)` each; end after two that did not hold."""
    failed = 0
    for period_us in PERIODS_US:
        rate = rate_of(measure(period_us))
        if not rate.holds and rate.cause == MACHINE:
            again = rate_of(measure(period_us))
            rate = min(rate, again, key=attrgetter("missed_share"))._replace(disturbed=True)
        yield rate
        failed += not rate.holds
        if failed == 2:
            return


def highest(rates: list[Rate]) -> Rate | None:
    """Return the fastest rate that holds together with all slower ones; None when not even the slowest does."""
    best = None
    for rate in rates:
        if not rate.holds:
            break
        best = rate
    return best


def limit(rates: list[Rate], bus_us: float, bitrate: int) -> list[str]:
    """Return the highest rate that holds, the bus's own limit beside it, and which side is the limit."""
    best, bus_hz = highest(rates), 1e6 / bus_us
    bus = f"a bus of {bitrate / 1e6:g} Mbit/s carries {bus_hz:.0f} Hz at most"
    slower = [rate for rate in rates if not rate.holds]
    if best is None:
        return [f"no rate holds: at {rates[0].hz:.0f} Hz {CAUSES[rates[0].cause]}", bus, "the limit is this computer"]
    told = [f"highest scan rate that holds: {best.hz:.0f} Hz ({best.period_us} µs)", bus]
    if best.hz > bus_hz:
        return [*told, "the limit is the bus: this computer would go faster than a real one carries"]
    nearest = next((rate for rate in slower if rate.hz > best.hz), None)
    if nearest is None or nearest.hz > bus_hz:
        return [*told, "the limit is the bus: the next faster rate would not fit on it"]
    return [*told, f"the limit is this computer: at {nearest.hz:.0f} Hz {CAUSES[nearest.cause]}"]
