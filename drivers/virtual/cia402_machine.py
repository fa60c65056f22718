"""The drive's own CiA 402 machine without wires or clock: objects in, status word and demand to the motor out.

Time is an argument in nanoseconds. Numbers are those of the object dictionary (0.1 % of rated torque, position counts,
counts per second), so the machine is the same over a field bus and in process.

A stop ramps the motor down: in torque mode the torque goes to zero on the torque slope, because what is wound up must
unwind under control; in the other modes the speed goes to zero first. The drive never enables itself again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from drivers.virtual import cia402_tables as tables
from drivers.virtual.cia402_tables import AbortConnection, Mode, PowerCommand, PowerState, Stop
from drivers.virtual.motor_stop import MOTOR_OFF, NO_TORQUE, STANDSTILL, MotorStop, MotorView, demand_of
from drivers.virtual.plant_kernel import DriveLoop

HOMING_STANDSTILL_FRACTION = 0.02  # of a turn per second: faster than this the reference is refused

# Asked at every step: a member looked up by its class costs twenty times as much.
_HOMING, _TORQUE, _VELOCITY, _NO_MODE = Mode.HOMING, Mode.CYCLIC_SYNC_TORQUE, Mode.CYCLIC_SYNC_VELOCITY, Mode.NONE
_TORQUE_LOOP, _VELOCITY_LOOP = DriveLoop.TORQUE, DriveLoop.VELOCITY
_ENABLED = PowerState.OPERATION_ENABLED


@dataclass
class DriveObjects:
    """Objects that set the drive up, as after power-on: a vendor's defaults, which protect nothing."""

    max_torque_permille: int = 3000  # 0x6072
    max_speed_rpm: int = 6000  # 0x6080
    torque_slope_permille_s: int = 1_000_000  # 0x6087
    slow_down_counts_s2: int = 10_485_760  # 0x6084
    quick_stop_counts_s2: int = 104_857_600  # 0x6085
    home_offset_counts: int = 0  # 0x607C
    homing_method: int = 37  # 0x6098
    abort_connection: int = AbortConnection.FAULT  # 0x6007
    quick_stop_option: int = 2  # 0x605A
    shutdown_option: int = 0  # 0x605B
    disable_option: int = 1  # 0x605C
    halt_option: int = 1  # 0x605D
    fault_reaction_option: int = 2  # 0x605E
    setpoint_timeout_ms: int = 0  # 0x1400:5


class DriveEvent(NamedTuple):
    """Something that the drive did or suffered, for the log."""

    time_ns: int
    kind: str
    code: int
    text: str


class Cia402Machine:
    """The power state machine with its modes, option codes and supervision of the controller."""

    def __init__(self, counts_per_rev: float, on_emcy: Callable[[int, int], None] | None = None) -> None:
        self.objects = DriveObjects()
        self.state = PowerState.SWITCH_ON_DISABLED
        self.mode_display = Mode.NONE
        self.demand = MOTOR_OFF
        self.error_code = 0
        self.error_register = 0
        self.events: list[DriveEvent] = []
        self.history: list[int] = []  # 0x1003, newest first
        self._on_emcy = on_emcy
        self._counts_per_rev = counts_per_rev
        self._motor = MotorView(0, 0, 0, limited=False)
        self._home_counts = 0
        self._controlword = 0
        self._settled: PowerState | None = None
        self._mode = 0
        self._target_torque = 0
        self._target_velocity = 0
        self._homing_attained = False
        self._homing_error = False
        self._warning = False
        self._safe_torque_off = False
        self._stop: MotorStop | None = None
        self._after_stop = PowerState.SWITCH_ON_DISABLED
        self._halt: MotorStop | None = None
        self._consumers: dict[int, tuple[int, int | None]] = {}  # node -> time-out, last heard; None: not yet
        self._setpoint_ns: int | None = None

    # What comes from the network -------------------------------------------------------------------------------

    def write_controlword(self, value: int, now_ns: int) -> None:
        """Take a control word; levels act by `TRANSITIONS`, bits 4 and 7 by their rising edges."""
        if value == self._controlword and self.state is self._settled:
            return  # the usual case: the same word again, in a state that it did not change
        rising = value & ~self._controlword
        before = self.state
        self._controlword = value
        if rising & tables.FAULT_RESET_BIT:
            self._command(PowerCommand.FAULT_RESET, now_ns)
        self._command(tables.decode_command(value), now_ns)
        halted = bool(value & tables.HALT_BIT) and self.state is PowerState.OPERATION_ENABLED
        if not halted:
            self._halt = None
        elif self._halt is None:
            self._halt = self._begin(tables.HALT_OPTIONS[self.objects.halt_option], now_ns)
        if rising & tables.START_HOMING_BIT and self.mode_display is Mode.HOMING:
            self._home(now_ns)
        self._settled = self.state if self.state is before else None
        self._update_demand()

    def write_mode(self, value: int) -> None:
        """Take a mode of operation; one that the drive does not have leaves the display as it was."""
        if value == self._mode:
            return
        self._mode = value
        if value in Mode.__members__.values():
            self.mode_display = Mode(value)
            self._homing_attained = self._homing_error = False
            self._update_demand()

    def write_target_torque(self, permille: int) -> None:
        """Take a target torque in 0.1 % of rated torque."""
        if permille != self._target_torque:
            self._target_torque = permille
            self._update_demand()

    def write_target_velocity(self, counts_s: int) -> None:
        """Take a target velocity."""
        if counts_s != self._target_velocity:
            self._target_velocity = counts_s
            self._update_demand()

    def consume_heartbeats_of(self, node_id: int, timeout_ms: int) -> None:
        """Supervise a node's heartbeat (0x1016); 0 ms ends it. Supervision starts with the first heartbeat."""
        if timeout_ms:
            self._consumers[node_id] = (timeout_ms, None)
        else:
            self._consumers.pop(node_id, None)

    def heartbeat(self, node_id: int, now_ns: int) -> None:
        """Note a heartbeat of another node."""
        if node_id not in self._consumers:
            return
        timeout_ms, heard = self._consumers[node_id]
        self._consumers[node_id] = (timeout_ms, now_ns)
        if heard is None and self._warning:
            self._warning = False
            if self.state is not PowerState.FAULT:
                self._emcy(0, now_ns)

    def setpoint_received(self, now_ns: int) -> None:
        """Note that the supervised receive PDO arrived."""
        self._setpoint_ns = now_ns

    def excuse_silence(self, standstill_ns: int) -> None:
        """Let time pass in which nobody could be heard: time-outs of set-points and heartbeats end so much later."""
        if self._setpoint_ns is not None:
            self._setpoint_ns += standstill_ns
        for node_id, (timeout_ms, heard_ns) in self._consumers.items():
            if heard_ns is not None:
                self._consumers[node_id] = (timeout_ms, heard_ns + standstill_ns)

    def network_stopped(self, now_ns: int) -> None:
        """Note that the node left the NMT state operational: set-points end, which a moving motor must not survive."""
        self._setpoint_ns = None
        if self.state in tables.ENERGIZED:
            self._controller_lost(tables.COMMUNICATION_LOST, "NMT state operational left while enabled", now_ns)

    # What comes from the machine itself ------------------------------------------------------------------------

    def set_safe_torque_off(self, *, active: bool, now_ns: int) -> None:
        """Cut the torque in hardware (STO), as the emergency stop chain does."""
        if active == self._safe_torque_off:
            return
        self._safe_torque_off = active
        self._settled = None
        if active:
            self._event(now_ns, "safe_torque_off", 0, "emergency stop: torque switched off by STO")
            if self.state not in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE):
                self._enter(PowerState.SWITCH_ON_DISABLED, now_ns)
            else:
                self._enter(PowerState.FAULT, now_ns)

    def raise_fault(self, code: int, now_ns: int) -> None:
        """Go to fault with an error code: EMCY, the reaction of 0x605E, then the state fault (transitions 13, 14)."""
        self._emcy(code, now_ns)
        if self.state in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE):
            return
        stop = tables.FAULT_REACTION_OPTIONS[self.objects.fault_reaction_option]
        if self.state in tables.ENERGIZED and stop is not Stop.COAST:
            self._enter(PowerState.FAULT_REACTION_ACTIVE, now_ns)
            self._stop_then(stop, PowerState.FAULT, now_ns)
        else:
            self._enter(PowerState.FAULT, now_ns)
        self._update_demand()

    def step(self, now_ns: int, motor: MotorView) -> None:
        """Look at the motor and at the time: supervise the controller, carry ramps on."""
        self._motor = motor
        for node_id, (timeout_ms, heard_ns) in self._consumers.items():
            if heard_ns is not None and now_ns - heard_ns > timeout_ms * 1_000_000:
                self._consumers[node_id] = (timeout_ms, None)
                text = f"heartbeat of node {node_id} missing for {timeout_ms} ms (0x1016)"
                self._controller_lost(tables.HEARTBEAT_LOST, text, now_ns)
                break
        timeout_ms = self.objects.setpoint_timeout_ms
        if timeout_ms and self._setpoint_ns is not None and now_ns - self._setpoint_ns > timeout_ms * 1_000_000:
            self._setpoint_ns = None
            text = f"no set-point for {timeout_ms} ms (0x1400:5)"
            self._controller_lost(tables.SETPOINT_TIMEOUT, text, now_ns)
        if self._halt is not None:
            self._halt.carry_on(motor, now_ns)
            self._update_demand()
        if self._stop is not None:
            overdue = self._stop.overdue(now_ns)
            if overdue:
                self._event(now_ns, "stop_cut", 0, "the stop did not end in time: power off")
            if overdue or self._stop.carry_on(motor, now_ns):
                self._enter(self._after_stop, now_ns)
            self._update_demand()

    # What the network reads ------------------------------------------------------------------------------------

    @property
    def statusword(self) -> int:
        """Status word 0x6041."""
        word = tables.STATUS_BITS[self.state] | tables.REMOTE
        if not self._safe_torque_off:
            word |= tables.VOLTAGE_ENABLED
        if self._warning:
            word |= tables.WARNING
        if self._motor.limited:
            word |= tables.INTERNAL_LIMIT
        if self.mode_display is _HOMING:
            if self._homing_attained:
                word |= tables.HOMING_ATTAINED | tables.TARGET_REACHED
            if self._homing_error:
                word |= tables.HOMING_ERROR
        elif self._following and self.mode_display is not _NO_MODE:
            word |= tables.FOLLOWS_COMMAND
        return word

    @property
    def controlword(self) -> int:
        """Control word 0x6040 as last received."""
        return self._controlword

    @property
    def mode(self) -> int:
        """Mode of operation 0x6060 as last received."""
        return self._mode

    @property
    def target_torque(self) -> int:
        """Target torque 0x6071 as last received."""
        return self._target_torque

    @property
    def target_velocity(self) -> int:
        """Target velocity 0x60FF as last received."""
        return self._target_velocity

    @property
    def motor(self) -> MotorView:
        """What the drive measured at its last step."""
        return self._motor

    @property
    def position_counts(self) -> int:
        """Actual position 0x6064, from the home position."""
        return self._motor.position_counts - self._home_counts

    # How it works ----------------------------------------------------------------------------------------------

    def _command(self, command: PowerCommand, now_ns: int) -> None:
        """Make the transition that the table has for this command; a stop under way yields to power off only."""
        after = tables.TRANSITIONS.get((self.state, command))
        if after is None or (self._safe_torque_off and after is not PowerState.SWITCH_ON_DISABLED):
            return
        if self._stop is not None and command is not PowerCommand.DISABLE_VOLTAGE:
            return
        if self.state is PowerState.OPERATION_ENABLED:
            self._leave_operation(command, after, now_ns)
        elif self.state is PowerState.QUICK_STOP_ACTIVE and after is PowerState.OPERATION_ENABLED:
            _, stays = tables.QUICK_STOP_OPTIONS[self.objects.quick_stop_option]
            if stays:
                self._enter(after, now_ns)
        else:
            if command is PowerCommand.FAULT_RESET:
                self._warning = False
                self._emcy(0, now_ns)
            self._enter(after, now_ns)

    def _leave_operation(self, command: PowerCommand, after: PowerState, now_ns: int) -> None:
        if command is PowerCommand.QUICK_STOP:
            self._quick_stop(now_ns)
        elif command is PowerCommand.SHUTDOWN:
            self._stop_then(tables.SHUTDOWN_OPTIONS[self.objects.shutdown_option], after, now_ns)
        elif command is PowerCommand.SWITCH_ON:
            self._stop_then(tables.DISABLE_OPTIONS[self.objects.disable_option], after, now_ns)
        else:
            self._enter(after, now_ns)

    def _quick_stop(self, now_ns: int) -> None:
        stop, stays = tables.QUICK_STOP_OPTIONS[self.objects.quick_stop_option]
        self._event(now_ns, "quick_stop", 0, f"quick stop: {stop.value}")
        if stop is Stop.COAST:
            self._enter(PowerState.SWITCH_ON_DISABLED, now_ns)
            return
        self._enter(PowerState.QUICK_STOP_ACTIVE, now_ns)
        self._stop_then(stop, PowerState.QUICK_STOP_ACTIVE if stays else PowerState.SWITCH_ON_DISABLED, now_ns)

    def _controller_lost(self, code: int, text: str, now_ns: int) -> None:
        option = AbortConnection(self.objects.abort_connection)
        energized = self.state in tables.ENERGIZED
        reaction = option.name.lower().replace("_", " ") if energized else "the motor is off already"
        self._event(now_ns, "controller_lost", code, f"{text}; abort connection option 0x6007 = {option}: {reaction}")
        if not energized or option is AbortConnection.NOTHING:
            self._warning = True
            self._emcy(code, now_ns)
        elif option is AbortConnection.FAULT:
            self.raise_fault(code, now_ns)
        else:
            self._warning = True
            self._emcy(code, now_ns)
            if option is AbortConnection.DISABLE_VOLTAGE:
                self._enter(PowerState.SWITCH_ON_DISABLED, now_ns)
            elif self.state is PowerState.OPERATION_ENABLED:
                self._quick_stop(now_ns)
        self._update_demand()

    def _home(self, now_ns: int) -> None:
        self._homing_attained = self._homing_error = False
        if self.state is not PowerState.OPERATION_ENABLED:
            return
        moving = abs(self._motor.velocity_counts_s) > HOMING_STANDSTILL_FRACTION * self._counts_per_rev
        if moving or self.objects.homing_method not in tables.HOMING_METHODS:
            self._homing_error = True
            self._event(now_ns, "homing_error", 0, "homing refused: the motor moves or the method is not there")
            return
        self._home_counts = self._motor.position_counts - self.objects.home_offset_counts
        self._homing_attained = True

    def _begin(self, stop: Stop, now_ns: int) -> MotorStop:
        if self.mode_display not in (Mode.CYCLIC_SYNC_VELOCITY, Mode.HOMING):
            return MotorStop.of_torque(self._motor, now_ns)
        objects = self.objects
        ramp = objects.quick_stop_counts_s2 if stop is Stop.QUICK_RAMP else objects.slow_down_counts_s2
        return MotorStop(self._motor, ramp, self._counts_per_rev, now_ns)

    def _stop_then(self, stop: Stop, after: PowerState, now_ns: int) -> None:
        """Stop the motor, then enter `after`."""
        if stop is Stop.COAST:
            self._enter(after, now_ns)
            return
        self._stop = self._begin(stop, now_ns)
        self._after_stop = after

    def _enter(self, state: PowerState, now_ns: int) -> None:
        if state is not self.state:
            self._event(now_ns, "drive_state", self.error_code, f"{self.state.text} -> {state.text}")
        self.state = state
        self._stop = None
        if state is not PowerState.OPERATION_ENABLED:
            self._halt = None
        self._update_demand()

    @property
    def _following(self) -> bool:
        return self.state is _ENABLED and self._stop is None and self._halt is None

    def _update_demand(self) -> None:
        if self.state not in tables.ENERGIZED or self._safe_torque_off:
            self.demand = MOTOR_OFF
        elif (stop := self._stop or self._halt) is not None:
            self.demand = stop.demand
        elif self.mode_display in (_TORQUE, _NO_MODE):
            following = self._following and self.mode_display is _TORQUE
            self.demand = demand_of((_TORQUE_LOOP, self._target_torque, 0.0)) if following else NO_TORQUE
        elif self._following and self.mode_display is _VELOCITY:
            self.demand = demand_of((_VELOCITY_LOOP, 0, float(self._target_velocity)))
        else:
            self.demand = STANDSTILL

    def _emcy(self, code: int, now_ns: int) -> None:
        self.error_code = code
        self.error_register = tables.error_register(code)
        if code:
            self.history.insert(0, code)
            del self.history[8:]
        self._event(now_ns, "emcy", code, f"EMCY {code:04X}" if code else "EMCY 0000: error gone")
        if self._on_emcy is not None:
            self._on_emcy(code, self.error_register)

    def _event(self, now_ns: int, kind: str, code: int, text: str) -> None:
        self.events.append(DriveEvent(now_ns, kind, code, text))
