"""Which scan rate holds and what is the limit, on reports that were made up; the records of a ring that lost some."""

from __future__ import annotations

from pathlib import Path

import made_reports
import pytest
from made_reports import gap
from station_samples import IMAGE, ORDERS

from recipes import load_bench, load_recipe
from recipes.compiler.compiler import compile_program
from station.bench.request import load_job
from station.cli.bench.timing import lost_records
from station.documents.scan_report import Realtime
from station.records.samples.scan_record import RECORD_BYTES, pack
from station.scan.machine import against, resident_kb
from station.scan.realtime import Grant, spin_tail
from station.timing.rates import Rate, highest, limit, measured
from station.timing.report import TimingReport
from station.timing.run import Gapless, with_period

ROOT = Path(__file__).parents[3]
MEGABIT, BUS_US = 1_000_000, 460.0
GRANTED = Realtime(fifo=True, mlock=True)


def report(period_us: int, missed: int, cause: str = "read") -> TimingReport:
    gaps = [gap(8, missed, cause)] if missed else []
    return made_reports.report(period_ns=period_us * 1000, periods=10_000, missed=missed, gaps=gaps)


def rate(period_us: int, *, holds: bool) -> Rate:
    return Rate(period_us, 0.0 if holds else 0.01, 90.0, None, "step")


def test_a_megabit_bus_carries_two_kilohertz_and_not_much_more() -> None:
    job = load_job("rv-40e-121-quick", "virtual")
    assert job.bus_us == pytest.approx(410.0), "SYNC, a receive PDO of 5 bytes, two transmit PDOs of 6 and 8"


def test_rates_are_tried_until_two_fail() -> None:
    missed = {1000: 0, 667: 0, 500: 9, 400: 10, 333: 0, 250: 500}
    rates = list(measured(lambda period_us: report(period_us, missed[period_us])))
    assert [(one.period_us, one.holds) for one in rates] == [
        (1000, True), (667, True), (500, True), (400, False), (333, True), (250, False),
    ]  # fmt: skip
    assert rates[3].cause == "read"
    best = highest(rates)
    assert best is not None
    assert best.period_us == 500, "a faster one that holds by luck does not count"


def test_a_rate_that_the_machine_disturbed_is_measured_again_and_one_that_is_our_own_fault_is_not() -> None:
    missed = {1000: [0], 667: [40, 0], 500: [30, 20], 400: [10]}
    causes = {667: "waking", 500: "waking", 400: "read"}
    rates = list(measured(lambda us: report(us, missed[us].pop(0), causes.get(us, "read"))))
    assert [(one.period_us, one.missed_share, one.disturbed) for one in rates] == [
        (1000, 0.0, False), (667, 0.0, True), (500, 0.002, True), (400, 0.001, False),
    ]  # fmt: skip
    assert [("measured twice" in one.row(BUS_US)) for one in rates] == [False, True, True, False]


@pytest.mark.parametrize(
    ("holding", "failing", "said"),
    [
        ((1000, 667), (500,), "this computer: at 2000 Hz the controller itself took long"),
        ((1000, 667, 500), (400,), "the bus: the next faster rate would not fit"),
        ((1000, 667, 500, 400), (333,), "the bus: this computer would go faster"),
        ((1000, 667, 500), (), "the bus"),
        ((), (1000,), "this computer"),
    ],
)
def test_the_side_that_is_the_limit_is_named(holding: tuple[int, ...], failing: tuple[int, ...], said: str) -> None:
    rates = [rate(us, holds=True) for us in holding] + [rate(us, holds=False) for us in failing]
    told = limit(rates, BUS_US, MEGABIT)
    assert said in told[-1]
    assert any("2174 Hz" in line for line in told)
    assert ("no rate holds" in told[0]) == (not holding)
    assert all(one.row(BUS_US).count("%") == 3 for one in rates)


def records(scans: list[tuple[int, int, int]]) -> list[bytes]:
    return [pack((n, scan, 0, 0), IMAGE._replace(missed_periods=m), ORDERS) for n, scan, m in scans]


GOOD = records([(0, 0, 0), (1, 1, 0), (2, 5, 3), (3, 6, 0)])


def checked(count: int, scans: int, problem: str = "") -> TimingReport:
    return made_reports.report(records={"checked": count, "problem": problem}, scans=scans)


def test_records_without_a_gap_are_counted_over_several_drains() -> None:
    check = Gapless()
    check.take(GOOD[0] + GOOD[1])
    check.take(b"")
    check.take(GOOD[2] + GOOD[3])
    assert (check.checked, check.problem) == (4, "")
    assert lost_records(checked(4, scans=4)) == ""
    assert "1 of 5 records" in lost_records(checked(4, scans=5))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (GOOD[0] + GOOD[2], "record 2 came where 1 was due"),
        (GOOD[0] + records([(0, 0, 0), (1, 3, 1)])[1], "scan 3 follows 0"),
        (GOOD[0] + GOOD[1][:100] + bytes([GOOD[1][100] ^ 1]) + GOOD[1][101:RECORD_BYTES], "record 1 fails its CRC"),
    ],
)
def test_a_lost_or_damaged_record_is_told(content: bytes, said: str) -> None:
    check = Gapless()
    check.take(content)
    assert said in check.problem
    assert lost_records(checked(2, scans=2, problem=check.problem)) == check.problem


def test_another_period_reaches_the_controller() -> None:
    recipe = with_period(load_recipe(ROOT / "recipes" / "rv-40e-121-quick.yaml"), 500_000)
    assert recipe.sampling.period_s == 500e-6
    program = compile_program(recipe, load_bench(ROOT / "recipes" / "benches" / "virtual.yaml"))
    assert program.period_s == 500e-6
    assert program.limits.heartbeat_scans == 200  # 100 ms


def test_spinning_needs_fifo_and_says_so() -> None:
    fifo, none = (Grant("fifo", granted=True, detail=""),), (Grant("fifo", granted=False, detail=""),)
    assert spin_tail(100_000, fifo) == (
        100_000,
        Grant("spin_tail", granted=True, detail=spin_tail(100_000, fifo)[1].detail),
    )
    assert "100 µs" in spin_tail(100_000, fifo)[1].detail
    for wanted, grants, said in ((100_000, none, "SCHED_FIFO"), (0, fifo, "not requested")):
        spin_ns, answer = spin_tail(wanted, grants)
        assert (spin_ns, answer.granted) == (0, False)
        assert said in answer.detail


def test_memory_of_this_process_and_what_is_against_a_machine_of_nothing(tmp_path: Path) -> None:
    assert 10_000 < resident_kb() < 10_000_000
    assert resident_kb(tmp_path / "absent") == 0
    assert {"kernel", "isolated core"} <= {one.name for one in against(GRANTED, tmp_path)}
    assert all(one.mend for one in against(GRANTED, tmp_path))
