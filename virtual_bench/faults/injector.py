"""Lets faults act on the virtual bench: its physics, its contacts, and what its drive shows and obeys.

What goes over a wire is changed by whoever sends it: frames by `frames`, answers of Modbus devices by `modbus_faults`
over real wires and by `device` in process.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from virtual_bench.drive import cia402_tables as tables
from virtual_bench.drive.axis import DriveAxis
from virtual_bench.faults.frame_faults import FrameFaults
from virtual_bench.faults.scenario import Fault, Scenario
from virtual_bench.faults.schedule import LOST, Acted, FaultSchedule
from virtual_bench.faults.sensor_faults import SensorFaults
from virtual_bench.physics.plant import Plant
from virtual_bench.physics.plant_numbers import C, P, S

__all__ = ["LOST", "Acted", "FaultInjector", "Wires"]

NO_FORCE_NM = 1e-6
CLOSED = ("off", "reset")
UNANSWERED = ("silence", "truncate", "wrong_id", "wrong_unit")
"""Faults of a Modbus device after which, in process, there is nothing to believe: over wires the bytes say so."""

FRICTION = (P.FRICTION_LOADING_NM, P.FRICTION_UNLOADING_NM)


@dataclass
class Wires:
    """What the faults leave of the connections and contacts; the servers and the in-process bench look here."""

    cut: set[str] = field(default_factory=set)  # of "amplifier", "brake", "remote_io": connections closed
    estop_released: bool = True
    guard_closed: bool = True
    enabling_device: bool = False
    housing_offset_k: float = 0.0


class FaultInjector(FaultSchedule):
    """The faults of one virtual bench."""

    def __init__(
        self,
        scenario: Scenario | None,
        plant: Plant,
        axis: DriveAxis,
        node_ids: tuple[int, int],
        report: Callable[[Acted], None] | None = None,
    ) -> None:
        """Prepare the faults of a scenario; `node_ids`: of the drive and of its controller."""
        super().__init__(scenario, report)
        self.wires = Wires()
        self.frames = FrameFaults(self, *node_ids)
        self._sensors = SensorFaults(self, plant)
        self._plant = plant
        self._axis = axis
        self._missed = 0

    def _look(self) -> None:
        """Note a brake that faded while it had no current: with a current it is seen."""
        if ("brake.current", "fade") in self.active and self._plant.brake_current_a > 0.0:
            self.seen("brake.current")

    def _torque_nm(self) -> float:
        return abs(float(self._plant.state[S.TORQUE_NM]))

    # --- asked by those who send

    def status(self, word: int, mode: int, torque: int) -> tuple[int, int, int]:
        """Return status word, mode display and actual torque as the drive's faults leave them."""
        if not self.active:
            return word, mode, torque
        scale = self.value("drive.torque", "scale")
        shown = (
            self._word(word, mode),
            self._stuck("drive.mode", mode) if ("drive.mode", "refuse") not in self.active else 0,
            torque if scale is None else round(torque * scale),
        )
        for target, before, after in zip(
            ("drive.statusword", "drive.mode", "drive.torque"), (word, mode, torque), shown, strict=True
        ):
            if before != after:
                self.seen(target)
                self.seen("drive.internal_limit" if target == "drive.statusword" else target)
        return shown

    def _word(self, word: int, mode: int) -> int:
        if ("drive.internal_limit", "raise") in self.active:
            word |= tables.INTERNAL_LIMIT
        cyclic = mode in (tables.Mode.CYCLIC_SYNC_TORQUE, tables.Mode.CYCLIC_SYNC_VELOCITY)
        if ("drive.setpoint", "ignore") in self.active and cyclic:
            word &= ~tables.FOLLOWS_COMMAND
        return self._stuck("drive.statusword", word)

    def _stuck(self, target: str, now: int) -> int:
        key = (target, "stuck")
        return int(self._kept.setdefault(key, now)) if key in self.active else now

    def takes_controlword(self, word: int, before: int) -> bool:
        """Tell whether the drive obeys a control word; `before` is the one that it obeyed last."""
        if self.active and ("drive.controlword", "ignore") in self.active:
            if word != before:
                self.seen("drive.controlword")
            return False
        return True

    def setpoint(self, value: int, before: int) -> int:
        """Return the set-point that the drive takes in place of a torque or velocity that it was sent."""
        if not self.active:
            return value
        if ("drive.setpoint", "ignore") in self.active:
            if value != before:
                self.seen("drive.setpoint")
            return before
        scale = self.value("drive.setpoint", "scale")
        if scale is not None and value:
            self.seen("drive.setpoint")
            return round(value * scale)
        return value

    def emergency(self, code: int) -> int:
        """Return the code of the last emergency message."""
        storm = self.value("drive.emcy", "storm") if self.active else None
        if storm is None:
            return code
        self.seen("drive.emcy")
        return round(storm)

    def device(self, name: str) -> tuple[str, float]:
        """Return how a Modbus device misbehaves in process: verb and value; an empty verb while nothing is wrong."""
        target = f"modbus.{name}"
        if target in self.targets:
            for verb in (*CLOSED, "exception", *UNANSWERED, "freeze", "slow"):
                value = self.value(target, verb)
                if value is not None:
                    self.seen(target)
                    return "off" if verb in CLOSED else "silence" if verb in UNANSWERED else verb, value
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

    # --- physics and contacts

    def _start(self, fault: Fault, now_ns: int) -> bool:
        value, axis = fault.value or 0.0, self._axis
        domain, _, part = fault.target.partition(".")
        alone = True
        match domain, fault.verb:
            case "lock" | "brake" | "coupling" | "unit", _:
                alone = self._start_mechanics(domain, fault.verb, value)
            case "io", _:
                self._start_contact(fault.verb, value, now_ns)
            case "sensor", _:
                alone = self._sensors.start(fault)
            case "scan", _:
                self._missed = round(value)
                alone = False
            case "drive", "drop":
                axis.machine.set_safe_torque_off(active=True, now_ns=now_ns)
            case "drive", "raise" if part == "emcy":
                axis.machine.raise_fault(round(value), now_ns)
            case _:
                alone = False
                if part == "drive.node":
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
        elif verb == "press":
            self.wires.enabling_device = True
        else:
            self.wires.housing_offset_k = value

    def _start_mechanics(self, domain: str, verb: str, value: float) -> bool:
        plant = self._plant
        if domain == "lock":
            self._kept["lock", "slip"] = float(plant.params[P.BRAKE_HOLDS])
            plant.params[P.BRAKE_HOLDS] = value
        elif domain == "brake":
            plant.control[C.BRAKE_CURRENT_A] *= value
            plant.brake_share = value
            return plant.brake_current_a > 0.0
        elif verb == "crack":
            plant.table[plant.table > 0.0] *= value
        elif verb == "jam":
            for place in FRICTION:
                plant.params[place] *= value
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
            case "io", "press":
                wires.enabling_device = False
            case "io", _:
                wires.housing_offset_k = 0.0
            case "sensor", _:
                self._sensors.end(fault)
