"""Up to which scan another recipe would have run the same: its controller beside the run's own, on the recorded images.

While both order the same, the bench would have answered the same, and the recorded images are exactly those that the
other controller would have seen. From the first scan in which any order differs the bench would have gone another way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from controller.controller import Controller
from definitions.faults import Fault, cause_among
from definitions.image import ORDERS_FIELDS, ORDERS_STRUCT, DriveCommand, DriveMode, Image, Orders, Reaction, State

NAMES = {"state": State, "reaction": Reaction, "drive_command": DriveCommand, "drive_mode": DriveMode}
"""Orders whose numbers have names."""

MOST_NAMED = 3
"""Differing orders that are named when no alarm says it better: those to the devices come first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstDifference:
    """A divergence with its time, as it is printed; `fault` is None where none is raised by one recipe only."""

    scan: int
    t_s: float
    state: str
    fault: str | None
    cause: str


class Divergence(NamedTuple):
    """The first scan in which the other recipe would have ordered something else.

    `state` is the one the scan began in, `fault` the id of the alarm that only one of the two raises ('' when none
    does), `cause` what would have been otherwise, in words.
    """

    sequence: int
    scan: int
    state: str
    fault: str
    cause: str

    def at(self, period_ns: int) -> str:
        """Return when it was, for a person."""
        return f"scan {self.scan} ({self.scan * period_ns * 1e-9:.3f} s, {self.state})"

    def document(self, period_ns: int) -> FirstDifference:
        """Return it as it is printed."""
        t_s = round(self.scan * period_ns * 1e-9, 6)
        fault = self.fault or None
        return FirstDifference(scan=self.scan, t_s=t_s, state=self.state, fault=fault, cause=self.cause)


class Beside:
    """Steps the run's own controller and, until the two part, the other recipe's; gives the orders of the own one."""

    def __init__(self, own: Controller, other: Controller) -> None:
        self._own = own
        self._other = other
        self._steps = 0
        self.divergence: Divergence | None = None

    def step(self, image: Image, scan: int) -> Orders:
        """Decide one scan by the run's own program."""
        state = self._own.state
        orders = self._own.step(image, scan)
        if self.divergence is None:
            other = self._other.step(image, scan)
            # the bytes only where the values differ: a NaN differs from itself
            if other != orders and ORDERS_STRUCT.pack(*other) != ORDERS_STRUCT.pack(*orders):
                self.divergence = self._parted(scan, state, orders, other)
        self._steps += 1
        return orders

    def _parted(self, scan: int, state: State, own: Orders, other: Orders) -> Divergence:
        new, gone = other.alarms & ~own.alarms, own.alarms & ~other.alarms
        if new:
            fault = cause_among(new)
            # what a step says beside its fault: which zero was too large, which device was missing
            notes = [event.text for event in self._other.events if (event.scan, event.kind) == (scan, "note")]
            cause = "; ".join([f"{_named(fault)} would have been raised", *notes])
        elif gone:
            fault = cause_among(gone)
            cause = f"{_named(fault)} would not have been raised"
        else:
            fault, cause = None, _differing(own, other)
        return Divergence(self._steps, scan, state.name.lower(), fault.id if fault else "", cause)


def _named(fault: Fault) -> str:
    return f"{fault.id} ({fault.reaction.name.lower()})"


def _differing(own: Orders, other: Orders) -> str:
    pairs = [
        f"{field.name} {_text(field.name, then)} instead of {_text(field.name, was)}{unit}"
        for field, was, then in zip(ORDERS_FIELDS, own, other, strict=True)
        if was != then
        for unit in [f" {field.unit}" if field.unit else ""]
    ]
    return f"the outputs would differ: {', '.join(pairs[:MOST_NAMED])}"


def _text(name: str, value: float) -> str:
    names = NAMES.get(name)
    return names(int(value)).name.lower() if names else f"{value:.6g}"
