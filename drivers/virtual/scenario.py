"""Faults to inject into the virtual bench: the file's model and the engine that lets them act.

A scenario names faults by target and verb, each with the moment at which it starts. Every fault reports when its
effect was first seen; `unseen()` names those that never had one, so that no fault does nothing silently.

    scenario: {name: heartbeat lost}
    faults:
      - {target: can.drive.heartbeat, verb: off, when: {torque_out_above_nm: 200}}
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from pydantic import BaseModel, ConfigDict, model_validator

from drivers.virtual.drive_axis import DriveAxis
from drivers.virtual.plant import CHANNELS, Plant
from drivers.virtual.plant_kernel import CH, P, S

NEEDS_NO_VALUE = ""

FAULTS: dict[tuple[str, str], str] = {
    # target, verb -> meaning of `value`, empty where there is none
    ("can.drive.heartbeat", "off"): NEEDS_NO_VALUE,
    ("can.drive.tpdo1", "off"): NEEDS_NO_VALUE,
    ("modbus.amplifier", "off"): NEEDS_NO_VALUE,
    ("modbus.brake", "off"): NEEDS_NO_VALUE,
    ("modbus.remote_io", "off"): NEEDS_NO_VALUE,
    ("lock", "slip"): "share of the brake's torque that is left, 0 to 1",
    ("io.estop", "trip"): NEEDS_NO_VALUE,
    ("io.guard", "open"): NEEDS_NO_VALUE,
    ("sensor.torque_in", "stuck"): NEEDS_NO_VALUE,
    ("sensor.torque_out", "stuck"): NEEDS_NO_VALUE,
    ("sensor.torque_in", "offset"): "N·m added to the signal",
    ("sensor.torque_out", "offset"): "N·m added to the signal",
    ("drive.emcy", "raise"): "error code, 1 to 0xFFFF",
}
VALUE_RANGE: dict[tuple[str, str], tuple[float, float]] = {
    ("lock", "slip"): (0.0, 1.0),
    ("drive.emcy", "raise"): (1, 0xFFFF),
}


class Strict(BaseModel):
    """Base of the file's models: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class When(Strict):
    """Moment at which a fault starts; exactly one of the two."""

    torque_out_above_nm: float | None = None  # of the magnitude of the torque in the reducer
    time_s: float | None = None  # since the bench was started

    @model_validator(mode="after")
    def _one_condition(self) -> Self:
        if (self.torque_out_above_nm is None) == (self.time_s is None):
            raise ValueError("give exactly one of torque_out_above_nm and time_s")
        return self


class Fault(Strict):
    """One fault: what, how, by how much, when."""

    target: str
    verb: str
    value: float | None = None
    when: When

    @model_validator(mode="after")
    def _known(self) -> Self:
        key = (self.target, self.verb)
        if key not in FAULTS:
            verbs = sorted(verb for target, verb in FAULTS if target == self.target)
            if verbs:
                raise ValueError(f"found verb {self.verb!r} for {self.target}, allowed {', '.join(verbs)}")
            targets = ", ".join(sorted({target for target, _ in FAULTS}))
            raise ValueError(f"found target {self.target!r}, allowed {targets}")
        if bool(FAULTS[key]) != (self.value is not None):
            needed = f"needs value: {FAULTS[key]}" if FAULTS[key] else "takes no value"
            raise ValueError(f"{self.target} {self.verb} {needed}")
        low, high = VALUE_RANGE.get(key, (float("-inf"), float("inf")))
        if self.value is not None and not low <= self.value <= high:
            raise ValueError(f"{self.target} {self.verb}: found value {self.value:g}, allowed {low:g} to {high:g}")
        return self


class Header(Strict):
    """Name of the scenario."""

    name: str
    description: str = ""


class Scenario(Strict):
    """A scenario file."""

    scenario: Header
    faults: tuple[Fault, ...]


@dataclass
class Wires:
    """What the faults leave of the connections and contacts; the servers and the in-process bench look here."""

    heartbeat: bool = True
    tpdo1: bool = True
    cut: set[str] = field(default_factory=set)  # of "amplifier", "brake", "remote_io"
    estop_released: bool = True
    guard_closed: bool = True


@dataclass(frozen=True)
class Acted:
    """Report of a fault that has acted."""

    fault: Fault
    at_s: float


class FaultInjector:
    """Starts each fault at its moment and notes when its effect was first seen."""

    def __init__(
        self, scenario: Scenario | None, plant: Plant, axis: DriveAxis, report: Callable[[Acted], None] | None = None
    ) -> None:
        self.wires = Wires()
        self.acted: list[Acted] = []
        self._waiting = list(scenario.faults) if scenario is not None else []
        self._started: list[Fault] = []  # faults on wires, until something is missing because of them
        self._plant = plant
        self._axis = axis
        self._report = report

    def step(self, now_ns: int) -> None:
        """Start the faults that are due."""
        if not self._waiting:
            return
        torque_nm = abs(float(self._plant.state[S.TORQUE_NM]))
        time_s = now_ns * 1e-9
        due = [fault for fault in self._waiting if _is_due(fault.when, torque_nm, time_s)]
        for fault in due:
            self._waiting.remove(fault)
            if self._start(fault, now_ns):
                self._note(fault)
            else:
                self._started.append(fault)

    def seen(self, target: str) -> None:
        """Note that something on `target` was withheld because of its fault; called by who withholds it."""
        for fault in [fault for fault in self._started if fault.target == target]:
            self._started.remove(fault)
            self._note(fault)

    def unseen(self) -> list[Fault]:
        """Return the faults that have had no effect: not due, or never on the way of anything."""
        return [*self._waiting, *self._started]

    def _note(self, fault: Fault) -> None:
        acted = Acted(fault, self._plant.now_ns * 1e-9)
        self.acted.append(acted)
        if self._report is not None:
            self._report(acted)

    def _start(self, fault: Fault, now_ns: int) -> bool:
        """Start a fault and return whether that alone is its effect."""
        value = 0.0 if fault.value is None else fault.value
        domain, _, part = fault.target.partition(".")
        match domain, fault.verb:
            case "can", _:
                setattr(self.wires, part.removeprefix("drive."), False)
                return False
            case "modbus", _:
                self.wires.cut.add(part)
                return False
            case "lock", _:
                self._plant.params[P.BRAKE_HOLDS] = value
            case "io", "trip":
                self.wires.estop_released = False
                self._axis.machine.set_safe_torque_off(active=True, now_ns=now_ns)
                self._axis.apply()
            case "io", _:
                self.wires.guard_closed = False
            case "sensor", verb:
                self._disturb(CHANNELS.index(part), verb, value)
            case "drive", _:
                self._axis.machine.raise_fault(int(value), now_ns)
                self._axis.apply()
        return True

    def _disturb(self, channel: int, verb: str, value: float) -> None:
        row = self._plant.channels[channel]
        if verb == "offset":
            row[CH.FAULT_OFFSET] = value
        else:
            row[CH.STUCK_AT] = self._plant.sample()[channel]
            row[CH.STUCK] = 1.0


def _is_due(when: When, torque_nm: float, time_s: float) -> bool:
    if when.torque_out_above_nm is not None:
        return torque_nm > when.torque_out_above_nm
    return when.time_s is not None and time_s >= when.time_s
