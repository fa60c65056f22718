"""Step `latency`: how old the values are when a scan takes them, and how far the channels lag behind one another.

A small run with steep ramps on the locked unit. Ages are those of the record. Lags are where the changes of two
channels fit together best, to a fraction of a scan: the loaded angle against the drive's position, the loaded torque
against the drive's torque, the other torque against the loaded one. Between the two torques lies the unit with its
friction, so that one is told less exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from definitions.states import LOADED
from station.commissioning.trial_run import Plan, Tried
from station.documents.commissioning import Figure, Finding

PLAN = Plan("latency", proof=0.05, peak=0.10, rate_nm_s=250.0, dwell_s=0.1, count=3)

CHANGE_SCANS = 5
"""Scans over which a channel's change is taken: fewer are noise, more blur what shall be found."""

MOST_S = 0.1
"""Largest lag that is looked for."""

ALLOWED_S, ALLOWED_OTHER_S = 0.003, 0.008
"""Difference to the lag of the bench file: of channels of one shaft, and across the unit."""

LEAST_FIT = 0.4
"""Correlation of the changes below which no lag is told."""

HALF = 0.5
"""Of the age that the recipe allows: from there on the ramp is held."""

Column = npt.NDArray[np.float64]


class Age(NamedTuple):
    """Age of the values of a device [ms]: median, 99 %, largest, and what the recipe allows."""

    device: str
    median_ms: float
    p99_ms: float
    most_ms: float
    allowed_ms: float


class Lag(NamedTuple):
    """A channel behind another one [ms]: measured (None: not told), by the bench file, and how far they may differ."""

    channel: str
    against: str
    measured_ms: float | None
    declared_ms: float
    allowed_ms: float


def ages(tried: Tried) -> list[Age]:
    """Return how old the values of each device were under load."""
    image, limits = tried.table["image"], tried.job.recipe.interlocks
    period_ms = tried.job.recipe.sampling.period_ns * 1e-6
    mask = _loaded(tried)
    rows = (
        ("servo drive", "drive_age_scans", limits.drive_age_s),
        ("amplifier", "sample_age_scans", limits.sample_age_s),
        ("brake", "brake_age_scans", limits.brake_age_s),
        ("remote I/O", "io_age_scans", limits.io_age_s),
    )
    told = []
    for device, channel, allowed_s in rows:
        values = np.asarray(image[channel], dtype=float)[mask] * period_ms
        p50, p99 = np.percentile(values, [50, 99]) if values.size else (0.0, 0.0)
        told.append(Age(device, float(p50), float(p99), float(values.max(initial=0.0)), allowed_s * 1e3))
    return told


def lags(tried: Tried) -> list[Lag]:
    """Return how far each channel lags behind the one that drives it, by the sensors: not by the way to the scan."""
    bench, period_s = tried.job.bench, tried.job.recipe.sampling.period_ns * 1e-9
    sensors = bench.sensors
    loaded, locked = ("in", "out") if tried.job.recipe.loading == "input" else ("out", "in")
    mask = _loaded(tried)

    def column(name: str) -> Column:
        return np.asarray(tried.table["image"][name], dtype=float)[mask]

    def delay_scans(name: str) -> float:
        """Scans from the measurement to the scan that takes it; the drive answers SYNC."""
        if bench.channels is None or name.startswith("drive_"):
            return 0.0 if bench.channels is None else 1.0
        sensor = name.rsplit("_", 1)[0]
        return float(np.median(column(f"{sensor}_delay_scans"))) + bench.unasked_delay(sensor, period_s) / period_s

    told: list[Lag] = []

    def add(channel: str, against: str, declared_s: float, allowed_s: float) -> None:
        measured = lag_scans(column(against), column(channel), round(MOST_S / period_s))
        on_the_way = delay_scans(channel) - delay_scans(against)
        measured_ms = None if measured is None else (measured - on_the_way) * period_s * 1e3
        told.append(Lag(channel, against, measured_ms, declared_s * 1e3, allowed_s * 1e3))

    angle, torque = getattr(sensors, f"angle_{loaded}"), getattr(sensors, f"torque_{loaded}")
    other = getattr(sensors, f"torque_{locked}")
    if angle is not None:
        add(f"angle_{loaded}_rad", "drive_angle_rad", angle.lag_s, ALLOWED_S)
    if torque is not None:
        add(f"torque_{loaded}_nm", "drive_torque_nm", torque.lag_s, ALLOWED_S)
    if other is not None:
        behind = "drive_torque_nm" if torque is None else f"torque_{loaded}_nm"
        add(f"torque_{locked}_nm", behind, other.lag_s - (torque.lag_s if torque else 0.0), ALLOWED_OTHER_S)
    return told


def _loaded(tried: Tried) -> npt.NDArray[np.bool_]:
    return np.isin(np.asarray(tried.table["orders"]["state"]), [int(one) for one in LOADED])


def lag_scans(driving: Column, following: Column, most: int) -> float | None:
    """Return by how many scans a channel follows another one, at most `most` either way; None where they do not fit."""
    if driving.size < 4 * most or not np.ptp(driving) or not np.ptp(following):
        return None
    changes = [values[CHANGE_SCANS:] - values[:-CHANGE_SCANS] for values in (driving, following)]
    first, second = (change - change.mean() for change in changes)
    size = first.size

    def fit(shift: int) -> float:
        a = first[max(0, -shift) : size - max(0, shift)]
        b = second[max(0, shift) : size - max(0, -shift)]
        return float(a @ b / np.sqrt((a @ a) * (b @ b)))

    fits = np.array([fit(shift) for shift in range(-most, most + 1)])
    best = int(np.argmax(fits))
    if fits[best] < LEAST_FIT:
        return None
    if best in {0, 2 * most}:
        return float(best - most)
    left, middle, right = fits[best - 1 : best + 2]
    # a parabola through the three best: its top is a fraction of a scan beside the middle one
    return float(best - most + 0.5 * (left - right) / (left - 2.0 * middle + right))


def judged(tried: Tried, seen_ages: Sequence[Age], seen_lags: Sequence[Lag]) -> tuple[Finding, ...]:
    """Say what is older, or lags otherwise, than the files say."""
    findings = [*_of_ages(seen_ages), *_of_lags(seen_lags)]
    if not tried.complete:
        cure = "Correct this first; a wrong direction is found by: lostmotion bench direction."
        findings.append(Finding(what=f"The test run with small torque ended early: {tried.why}.", cure=cure))
    return tuple(findings)


def _of_ages(seen: Sequence[Age]) -> Iterator[Finding]:
    for one in seen:
        if one.p99_ms > HALF * one.allowed_ms:
            what = (
                f"{one.device}: values {one.p99_ms:.0f} ms old in 1 of 100 scans, recipe allows {one.allowed_ms:g} ms."
            )
            cure = "Ask the device more often (poll_every), shorten its own filter, or allow more in the recipe."
            yield Finding(what=what, cure=cure)


def _of_lags(seen: Sequence[Lag]) -> Iterator[Finding]:
    for one in seen:
        sensor = one.channel.rsplit("_", 1)[0]
        if one.measured_ms is None:
            what = f"{one.channel} does not follow {one.against}: no lag can be told."
            yield Finding(what=what, cure="Check this sensor and its coupling.")
        elif abs(one.measured_ms - one.declared_ms) > one.allowed_ms:
            what = (
                f"{one.channel} lags {one.measured_ms:.1f} ms behind {one.against}; bench file says "
                f"{one.declared_ms:g} ms, {one.allowed_ms:g} ms difference allowed."
            )
            cure = f"Set the same filter for all channels of the amplifier, or write the lag into sensors.{sensor}.lag."
            yield Finding(what=what, cure=cure)


def figures(tried: Tried, seen_ages: Sequence[Age], seen_lags: Sequence[Lag]) -> tuple[Figure, ...]:
    """Return what was measured, for the protocol."""
    rows = [Figure(name=f"age of {one.device}, 99 %", value=round(one.p99_ms, 3), unit="ms") for one in seen_ages]
    rows += [
        Figure(name=f"lag of {one.channel} behind {one.against}", value=round(one.measured_ms, 2), unit="ms")
        for one in seen_lags
        if one.measured_ms is not None
    ]
    return (*rows, Figure(name="record", value=tried.record.id))
