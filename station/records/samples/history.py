"""All samples of a run from the closing of the lock to the last scan, for pictures: also unloading and fault."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from definitions.image import State
from definitions.program import Program
from definitions.states import STATES
from definitions.units import ARCMIN_PER_RAD
from station.documents.events import Alarm
from station.records.samples.table import Table
from station.records.samples.zeroes import from_zero, output_torque_nm

FROM_STATE = tuple(row.state for row in STATES if row.state not in (State.IDLE, State.HOME))
"""States after the zeroes were taken."""

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class History:
    """Fresh samples of a run: time [s], output torque [N·m], angles at the output [arcmin], state, first alarm [s]."""

    t_s: FloatArray
    torque_nm: FloatArray
    windup_arcmin: FloatArray
    locked_arcmin: FloatArray | None
    state: npt.NDArray[np.int64]
    alarm_s: float | None
    alarm_text: str

    @property
    def alarm_index(self) -> int | None:
        """Position of the first sample at or behind the alarm that ended the run; None when there was none."""
        if self.alarm_s is None or not self.t_s.size:
            return None
        return min(int(np.searchsorted(self.t_s, self.alarm_s - 1e-9)), int(self.t_s.size) - 1)

    def thinned(self, most: int) -> npt.NDArray[np.intp]:
        """Return positions of about `most` samples spread over the run, and all around and behind the alarm."""
        every = np.arange(0, self.t_s.size, max(1, self.t_s.size // most), dtype=np.intp)
        index = self.alarm_index
        if index is None:
            return every
        tail = np.arange(max(index - most // 4, 0), min(index + most, self.t_s.size), dtype=np.intp)
        return np.union1d(every, tail)


def history_of(table: Table, program: Program, *, angle_out: bool, alarm: Alarm | None) -> History | None:
    """Return the samples of a run; None when it ended before its zeroes were taken.

    Args:
        table: all records of the run.
        program: its program: period, ratio and sensors.
        angle_out: whether the output shaft has an encoder.
        alarm: the alarm that ended the run, as it stands in the result.

    """
    counter = table["image"]["sample_counter"]
    fresh = np.ones(len(table), dtype=np.bool_)
    fresh[1:] = counter[1:] != counter[:-1]
    kept = table[fresh & np.isin(table["orders"]["state"], FROM_STATE)]
    if not len(kept):
        return None
    torque = output_torque_nm(kept, has_torque_out=program.has_torque_out)
    at_input = from_zero(kept, "angle_in_rad") / program.ratio * ARCMIN_PER_RAD
    at_output = from_zero(kept, "angle_out_rad") * ARCMIN_PER_RAD
    if not angle_out:
        at_output = np.zeros_like(at_input)
    sign = 1.0 if program.loading_input else -1.0
    locked = at_output if program.loading_input else at_input
    return History(
        t_s=kept["scan"] * program.period_s,
        torque_nm=np.asarray(torque, dtype=np.float64),
        windup_arcmin=sign * (at_input - at_output),
        locked_arcmin=locked if angle_out or not program.loading_input else None,
        state=kept["orders"]["state"].astype(np.int64),
        alarm_s=None if alarm is None else float(alarm.t_s),
        alarm_text="" if alarm is None else alarm.text,
    )


def conditions_of(table: Table, program: Program) -> dict[str, str]:
    """Return temperatures and zeroes of a run as a report says them, by name; empty without records."""
    measured = table[np.isin(table["orders"]["state"], FROM_STATE)]
    if not len(measured):
        return {}
    said = {}
    for name, field in (("housing temperature", "housing_temp_c"), ("room temperature", "ambient_temp_c")):
        values = measured["image"].get(field)
        if values is None:
            said[name] = "not recorded"
            continue
        said[name] = f"{values[0]:.1f} °C at the start, {values[-1]:.1f} °C at the end, highest {values.max():.1f} °C"
    last = measured[-1]["orders"]
    if program.has_torque_in:
        said["zero of the input torque"] = f"{last['torque_in_tare_nm']:+.4f} N·m, subtracted"
    if program.has_torque_out:
        said["zero of the output torque"] = f"{last['torque_out_tare_nm']:+.3f} N·m, subtracted"
    return {name: text.replace("-", "−") for name, text in said.items()}
