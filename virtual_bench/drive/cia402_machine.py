"""The drive's own CiA 402 machine without wires or clock: objects in, status word and demand to the motor out.

Time is an argument in nanoseconds. Numbers are those of the object dictionary (0.1 % of rated torque, position counts,
counts per second), so the machine is the same over a field bus and in process.

A stop ramps the motor down: in torque mode the torque goes to zero on the torque slope, because what is wound up must
unwind under control; in the other modes the speed goes to zero first. The drive never enables itself again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from virtual_bench.drive import cia402_tables as tables
from virtual_bench.drive.cia402_tables import AbortConnection, Mode, PowerCommand, PowerState, Stop
from virtual_bench.drive.controller_watch import ControllerWatch
from virtual_bench.drive.motion import DriveMotion
from virtual_bench.drive.settings import DriveObjects
from virtual_bench.physics.motor_stop import MotorView

# Asked at every step: a member looked up by its class costs twenty times as much.
_HOMING, _NO_MODE = Mode.HOMING, Mode.NONE


class DriveEvent(NamedTuple):
    """Something that the drive did or suffered, for the log."""

    time_ns: int
    kind: str
    code: int
    text: str


class Cia402Machine:
    """The power state machine with its option codes and errors; `motion` is what it makes of the motor."""

    def __init__(self, counts_per_rev: float, on_emcy: Callable[[int, int], None] | None = None) -> None:
        self.objects = DriveObjects()
        self.motion = DriveMotion(self.objects, counts_per_rev)
        self.state = PowerState.SWITCH_ON_DISABLED
        self.motor = MotorView(0, 0, 0, limited=False)
        """What the drive measured at its last step."""
        self.digital_inputs = 0
        """0x60FD, set by whoever knows what is connected to them."""
        self.controlword = 0
        """Control word 0x6040 as last received."""
        self.error_code = 0
        self.error_register = 0
        self.events: list[DriveEvent] = []
        self.history: list[int] = []  # 0x1003, newest first
        self._on_emcy = on_emcy
        self._settled: PowerState | None = None
        self._warning = False
        self._safe_torque_off = False
        self._after_stop = PowerState.SWITCH_ON_DISABLED
        self._watch = ControllerWatch(self.objects, self._controller_back)
        # What only the watch has to know goes there directly: in every scan one call less.
        self.heartbeat = self._watch.heartbeat
        self.setpoint_received = self._watch.setpoint_received
        self.consume_heartbeats_of = self._watch.consume_heartbeats_of
        self.excuse_silence = self._watch.excuse_silence

    # What comes from the network -------------------------------------------------------------------------------

    def write_controlword(self, value: int, now_ns: int) -> None:
        """Take a control word; levels act by `TRANSITIONS`, bits 4 and 7 by their rising edges."""
        if value == self.controlword and self.state is self._settled:
            return  # the usual case: the same word again, in a state that it did not change
        rising = value & ~self.controlword
        before = self.state
        self.controlword = value
        if rising & tables.FAULT_RESET_BIT:
            self._command(PowerCommand.FAULT_RESET, now_ns)
        self._command(tables.decode_command(value), now_ns)
        if value & tables.HALT_BIT and self.state is PowerState.OPERATION_ENABLED:
            self.motion.begin_halt(tables.HALT_OPTIONS[self.objects.halt_option], self.motor, now_ns)
        else:
            self.motion.end_halt()
        homing = rising & tables.START_HOMING_BIT and self.motion.mode_display is Mode.HOMING
        if homing and not self.motion.home(self.motor):
            self._event(now_ns, "homing_error", 0, "homing refused: the motor moves or the method is not there")
        self._settled = self.state if self.state is before else None

    def network_stopped(self, now_ns: int) -> None:
        """Note that the node left the NMT state operational: set-points end, which a moving motor must not survive."""
        self._watch.setpoints_ended()
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
            faulty = self.state in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)
            self._enter(PowerState.FAULT if faulty else PowerState.SWITCH_ON_DISABLED, now_ns)

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

    def step(self, now_ns: int, motor: MotorView) -> None:
        """Look at the motor and at the time: supervise the controller, carry ramps on."""
        self.motor = motor
        for code, text in self._watch.losses(now_ns):
            self._controller_lost(code, text, now_ns)
        if self.motion.ramp is not None:
            self._carry_on(now_ns)

    # What the network reads ------------------------------------------------------------------------------------

    @property
    def statusword(self) -> int:
        """Status word 0x6041."""
        word = tables.STATUS_BITS[self.state] | tables.REMOTE
        if not self._safe_torque_off:
            word |= tables.VOLTAGE_ENABLED
        if self._warning:
            word |= tables.WARNING
        if self.motor.limited:
            word |= tables.INTERNAL_LIMIT
        motion = self.motion
        if motion.mode_display is _HOMING:
            if motion.homing_attained:
                word |= tables.HOMING_ATTAINED | tables.TARGET_REACHED
            if motion.homing_error:
                word |= tables.HOMING_ERROR
        elif motion.following and motion.mode_display is not _NO_MODE:
            word |= tables.FOLLOWS_COMMAND
        return word

    @property
    def position_counts(self) -> int:
        """Actual position 0x6064, from the home position."""
        return self.motor.position_counts - self.motion.home_counts

    # How it works ----------------------------------------------------------------------------------------------

    def _command(self, command: PowerCommand, now_ns: int) -> None:
        """Make the transition that the table has for this command; a stop under way yields to power off only."""
        after = tables.TRANSITIONS.get((self.state, command))
        if after is None or (self._safe_torque_off and after is not PowerState.SWITCH_ON_DISABLED):
            return
        if self.motion.stop is not None and command is not PowerCommand.DISABLE_VOLTAGE:
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

    def _controller_back(self, now_ns: int) -> None:
        if self._warning:
            self._warning = False
            if self.state is not PowerState.FAULT:
                self._emcy(0, now_ns)

    def _stop_then(self, stop: Stop, after: PowerState, now_ns: int) -> None:
        """Stop the motor, then enter `after`."""
        if stop is Stop.COAST:
            self._enter(after, now_ns)
            return
        self.motion.begin_stop(stop, self.motor, now_ns)
        self._after_stop = after

    def _carry_on(self, now_ns: int) -> None:
        stopped = self.motion.carry_on(self.motor, now_ns)
        overdue = self.motion.stop is not None and self.motion.stop.overdue(now_ns)
        if overdue:
            self._event(now_ns, "stop_cut", 0, "the stop did not end in time: power off")
        if stopped or overdue:
            self._enter(self._after_stop, now_ns)

    def _enter(self, state: PowerState, now_ns: int) -> None:
        if state is not self.state:
            self._event(now_ns, "drive_state", self.error_code, f"{self.state.text} -> {state.text}")
        self.state = state
        energized = state in tables.ENERGIZED and not self._safe_torque_off
        self.motion.enter(energized=energized, enabled=state is PowerState.OPERATION_ENABLED)

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
