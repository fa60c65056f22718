"""The proof of timing as rows of text: percentiles of every part, missed periods with what took the time, long scans.

Made from timing.json of a run in real time; what a record of an older version lacks is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from station.documents.scan_report import Gap, ScanRow
from station.documents.timing import Timing
from station.errors import RecordError
from station.records.clocks import SCAN, WALL, clock_of
from station.records.run_record import TIMING, RunRecord
from station.records.scan_times import CAUSES, PARTS

Row = tuple[str, ...]

PERCENTILE_HEADS = ("µs", "p50", "p99", "p99.9", "max")
MISSED_HEADS = ("after scan", "time", "missed", "what took the time", "late", *PARTS)
SCAN_HEADS = ("", "scan", "time", "what took most", "late", *PARTS)

MISSED_SHOWN = 10
SCANS_SHOWN = 5
GAPS_ON_SCREEN = 2

SHORT_CAUSES = {"waking": "woken late"} | {part: f"long {part}" for part in PARTS}


@dataclass(frozen=True)
class TimingTables:
    """Tables of the section on timing; an empty one is not shown.

    percentiles: rows of `PERCENTILE_HEADS` [µs]. missed: rows of `MISSED_HEADS`, in order of time; `more` says how many
    are left out. scans: rows of `SCAN_HEADS`, longest work, then latest. causes: (name, text) of what took the time.
    """

    percentiles: tuple[Row, ...] = ()
    missed: tuple[Row, ...] = ()
    more: str = ""
    scans: tuple[Row, ...] = ()
    causes: tuple[Row, ...] = ()


def timing_proof(record: RunRecord) -> Timing | None:
    """Return timing.json of a run; None where it is missing or damaged, which others tell."""
    try:
        return record.read(Timing, TIMING)
    except RecordError:
        return None


def timing_tables(proof: Timing | None) -> TimingTables:
    """Return the tables of a run in real time; empty ones for virtual time, and where there is no proof."""
    if proof is None or clock_of(proof.clock) not in (WALL, SCAN):
        return TimingTables()
    period_s = proof.period_ns * 1e-9
    # Most of the missed periods lie in the longest gaps; what is shown of them is in order of time.
    gaps = sorted(_longest_gaps(proof)[:MISSED_SHOWN], key=lambda gap: gap.scan)
    shown = [("longest", one) for one in (proof.longest_scans or ())[:SCANS_SHOWN]]
    shown += [("latest", one) for one in (proof.latest_scans or ())[:SCANS_SHOWN]]
    causes = {one.cause for one in (*(gap.before for gap in gaps), *(one for _, one in shown))}
    return TimingTables(
        percentiles=_percentile_rows(proof),
        missed=tuple(_missed_row(gap, period_s) for gap in gaps),
        more=_more(proof, len(gaps)),
        scans=_scan_rows(shown, period_s),
        causes=tuple((SHORT_CAUSES[name], text) for name, text in CAUSES.items() if name in causes),
    )


def timing_details(proof: Timing | None) -> list[str]:
    """Return at most two lines for the screen: the longest gaps and why, and what the parts of a scan took."""
    if proof is None or clock_of(proof.clock) not in (WALL, SCAN):
        return []
    told = []
    gaps = [gap for gap in _longest_gaps(proof) if gap.missed]
    if gaps:
        after = [f"{gap.missed} after scan {_reason(gap.before)}" for gap in gaps[:GAPS_ON_SCREEN]]
        count = len(gaps) if proof.gaps_in_all is None else proof.gaps_in_all
        head = f"{count} {'gap' if count == 1 else 'gaps'}: missed {', '.join(after)}"
        told.append(head + ("; more in timing.json" if count > GAPS_ON_SCREEN else ""))
    if proof.parts_us:
        parts = ", ".join(f"{name} {one.p99:.0f}" for name, one in proof.parts_us.items())
        longest = "".join(f"; longest scan {_reason(one)}" for one in (proof.longest_scans or ())[:1])
        told.append(f"scan time by part (p99): {parts} µs{longest}")
    return told


def _reason(scan: ScanRow) -> str:
    """Return the number of a scan with what took most of its time."""
    return f"{scan.scan} ({SHORT_CAUSES[scan.cause]})"


def _longest_gaps(proof: Timing) -> list[Gap]:
    return sorted(proof.gaps or (), key=lambda gap: -gap.missed)


def _percentile_rows(proof: Timing) -> tuple[Row, ...]:
    series = {"wake-up latency": proof.lateness_us, "work": proof.work_us, **(proof.parts_us or {})}
    return tuple(
        (name, *(f"{figure:.1f}" for figure in (found.p50, found.p99, found.p999, found.max)))
        for name, found in series.items()
    )


def _times(scan: ScanRow) -> Row:
    times = (scan.lateness_us, scan.read_us, scan.step_us, scan.write_us, scan.record_us)
    return tuple(f"{time_us:.0f}" for time_us in times)


def _missed_row(gap: Gap, period_s: float) -> Row:
    before = gap.before
    when = f"{before.scan * period_s:.3f} s"
    return (str(before.scan), when, str(gap.missed), SHORT_CAUSES[before.cause], *_times(before))


def _scan_rows(shown: Sequence[tuple[str, ScanRow]], period_s: float) -> tuple[Row, ...]:
    """Return the scans; the word before them stands once for each kind."""
    rows, said = [], ""
    for kind, one in shown:
        when = f"{one.scan * period_s:.3f} s"
        rows.append((kind if kind != said else "", str(one.scan), when, SHORT_CAUSES[one.cause], *_times(one)))
        said = kind
    return tuple(rows)


def _more(proof: Timing, shown: int) -> str:
    kept = len(proof.gaps or ())
    count = kept if proof.gaps_in_all is None else proof.gaps_in_all
    if count <= shown:
        return ""
    first = f", which has the first {kept}" if count > kept else ""
    return f"{count - shown} more gaps are in timing.json{first}"
