"""What recorded values are counted from: the tares of the torques, and where the angles stood.

Only here is a zero subtracted from what a record holds. While a run goes on, `controller.sample` does it.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from controller.aftermath import Rest
from definitions.image import State
from station.records.samples.table import Row, Table

ZEROES: Mapping[str, str] = MappingProxyType(
    {
        "torque_in_nm": "torque_in_tare_nm",
        "torque_out_nm": "torque_out_tare_nm",
        "angle_in_rad": "angle_in_zero_rad",
        "angle_out_rad": "angle_out_zero_rad",
    }
)
"""Channel of the inputs, and the order that is subtracted from it."""


def from_zero(records: Table | Row, channel: str) -> Any:
    """Return a channel of all records or of one, less its zero [N·m or rad]; AbsentChannelError where there is none."""
    return records["image"][channel] - records["orders"][ZEROES[channel]]


def read_again(table: Table) -> Table:
    """Return the new samples of a run in which its torque zeroes were read again: after it, lock open and drive off."""
    orders = table["orders"]
    there = table[(orders["state"] == State.COMPLETE) & (orders["phase"] == Rest.ZEROES)]
    counter = there["image"]["sample_counter"]
    fresh = np.ones(len(there), dtype=np.bool_)
    fresh[1:] = counter[1:] != counter[:-1]
    again: Table = there[fresh]
    return again


def output_torque_nm(records: Table | Row, *, has_torque_out: bool) -> Any:
    """Return the torque at the output [N·m]: of its sensor, or as the controller knew it where there is none."""
    return from_zero(records, "torque_out_nm") if has_torque_out else records["orders"]["controlled_torque_nm"]
