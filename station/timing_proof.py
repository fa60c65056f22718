"""The proof of timing: what the records say about lateness, work, missed periods and the age of samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from controller.image import SampleStatus, State
from station.record_check import Table

MEASURING_STATES = (State.CALIBRATE, State.RAMP_POS, State.REVERSE, State.RAMP_NEG)

UNSOUND: dict[SampleStatus, str] = {
    SampleStatus.TORQUE_IN_SATURATED: "the input torque sensor was saturated: check its range",
    SampleStatus.TORQUE_OUT_SATURATED: "the output torque sensor was saturated: check its range",
    SampleStatus.NOT_READY: "the measuring amplifier said that it was not ready",
}
"""What a status bit of the samples says of them; any of them makes the measurement invalid."""


def measuring(table: Table) -> Table:
    """Return the records taken while the recipe's torque was on the unit."""
    return table[np.isin(table["orders"]["state"], MEASURING_STATES)]


def _percentiles(values_ns: Any, names: dict[str, float]) -> dict[str, float]:
    if not values_ns.size:
        return dict.fromkeys((*names, "max"), 0.0)
    found = np.percentile(values_ns, list(names.values())) / 1000.0
    return {
        **{name: round(float(value), 3) for name, value in zip(names, found, strict=True)},
        "max": round(float(values_ns.max()) / 1000.0, 3),
    }


def timing_block(table: Table, period_ns: int, clock: str, realtime: dict[str, object]) -> dict[str, Any]:
    """Return the `timing` object of a result; times in µs, ages in scans. `clock` is "real" or "virtual"."""
    ages = measuring(table)["image"]["sample_age_scans"]
    return {
        "period_ns": period_ns,
        "clock": clock,
        "scans": len(table),
        "missed": int(table["image"]["missed_periods"].sum(dtype=np.int64)),
        "longest_gap_periods": int(table["image"]["missed_periods"].max(initial=0)),
        "lateness_us": _percentiles(table["lateness_ns"], {"p50": 50, "p99": 99, "p999": 99.9}),
        "work_us": _percentiles(table["work_ns"], {"p50": 50, "p99": 99, "p999": 99.9}),
        "oldest_sample_scans": int(ages.max(initial=0)),
        "realtime": realtime,
    }


def timing_objections(table: Table, timing: dict[str, Any], missed_fraction: float, sample_age_s: float) -> list[str]:
    """Return why the measurement does not count, in plain words; empty when timing and samples are in order.

    Args:
        table: all records of the run.
        timing: its timing block.
        missed_fraction: share of the periods that may be missed.
        sample_age_s: oldest sample allowed while measuring [s].

    """
    objections = []
    periods = timing["scans"] + timing["missed"]
    share = timing["missed"] / periods if periods else 0.0
    if share > missed_fraction:
        objections.append(
            f"{timing['missed']} of {periods} scan periods were missed ({share:.3%}), the recipe allows "
            f"{missed_fraction:.3%}: close other programs on this computer and measure again",
        )
    allowed = round(sample_age_s * 1e9 / timing["period_ns"])
    if timing["oldest_sample_scans"] > allowed:
        objections.append(
            f"a sample was {timing['oldest_sample_scans']} scans old while measuring, the recipe allows {allowed}: "
            "check the measuring amplifier and its network",
        )
    flags = measuring(table)["image"]["sample_status"]
    for bit, text in UNSOUND.items():
        count = int(np.count_nonzero(flags & bit))
        if count:
            objections.append(f"{text} in {count} samples")
    return objections
