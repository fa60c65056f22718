"""The proof of timing as rows of text: percentiles of every part, missed periods with what took the time, long scans.

Made from timing.json of a run in real time; what a record of an older version lacks is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from station.errors import RecordError
from station.records.clocks import SCAN, WALL, clock_of
from station.records.run_record import RunRecord
from station.records.scan_times import CAUSES, PARTS

Row = tuple[str, ...]
Scan = Mapping[str, Any]

PERCENTILES = {"p50": "p50", "p99": "p99", "p999": "p99.9", "max": "max"}
PERCENTILE_HEADS = ("µs", *PERCENTILES.values())
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


def timing_proof(record: RunRecord) -> dict[str, Any]:
    """Return timing.json of a run; nothing where it is missing or damaged, which others tell."""
    try:
        found = record.read_json("timing.json")
    except RecordError:
        return {}
    return found if isinstance(found, dict) else {}


def timing_tables(proof: Mapping[str, Any]) -> TimingTables:
    """Return the tables of a run in real time, empty ones for virtual time or a proof that is damaged."""
    if clock_of(proof) not in (WALL, SCAN):
        return TimingTables()
    try:
        period_s = float(proof["period_ns"]) * 1e-9
        # Most of the missed periods lie in the longest gaps; what is shown of them is in order of time.
        gaps = sorted(_longest_gaps(proof)[:MISSED_SHOWN], key=lambda gap: int(gap["scan"]))
        shown = [("longest", one) for one in _scans(proof, "longest_scans")]
        shown += [("latest", one) for one in _scans(proof, "latest_scans")]
        causes = {str(one["cause"]) for one in (*(gap["before"] for gap in gaps), *(one for _, one in shown))}
        return TimingTables(
            percentiles=_percentile_rows(proof),
            missed=tuple(_missed_row(gap, period_s) for gap in gaps),
            more=_more(proof, len(gaps)),
            scans=_scan_rows(shown, period_s),
            causes=tuple((SHORT_CAUSES[name], text) for name, text in CAUSES.items() if name in causes),
        )
    except (KeyError, TypeError, ValueError, AttributeError):
        return TimingTables()


def timing_details(proof: Mapping[str, Any]) -> list[str]:
    """Return at most two lines for the screen: the longest gaps and why, and what the parts of a scan took."""
    if clock_of(proof) not in (WALL, SCAN):
        return []
    try:
        told = []
        gaps = [gap for gap in _longest_gaps(proof) if gap["missed"]]
        if gaps:
            after = [f"{gap['missed']} after scan {_reason(gap['before'])}" for gap in gaps[:GAPS_ON_SCREEN]]
            count = int(proof.get("gaps_in_all", len(gaps)))
            head = f"{count} {'gap' if count == 1 else 'gaps'}: missed {', '.join(after)}"
            told.append(head + ("; more in timing.json" if count > GAPS_ON_SCREEN else ""))
        if proof.get("parts_us"):
            parts = ", ".join(f"{part} {proof['parts_us'][part]['p99']:.0f}" for part in PARTS)
            longest = "".join(f"; longest scan {_reason(one)}" for one in _scans(proof, "longest_scans")[:1])
            told.append(f"parts p99: {parts} µs{longest}")
    except (KeyError, TypeError, ValueError, AttributeError):
        return []
    return told


def _reason(scan: Scan) -> str:
    """Return the number of a scan with what took most of its time."""
    return f"{scan['scan']} ({SHORT_CAUSES[scan['cause']]})"


def _longest_gaps(proof: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return sorted(proof.get("gaps") or (), key=lambda gap: -int(gap["missed"]))


def _scans(proof: Mapping[str, Any], name: str) -> list[Scan]:
    return list(proof.get(name) or ())[:SCANS_SHOWN]


def _percentile_rows(proof: Mapping[str, Any]) -> tuple[Row, ...]:
    series = {"lateness": proof["lateness_us"], "work": proof["work_us"], **(proof.get("parts_us") or {})}
    return tuple((name, *(f"{found[key]:.1f}" for key in PERCENTILES)) for name, found in series.items())


def _times(scan: Scan) -> Row:
    return tuple(f"{scan[f'{name}_us']:.0f}" for name in ("lateness", *PARTS))


def _missed_row(gap: Mapping[str, Any], period_s: float) -> Row:
    before = gap["before"]
    when = f"{before['scan'] * period_s:.3f} s"
    return (str(before["scan"]), when, str(gap["missed"]), SHORT_CAUSES[before["cause"]], *_times(before))


def _scan_rows(shown: Sequence[tuple[str, Scan]], period_s: float) -> tuple[Row, ...]:
    """Return the scans; the word before them stands once for each kind."""
    rows, said = [], ""
    for kind, one in shown:
        when = f"{one['scan'] * period_s:.3f} s"
        rows.append((kind if kind != said else "", str(one["scan"]), when, SHORT_CAUSES[one["cause"]], *_times(one)))
        said = kind
    return tuple(rows)


def _more(proof: Mapping[str, Any], shown: int) -> str:
    kept = len(proof.get("gaps") or ())
    count = int(proof.get("gaps_in_all", kept))
    if count <= shown:
        return ""
    first = f", which has the first {kept}" if count > kept else ""
    return f"and {count - shown} more, in timing.json{first}"
