"""A measured trace: channels over time, and which piece of the load profile each sample belongs to.

Sign convention: positive torque and positive angle turn the same way on both shafts. Zeroes and tares are subtracted
by whoever makes the trace.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from analysis.trace.errors import AnalysisError
from analysis.trace.units import BoolArray, FloatArray, IntArray

CHANNELS = {
    "t_s": "time",
    "torque_in_nm": "torque at the input shaft",
    "torque_out_nm": "torque at the output shaft",
    "angle_in_rad": "angle of the input shaft",
    "angle_out_rad": "angle of the output shaft",
    "temperature_c": "temperature of the housing",
    "drive_torque_nm": "torque that the servo drive reports, at the loaded shaft",
    "drive_angle_rad": "position that the servo drive reports, at the loaded shaft",
}
"""Channels of a trace and their meaning; the unit is in the name."""

ROLES = ("calibrate", "virgin", "measure", "fatigue", "dwell", "sweep", "unload", "other")
"""What a segment of the load profile is for; only `calibrate` and `measure` are evaluated."""

LARGEST_VALUE = 1e9
"""Larger magnitudes are refused: no channel of a bench reaches it, and squares of it still are finite."""


class SegmentInfo(NamedTuple):
    """One piece of the load profile as commanded: role (of ROLES), direction of torque (+1, -1, 0), cycle from 1."""

    role: str
    direction: int = 0
    cycle: int = 0


@dataclass(frozen=True)
class Trace:
    """Samples of one run as arrays of equal length; a channel that was not measured is None.

    segment: segment id per sample, its meaning in `segments`; None when the profile is not known (turning points are
    then found on the curve). reading: how a file was read, in words, where it is not plain. windup_made: what stands in
    angle_out_rad is the wind-up of the unit, made elsewhere with all its corrections. delays_s: by channel, how long
    before the time of its row each value was measured [s], 0 or more; no entry: at that time. Raises AnalysisError when
    lengths differ, a value is not finite or beyond 1e9, time runs backwards, or a segment id or role is
    unknown; the text names column and row (counted from 1).
    """

    t_s: FloatArray | None = None
    torque_in_nm: FloatArray | None = None
    torque_out_nm: FloatArray | None = None
    angle_in_rad: FloatArray | None = None
    angle_out_rad: FloatArray | None = None
    temperature_c: FloatArray | None = None
    drive_torque_nm: FloatArray | None = None
    drive_angle_rad: FloatArray | None = None
    segment: IntArray | None = None
    segments: Mapping[int, SegmentInfo] = field(default_factory=dict)
    source: str = "trace"
    reading: str = ""
    windup_made: bool = False
    delays_s: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check and normalise the arrays (float64, int64)."""
        lengths: dict[str, int] = {}
        for name in CHANNELS:
            values = getattr(self, name)
            if values is not None:
                array = _as_floats(values, self.source, name)
                object.__setattr__(self, name, array)
                lengths[name] = array.size
        delays = {name: _as_floats(values, self.source, f"delay of {name}") for name, values in self.delays_s.items()}
        object.__setattr__(self, "delays_s", delays)
        lengths |= {f"delay of {name}": array.size for name, array in delays.items()}
        if self.segment is not None:
            object.__setattr__(self, "segment", np.asarray(self.segment, dtype=np.int64))
            lengths["segment"] = int(np.asarray(self.segment).size)
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{name} has {count}" for name, count in lengths.items())
            raise AnalysisError(f"{self.source}: {found} samples; every column needs the same number of samples")
        if not lengths or not next(iter(lengths.values())):
            raise AnalysisError(f"{self.source}: no samples; expected rows with {', '.join(CHANNELS)}")
        _check_time(self.t_s, self.source)
        self._check_segments()

    def _check_segments(self) -> None:
        for key, info in self.segments.items():
            if info.role not in ROLES or info.direction not in (-1, 0, 1):
                raise AnalysisError(
                    f"{self.source}: segment {key} has role '{info.role}', direction {info.direction}; "
                    f"roles are {', '.join(ROLES)}, directions -1, 0, 1"
                )
        if self.segment is not None and self.segments:
            # A long segment is one value: only where the id changes is looked at.
            changes = np.flatnonzero(self.segment[1:] != self.segment[:-1]) + 1
            for key in np.unique(self.segment[np.concatenate(([0], changes))]):
                if int(key) not in self.segments:
                    row = int(np.flatnonzero(self.segment == key)[0]) + 1
                    raise AnalysisError(
                        f"{self.source}: row {row}, column segment: id {key} is not in the segment table "
                        f"({', '.join(str(known) for known in self.segments)}); add its meaning to the table"
                    )

    @property
    def samples(self) -> int:
        """Number of samples."""
        return next(int(values.size) for name in CHANNELS for values in (getattr(self, name),) if values is not None)

    @cached_property
    def step_s(self) -> float | None:
        """Median time between two samples [s]; None without time."""
        return None if self.t_s is None else float(np.median(np.diff(self.t_s)))

    def channel(self, name: str, needed_for: str) -> FloatArray:
        """Return a channel by name; AnalysisError naming the column and what needs it when it was not measured."""
        values: FloatArray | None = getattr(self, name)
        if values is None:
            there = ", ".join(known for known in CHANNELS if getattr(self, known) is not None)
            raise AnalysisError(
                f"{self.source}: column {name} ({CHANNELS[name]}) is missing and needed for {needed_for}; "
                f"found are {there}; add the column or choose a method that does without it"
            )
        return values


def first_bad_row(bad: BoolArray) -> int:
    """Row of the first true entry, counted from 1."""
    return int(np.argmax(bad)) + 1


def _as_floats(values: FloatArray, source: str, name: str) -> FloatArray:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise AnalysisError(f"{source}: column {name}: {error}; expected numbers") from error
    if array.ndim != 1:
        raise AnalysisError(f"{source}: column {name} has {array.ndim} dimensions; expected one value per sample")
    # Comparisons with NaN are false; minimum and maximum need no copy of the array.
    if array.size and not (array.min() >= -LARGEST_VALUE and array.max() <= LARGEST_VALUE):
        row = first_bad_row(~(np.abs(array) <= LARGEST_VALUE))
        raise AnalysisError(
            f"{source}: row {row}, column {name}: found {array[row - 1]}; expected a finite number within "
            f"±{LARGEST_VALUE:g}; remove the row or repair the value"
        )
    return array


def _check_time(t_s: FloatArray | None, source: str) -> None:
    if t_s is not None and t_s.size > 1:
        backwards = t_s[1:] < t_s[:-1]
        if backwards.any():
            row = first_bad_row(backwards) + 1
            raise AnalysisError(
                f"{source}: row {row}, column t_s: found {t_s[row - 1]} after {t_s[row - 2]}; time must not run "
                "backwards; sort the rows by time"
            )
