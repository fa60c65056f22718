"""`lostmotion timing` and `doctor`: what this machine can do, measured with the whole scan; what stands in its way."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace

from station.bench.request import load_job
from station.cli.say import Grid, say
from station.documents.entries import plain
from station.documents.scan_report import ScanRow
from station.records.scan_times import CAUSES, PARTS
from station.scan.machine import look
from station.timing.rates import HEAD, MISSED_ALLOWED, Rate, limit, measured
from station.timing.report import Asked, TimingReport
from station.timing.run import measure

DEFAULT_RECIPE = "rv-40e-121-quick"
IN_THE_WAY = 1

BINS_US = (5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 100_000)
BAR = 40
GAPS_SHOWN = 10
RATION_MS = 100
"""Period at which Linux hosts ration processor time (CFS bandwidth control)."""

RHYTHM_GAPS = 4
RHYTHM_WIDTH = 0.05
LONG_SHOWN = 5


def timing(recipe: str | None, bench: str | None, asked: Asked, *, as_json: bool) -> int:
    """Measure and explain; return 0, or 1 when more periods were missed than a recipe allows, or a record is missing.

    Raises:
        StationError, RecipeError: the bench file is wrong, or the bench cannot be opened.

    """
    job = load_job(recipe or DEFAULT_RECIPE, bench)
    report = measure(job, asked)
    report = replace(report, explanation=tuple(explain(report)))
    if as_json:
        sys.stdout.write(json.dumps(plain(report), ensure_ascii=False) + "\n")
    else:
        sys.stdout.write("\n".join(lines(report)) + "\n")
    return 1 if report.missed > MISSED_ALLOWED * report.periods or lost_records(report) else 0


def rates(recipe: str | None, bench: str | None, asked: Asked, *, as_json: bool) -> int:
    """Measure one scan rate after the other; return 0 when at least the slowest holds, else 1.

    Raises:
        StationError, RecipeError: the bench file is wrong, or the bench cannot be opened.

    """
    job = load_job(recipe or DEFAULT_RECIPE, bench)
    bitrate = job.bench.can.bitrate
    found: list[Rate] = []
    if not as_json:
        sys.stdout.write(f"{asked.seconds:g} s at each scan rate, bench {job.bench.bench.name}\n{HEAD}\n")
    for rate in measured(lambda period_us: measure(job, replace(asked, period_ns=period_us * 1000))):
        found.append(rate)
        if not as_json:
            sys.stdout.write(rate.row(job.bus_us) + "\n")
            sys.stdout.flush()
    told = limit(found, job.bus_us, bitrate)
    if as_json:
        rows = [rate._asdict() | {"holds": rate.holds} for rate in found]
        whole = {"rates": rows, "bitrate": bitrate, "bus_us": job.bus_us, "explanation": told}
        sys.stdout.write(json.dumps(whole, ensure_ascii=False) + "\n")
    else:
        sys.stdout.write("\n".join(told) + "\n")
    return 0 if found[0].holds else 1


def lost_records(report: TimingReport) -> str:
    """Return what is wrong with the records that came out of the ring; empty when none is missing or damaged."""
    records = report.records
    if records.problem:
        return records.problem
    missing = report.scans - records.checked
    return f"{missing} of {report.scans} records were lost in the record buffer" if missing else ""


def explain(report: TimingReport) -> list[str]:
    """Return what the figures mean, in plain words."""
    period_us = report.period_ns / 1000.0
    late, work = report.lateness_us, report.work_us
    used = work.p50 / period_us
    told = [
        f"A scan takes {work.p50:.0f} µs of {period_us:.0f} µs ({used:.0%}), 1 in 1000 over {work.p999:.0f} µs.",
        f"It starts {late.p50:.0f} µs after its deadline, 1 in 100 later than {late.p99:.0f} µs.",
        "The amplifier stamps its samples, so a late scan does not distort the curve; it adds to the reaction time.",
    ]
    if report.missed == 0:
        told.append(f"None of {report.periods} scan periods was missed.")
    else:
        causes = [gap.before.cause for gap in report.gaps]
        most = max(dict.fromkeys(causes), key=causes.count)
        share = report.missed / report.periods
        told.append(
            f"{report.missed} of {report.periods} scan periods were missed ({share:.3%}; recipes allow about 0.1 %). "
            f"Most frequent cause, in {causes.count(most)} of {len(causes)} gaps between scans: {CAUSES[most]}.",
        )
    every_ms = _rhythm_ms(report)
    if every_ms:
        told.append(
            f"The scan is interrupted every {every_ms} ms: the processor time is limited by the host of a "
            "virtual machine or by a container. Change that limit; no setting of this program helps.",
        )
    if late.p999 > 0.5 * period_us:
        told.append(
            "The computer sometimes wakes the scan too late for this period. 'lostmotion doctor' lists the causes."
        )
    if used > 0.5:
        told.append(
            "The work of a scan takes more than half of the scan period. Choose a longer period, or a faster processor."
        )
    if report.embedded and report.missed:
        told.append(
            "The virtual bench ran on the same processor, which may have delayed the scan. With a real bench, the scan "
            "has the processor alone."
        )
    return told


def _rhythm_ms(report: TimingReport) -> int:
    """Return the period at whose fixed phase the gaps lie [ms], 0 when they lie anywhere."""
    times_ms = [gap.before.scan * report.period_ns * 1e-6 for gap in report.gaps]
    if len(times_ms) < RHYTHM_GAPS:
        return 0
    phases = [(time_ms - times_ms[0] + RATION_MS / 2) % RATION_MS - RATION_MS / 2 for time_ms in times_ms]
    inside = sum(abs(phase) <= RHYTHM_WIDTH * RATION_MS for phase in phases)
    return RATION_MS if inside >= 0.8 * len(times_ms) else 0


def histogram(edges: Sequence[tuple[float, int]]) -> list[str]:
    """Return a histogram as rows of text; `edges` are pairs of upper edge [µs] and count."""
    total = sum(count for _, count in edges)
    rows, low = [], 0.0
    for high in (*BINS_US, float("inf")):
        count = int(sum(n for edge, n in edges if low < edge <= high))
        if count:
            label = f"over {low:g}" if high == float("inf") else f"to {high:g}"
            bar = "#" * max(round(BAR * count / total), 1)
            rows.append(f"  {label:>11} µs {count:>9} scans  {bar}")
        low = float(high)
    return rows


def lines(report: TimingReport) -> list[str]:
    """Return the report for a person."""
    seconds = report.periods * report.period_ns * 1e-9
    bench = f"{report.bench}{' (embedded)' if report.embedded else ''}"
    out = [
        f"{report.scans} scans of {report.period_ns / 1e6:g} ms in {seconds:.1f} s on bench {bench}",
        f"controller idle, busy-wait before each deadline {report.spin_ns // 1000} µs",
        "",
        f"{'µs':17}{'p50':>9}{'p99':>9}{'p99.9':>9}{'max':>10}",
    ]
    rows = {"wake-up latency": report.lateness_us, "work": report.work_us, **report.parts_us}
    for name, row in rows.items():
        label = f"  {name}" if name in PARTS else name
        out.append(f"{label:17}{row.p50:>9.1f}{row.p99:>9.1f}{row.p999:>9.1f}{row.max:>10.1f}")
    out += ["", "wake-up latency", *histogram(report.histograms_us["lateness"])]
    out += ["", "work", *histogram(report.histograms_us["work"])]
    out += ["", f"missed periods: {report.missed}"]
    for gap in report.gaps[:GAPS_SHOWN]:
        before = gap.before
        out.append(
            f"  {gap.missed} scan periods missed before scan {gap.scan}: scan {before.scan} was "
            f"{before.lateness_us:.0f} µs late, its work took {_parts(before)} ({CAUSES[before.cause]})"
        )
    if report.gaps_in_all > GAPS_SHOWN:
        out.append(f"  and {report.gaps_in_all - GAPS_SHOWN} more gaps between scans (--json lists up to 256)")
    out += ["", "longest scans"]
    for one in report.longest_scans[:LONG_SHOWN]:
        out.append(f"  scan {one.scan}: its work took {_parts(one)}; it started {one.lateness_us:.0f} µs late")
    out += ["", "latest scans"]
    for one in report.latest_scans[:LONG_SHOWN]:
        out.append(f"  scan {one.scan}: it started {one.lateness_us:.0f} µs late; its work took {_parts(one)}")
    out += ["", *footing(report)]
    realtime = report.realtime
    out += ["", "requested from the system"]
    out += [
        f"  {'granted' if realtime.granted(name) else 'refused'}  {name}: {d}" for name, d in realtime.details.items()
    ]
    out += ["", "what stands in the way"]
    against = [row for row in report.machine if not row.in_order]
    out += [f"  {row.found}; remedy: {row.mend}" for row in against] or ["  nothing"]
    return [*out, "", *report.explanation]


def footing(report: TimingReport) -> list[str]:
    """Return what the scan needs beside time: every record, memory that does not grow, room on the bus."""
    memory, period_us, bus = report.resident_kb, report.period_ns / 1000.0, report.bus_us
    wrong = lost_records(report)
    sequence = wrong or "no gap in sequence or scan numbers, every CRC right"
    grown_kb = memory.after - memory.before
    resident = f"{memory.before / 1024:.1f} MiB at its start, {memory.after / 1024:.1f} MiB at its end"
    wire = f"{bus:.0f} µs of {period_us:g} µs at {report.bitrate / 1e6:g} Mbit/s ({bus / period_us:.0%})"
    return [
        f"records: {report.records.checked} checked, {sequence}",
        f"memory of the scan process: {resident} (grown by {grown_kb} KiB)",
        f"bus: the frames of a scan take {wire}; {1e6 / bus:.0f} Hz at most",
    ]


def _parts(scan: ScanRow) -> str:
    return ", ".join(f"{part} {getattr(scan, f'{part}_us'):.0f}" for part in PARTS) + " µs"


def doctor(*, as_json: bool) -> int:
    """Print every look at the machine; return 0 when nothing stands in the way, else 1."""
    findings = look()
    wrong = [one for one in findings if not one.in_order]
    if as_json:
        sys.stdout.write(json.dumps(plain(findings), ensure_ascii=False) + "\n")
        return IN_THE_WAY if wrong else 0
    rows = [("ok" if one.in_order else "FIX", one.name, one.found) for one in findings]
    blocks: list[str | Grid] = [Grid(("", "", ""), rows)]
    blocks += [f"{one.name}: {one.mend}" for one in wrong]
    blocks.append(
        "Then measure: lostmotion timing --seconds 60"
        if wrong
        else "Nothing stands in the way. What the machine does, 'lostmotion timing --seconds 60' measures"
    )
    say({}, blocks, as_json=False)
    return IN_THE_WAY if wrong else 0
