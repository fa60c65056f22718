"""Lets faults act on the virtual bench: starts each at its moment, ends it, and notes when it was first seen.

Physics and contacts are changed here. What goes over a wire is changed by whoever sends it, who asks `frame`, `status`,
`device` or the contacts of `Wires`, in process and over real wires alike. `unseen()` names the faults that never had an
effect, so that none does nothing silently.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from drivers.virtual import cia402_tables as tables
from drivers.virtual.drive_axis import DriveAxis
from drivers.virtual.plant import CHANNELS, Plant, Sample
from drivers.virtual.plant_kernel import CH, C, P, S
from drivers.virtual.scenario import Fault, Scenario, When

LOST = -1
"""Fate of a frame that never arrives; others are delays in ns."""
NO_FORCE_NM = 1e-6
NOT_A_NUMBER = float("nan")


@dataclass
class Wires:
    """What the faults leave of the connections and contacts; the servers and the in-process bench look here."""

    cut: set[str] = field(default_factory=set)  # of "amplifier", "brake", "remote_io": connections closed
    estop_released: bool = True
    guard_closed: bool = True
    housing_offset_k: float = 0.0


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
        self.active: dict[tuple[str, str], Fault] = {}
        self._waiting = list(scenario.faults) if scenario is not None else []
        self._started: list[Fault] = []  # until something is different because of them
        self._ends_ns: dict[tuple[str, str], int] = {}
        self._kept: dict[tuple[str, str], float] = {}
        self._since_ns: dict[tuple[str, str], int] = {}
        self._plant = plant
        self._axis = axis
        self._report = report
        self._dice = random.Random(1)  # noqa: S311 - the same frames are lost in every run
        self._controller: tuple[str, int, int] | None = None  # state, scan of its entry, scan now
        self._missed = 0

    def inject(self, faults: Iterable[Fault]) -> None:
        """Add faults to those that wait for their moment."""
        self._waiting += faults

    # --- when

    def tell(self, state: str, scan: int, entered: int | None = None) -> None:
        """Say what state the controller is in after a scan; moments that are keyed by it need this.

        Without `entered` the state was entered in the scan in which it was first told.
        """
        before = self._controller
        if entered is None:
            entered = before[1] if before is not None and before[0] == state else scan
        self._controller = (state, entered, scan)

    def step(self, now_ns: int) -> None:
        """Start the faults that are due and end those whose time is over."""
        if self._ends_ns:
            for key in [key for key, end_ns in self._ends_ns.items() if now_ns >= end_ns]:
                del self._ends_ns[key]
                self._end(self.active.pop(key), now_ns)
        if self._started and ("brake.current", "fade") in self.active and self._plant.brake_current_a > 0.0:
            self.seen("brake.current")
        if not self._waiting:
            return
        torque_nm = abs(float(self._plant.state[S.TORQUE_NM]))
        for fault in [fault for fault in self._waiting if self._is_due(fault.when, torque_nm, now_ns * 1e-9)]:
            self._waiting.remove(fault)
            key = (fault.target, fault.verb)
            self.active[key] = fault
            self._since_ns[key] = now_ns
            if fault.for_ms is not None:
                self._ends_ns[key] = now_ns + round(fault.for_ms * 1e6)
            if self._start(fault, now_ns):
                self._note(fault)
            else:
                self._started.append(fault)

    def _is_due(self, when: When, torque_nm: float, time_s: float) -> bool:
        if when.torque_out_above_nm is not None:
            return torque_nm > when.torque_out_above_nm
        if when.time_s is not None:
            return time_s >= when.time_s
        if self._controller is None:
            return False
        state, entered, scan = self._controller
        if when.scan is not None:
            return scan + 1 >= when.scan
        return state == when.state and scan + 1 - entered >= when.after_scans

    # --- who has seen what

    def seen(self, target: str) -> None:
        """Note that something on `target` was different because of its fault; called by whoever changed it."""
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

    # --- asked by those who send

    def frame(self, target: str) -> int:
        """Return what becomes of a frame: `LOST`, or the delay in ns with which it arrives."""
        if not self.active:
            return 0
        for verb in ("off", "drop", "drop_next", "delay", "duplicate"):
            fault = self.active.get((target, verb))
            if fault is None:
                continue
            value = fault.value or 0.0
            if verb == "drop" and self._dice.random() >= value:
                continue
            if verb == "drop_next" and not self._count_down((target, verb), value):
                continue
            self.seen(target)
            return round(value * 1e6) if verb == "delay" else 0 if verb == "duplicate" else LOST
        return 0

    def status(self, word: int, mode: int, torque: int) -> tuple[int, int, int]:
        """Return status word, mode display and actual torque as the drive's faults leave them."""
        if not self.active:
            return word, mode, torque
        shown = (
            self._word(word),
            self._stuck("drive.mode", mode) if ("drive.mode", "refuse") not in self.active else 0,
            torque if (scale := self.active.get(("drive.torque", "scale"))) is None else round(torque * _value(scale)),
        )
        for target, before, after in zip(
            ("drive.statusword", "drive.mode", "drive.torque"), (word, mode, torque), shown, strict=True
        ):
            if before != after:
                self.seen(target)
                self.seen("drive.internal_limit" if target == "drive.statusword" else target)
        return shown

    def emergency(self, code: int) -> int:
        """Return the code of the last emergency message."""
        storm = self.active.get(("drive.emcy", "storm")) if self.active else None
        if storm is None:
            return code
        self.seen("drive.emcy")
        return round(_value(storm))

    def device(self, name: str) -> tuple[str, float]:
        """Return how a Modbus device misbehaves: verb and value; an empty verb while it is in order."""
        if self.active:
            for verb in ("off", "exception", "silence", "freeze", "slow"):
                fault = self.active.get((f"modbus.{name}", verb))
                if fault is not None:
                    self.seen(fault.target)
                    return verb, fault.value or 0.0
        return "", 0.0

    @property
    def node_is_reset(self) -> bool:
        """Whether the drive has booted and waits in pre-operational."""
        if not self.active or ("can.drive.node", "reset") not in self.active:
            return False
        self.seen("can.drive.node")
        return True

    def take_missed(self) -> int:
        """Return how many periods the next scan has missed; virtual time only."""
        missed, self._missed = self._missed, 0
        if missed:
            self.seen("scan.overrun")
        return missed

    def _word(self, word: int) -> int:
        if ("drive.internal_limit", "raise") in self.active:
            word |= tables.INTERNAL_LIMIT
        return self._stuck("drive.statusword", word)

    def _stuck(self, target: str, now: int) -> int:
        key = (target, "stuck")
        return int(self._kept.setdefault(key, now)) if key in self.active else now

    def _count_down(self, key: tuple[str, str], frames: float) -> bool:
        left = self._kept.get(key, frames)
        self._kept[key] = left - 1
        return left > 0

    # --- physics and contacts

    def _start(self, fault: Fault, now_ns: int) -> bool:
        """Start a fault and return whether that alone is its effect."""
        value, axis = _value(fault), self._axis
        domain, _, part = fault.target.partition(".")
        alone = True
        match domain, fault.verb:
            case "lock" | "brake" | "coupling", _:
                alone = self._start_mechanics(domain, value)
            case "io", _:
                self._start_contact(fault.verb, value, now_ns)
            case "sensor", verb:
                alone = self._disturb(CHANNELS.index(part), verb, value)
            case "scan", _:
                self._missed = round(value)
                alone = False
            case "drive", "drop":
                axis.machine.set_safe_torque_off(active=True, now_ns=now_ns)
            case "drive", "raise" if part == "emcy":
                axis.machine.raise_fault(round(value), now_ns)
            case _:
                alone = False
                if part == "node":
                    axis.machine.network_stopped(now_ns)
                if domain == "modbus" and fault.verb == "off":
                    self.wires.cut.add(part)
        axis.apply()
        return alone

    def _start_contact(self, verb: str, value: float, now_ns: int) -> None:
        if verb == "trip":
            self.wires.estop_released = False
            self._axis.machine.set_safe_torque_off(active=True, now_ns=now_ns)
        elif verb == "open":
            self.wires.guard_closed = False
        else:
            self.wires.housing_offset_k = value

    def _start_mechanics(self, domain: str, value: float) -> bool:
        plant = self._plant
        if domain == "lock":
            self._kept["lock", "slip"] = float(plant.params[P.BRAKE_HOLDS])
            plant.params[P.BRAKE_HOLDS] = value
        elif domain == "brake":
            plant.control[C.BRAKE_CURRENT_A] *= value
            plant.brake_share = value
            return plant.brake_current_a > 0.0
        else:
            plant.table[:] = 0.0
            plant.params[P.DAHL_FORCE_NM] = NO_FORCE_NM
        return True

    def _end(self, fault: Fault, now_ns: int) -> None:
        plant, wires = self._plant, self.wires
        domain, _, part = fault.target.partition(".")
        if domain != "lock":
            self._kept.pop((fault.target, fault.verb), None)
        match domain, fault.verb:
            case "modbus", "off":
                wires.cut.discard(part)
            case "lock", _:
                plant.params[P.BRAKE_HOLDS] = self._kept.pop(("lock", "slip"))
            case "brake", _:
                plant.brake_share = 1.0
            case ("io", "trip") | ("drive", "drop"):
                wires.estop_released = True
                self._axis.machine.set_safe_torque_off(active=False, now_ns=now_ns)
            case "io", "open":
                wires.guard_closed = True
            case "io", _:
                wires.housing_offset_k = 0.0
            case "sensor", _:
                row = plant.channels[CHANNELS.index(part)]
                row[CH.FAULT_OFFSET] = row[CH.STUCK] = 0.0
                plant.overlay = self._overlay if any(t.startswith("sensor.") for t, _ in self.active) else None

    def _disturb(self, channel: int, verb: str, value: float) -> bool:
        row = self._plant.channels[channel]
        if verb == "offset":
            row[CH.FAULT_OFFSET] = value
            return True
        if verb == "stuck":
            row[CH.STUCK_AT] = self._plant.sample()[channel]
            row[CH.STUCK] = 1.0
            return True
        self._plant.overlay = self._overlay
        return False

    def _overlay(self, sample: Sample) -> Sample:
        """Return a sample as the faults of its channels leave it."""
        values = list(sample[: len(CHANNELS)])
        status = sample.status
        for (target, verb), fault in tuple(self.active.items()):
            if not target.startswith("sensor.") or verb in ("offset", "stuck"):
                continue
            channel = CHANNELS.index(target.removeprefix("sensor."))
            before, value = values[channel], _value(fault)
            if verb == "drift":
                values[channel] += value * (self._plant.now_ns - self._since_ns[target, verb]) * 1e-9
            elif verb == "spike" and self._count_down((target, verb), 1.0):
                values[channel] += value
            elif verb == "flip":
                values[channel] = -before
            elif verb == "nan":
                values[channel] = NOT_A_NUMBER
            elif verb == "saturate":
                status |= 1 << channel
            if values[channel] != before or status != sample.status:
                self.seen(target)
        return Sample(values[0], values[1], values[2], values[3], sample.counter, sample.time_us, status)


def _value(fault: Fault) -> float:
    return 0.0 if fault.value is None else fault.value
