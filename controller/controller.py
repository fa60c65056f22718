"""The controller: one step per scan, a pure function of the program and of every image that came before.

    orders = controller.step(image, scan)

Order of a step: measure, interlocks, trip or command, the step of the state that is on, at most one trigger, orders.
A trip and its orders belong to the same scan as the detection.
"""

from __future__ import annotations

from collections.abc import Callable

from controller.aftermath import FaultReaction, Release, Rest
from controller.context import RUNNING, Context, Event, Outcome
from controller.held_lock import Left
from controller.interlocks import Watch
from controller.jog import Jog
from controller.loading import Loading
from controller.preparation import CloseLock, Home, Readiness
from controller.states import TRANSITIONS, Sequence
from definitions.faults import FAULT_BY_ID, FAULT_BY_NUMBER, cause_among
from definitions.image import Command, Image, Orders, Reaction, State, taker
from definitions.program import Program
from definitions.states import LOADED, OVER

_STOPPABLE = frozenset(row.source for row in TRANSITIONS if row.trigger == "stop")
_LOADING_STATES = LOADED | {State.UNLOAD}
# Asked in every scan: a member looked up by its class costs twenty times as much.
_FAULT, _HOLD, _UNLOAD = State.FAULT, Reaction.HOLD, Reaction.UNLOAD
_orders_of = taker()


class _OrdersDraft:
    """The orders of a scan in the making: one attribute for each field of `Orders`."""

    __slots__ = Orders._fields

    def fill(self, context: Context, state: State, reaction: int, watch: Watch, first_out: int) -> None:
        """Take what the scan has led to; `reaction` is the one in force, `first_out` the fault it began with."""
        segment = context.segment
        self.drive_command = context.drive_command
        self.drive_mode = context.drive_mode
        self.drive_target_torque_nm = context.drive_torque_nm
        self.drive_target_velocity_rad_s = context.drive_velocity_rad_s
        self.brake_on = context.brake_on
        self.brake_current_a = context.brake_current_a
        self.state = state
        self.phase = context.phase
        self.segment = segment.index
        self.cycle = segment.cycle
        self.reaction = reaction
        self.fault = first_out
        self.alarms = watch.latched
        self.reference_torque_nm = context.reference_nm
        self.controlled_torque_nm = context.measured.controlled_nm
        self.torque_in_tare_nm = context.torque_in_tare_nm
        self.torque_out_tare_nm = context.torque_out_tare_nm
        self.angle_in_zero_rad = context.angle_in_zero_rad
        self.angle_out_zero_rad = context.angle_out_zero_rad


class Controller:
    """Runs a program. `events` collects what happened; whoever calls `step` takes them out.

    `watch` may be given to look over the interlocks' shoulder; it must decide as `Watch(program)` does. With `left` it
    runs nothing: at the start it takes up the fault in which an earlier run left the bench, and waits there for the
    recovery (acknowledge, reset) or for a stop, which leaves everything as it is.
    """

    def __init__(self, program: Program, watch: Watch | None = None, left: Left | None = None) -> None:
        self.program = program
        self.events: list[Event] = []
        self.first_out = 0
        self._context = Context(program)
        self._sequence = Sequence()
        self._watch = Watch(program) if watch is None else watch
        self._readiness = Readiness(self._context)
        self._home = Home(self._context)
        self._close_lock = CloseLock(self._context)
        self._loading = Loading(self._context)
        self._release = Release(self._context)
        self._rest = Rest(self._context)
        self._fault = FaultReaction(self._context)
        self._jog = Jog(self._context)
        self._scan_by_state: dict[State, Callable[[Image, int], Outcome]] = {
            State.IDLE: self._scan_idle,
            State.HOME: self._home.scan,
            State.LOCK: self._scan_lock,
            **dict.fromkeys(_LOADING_STATES, self._loading.scan),
            State.RELEASE: self._release.scan,
            State.COMPLETE: self._rest.scan,
            State.STOPPED: self._scan_end,
            State.JOG: self._jog.scan,
        }
        self._draft = _OrdersDraft()
        self._left = left
        self._waits_for_person = left is not None
        self._start_pending = False
        self._logged = 0
        self._last_scan = -1
        self._in_state = 0

    @property
    def state(self) -> State:
        """State after the last step."""
        return self._sequence.state

    @property
    def finished(self) -> bool:
        """True when the run is over and its tail recorded: complete, stopped, or a fault whose reaction has ended."""
        state = self._sequence.state
        if state == State.COMPLETE:
            return self._context.phase == Rest.DONE
        if state == State.STOPPED:
            return self._in_state >= self.program.settle_scans
        settled = state == _FAULT and self._context.phase == FaultReaction.SETTLED
        return settled and not self._waits_for_person

    def step(self, image: Image, scan: int) -> Orders:
        """Decide one scan. `scan` is the scan number, which jumps over missed periods; never raises on any image."""
        context, sequence = self._context, self._sequence
        elapsed = scan - self._last_scan
        self._last_scan = scan
        self._in_state += elapsed
        context.measure(image)
        state = sequence.state
        strongest = self._watch.look(image, context.measured, state)
        if state == _FAULT:
            if self._watch.latched & ~self._logged:
                self._fault.another_cause()
            self._log_alarms(scan)
            self._fault.escalate(Reaction(strongest), image)
            self._command_in_fault(image.command)
            outcome = self._fault.scan(image, elapsed, self._watch.active)
            if outcome.trigger:
                self._leave_fault(image, scan)
        elif strongest and strongest >= _UNLOAD:
            self._trip(self._watch.active, Reaction(strongest), image, scan)
        else:
            if self._watch.active:
                self._log_alarms(scan)
            context.hold = strongest != 0 and strongest == _HOLD
            ordered = self._command(image.command, scan) if image.command else None
            outcome = ordered or self._scan_by_state[state](image, elapsed)
            if outcome is not RUNNING:
                self._follow(outcome, image, scan)
        if context.notes:
            self._take_notes(scan)
        return self._orders(strongest)

    def _follow(self, outcome: Outcome, image: Image, scan: int) -> None:
        """Do what a step has ended with."""
        if outcome.fault:
            number = FAULT_BY_ID[outcome.fault].number
            self._trip(1 << number, FAULT_BY_NUMBER[number].reaction, image, scan)
        elif outcome.trigger == "closed":
            self._loading.begin(self._first_segment(State.LOCK))
        elif outcome.trigger:
            self._move(outcome.trigger, image, scan)

    # --- the state that is on

    def _scan_idle(self, image: Image, elapsed: int) -> Outcome:
        context, left = self._context, self._left
        outcome = self._readiness.scan(image, elapsed) if self._start_pending else RUNNING
        if outcome.trigger and left is not None:
            zeroes = left.torque_in_tare_nm, left.torque_out_tare_nm
            context.take_up(image, *zeroes, zeroes_known=left.zeroes_known)
            return Outcome(fault=FAULT_BY_NUMBER[left.fault].id)
        if outcome.fault:
            self._waits_for_person = False  # there is nothing to go back to
        return Outcome(trigger="jog") if outcome.trigger and self.program.jog is not None else outcome

    def _scan_lock(self, image: Image, elapsed: int) -> Outcome:
        closing = self._context.phase in (CloseLock.CLOSE, CloseLock.SETTLE)
        return self._close_lock.scan(image, elapsed) if closing else self._loading.scan(image, elapsed)

    @staticmethod
    def _scan_end(_image: Image, _elapsed: int) -> Outcome:
        return RUNNING

    def _command(self, command: int, scan: int) -> Outcome | None:
        state = self._sequence.state
        if command == Command.START and state == State.IDLE:
            self._start_pending = True
            self._readiness.enter()
            self.events.append(Event(scan, "note", state.name.lower(), "start ordered"))
        elif command == Command.RESET and state in OVER:
            return Outcome(trigger="rearm")
        elif command == Command.STOP:
            self._context.stopping = True
            self._start_pending = False
            if state in _STOPPABLE:
                self.events.append(Event(scan, "note", state.name.lower(), "stop ordered"))
                return Outcome(trigger="stop")
        return None

    def _command_in_fault(self, command: int) -> None:
        if command == Command.ACKNOWLEDGE:
            self._fault.acknowledged = True
            self._context.notes.append("fault acknowledged")
        elif command == Command.RESET:
            refused = self._fault.request_reset()
            if refused:
                self._context.notes.append(refused)
        elif command == Command.STOP:
            self._waits_for_person = False

    # --- moving

    def _move(self, trigger: str, image: Image, scan: int) -> None:
        before = self._sequence.state
        self._sequence.fire(trigger)
        state = self._sequence.state
        self._in_state = 0
        self.events.append(Event(scan, "transition", before.name.lower(), state.name.lower()))
        if state == State.IDLE:
            self._context.lock_found = True
        if state in (State.HOME, State.JOG):
            self._start_pending = False
            self._watch.forget()
            self._logged = 0
            self._context.begin()
        if state == State.HOME:
            self._loading.forget()
            self._home.enter(image)
        elif state == State.JOG:
            self._jog.enter(image)
        elif state == State.LOCK:
            self._close_lock.enter()
        elif state == State.UNLOAD:
            self._loading.begin(self.program.unload_segment)
        elif state in _LOADING_STATES:
            self._loading.begin(self._context.segment.index + 1)
        elif state == State.RELEASE:
            self._release.enter()
        elif state == State.COMPLETE:
            self._rest.enter()
        else:
            self._context.phase = 0

    def _trip(self, raised: int, reaction: Reaction, image: Image, scan: int) -> None:
        self._watch.latched |= raised
        self.first_out = cause_among(raised).number
        self._log_alarms(scan)
        self._move("trip", image, scan)
        self._start_pending = False
        self._fault.enter(reaction, image)

    def _leave_fault(self, image: Image, scan: int) -> None:
        self._watch.forget()
        self._logged = 0
        self.first_out = 0
        self._context.stopping = True
        self._context.control_from_input = not self.program.has_torque_out
        self._context.measured.angles_compared = False
        self._move("reset", image, scan)

    def _first_segment(self, state: State) -> int:
        return next(segment.index for segment in self.program.segments if segment.state == state)

    # --- saying it

    def _log_alarms(self, scan: int) -> None:
        """One event per alarm, when it appears for the first time since the last reset."""
        fresh = self._watch.latched & ~self._logged
        self._logged |= fresh
        while fresh:
            bit = fresh & -fresh
            fresh ^= bit
            fault = FAULT_BY_NUMBER[bit.bit_length() - 1]
            self.events.append(Event(scan, "alarm", self._sequence.state.name.lower(), fault.id))

    def _take_notes(self, scan: int) -> None:
        state = self._sequence.state.name.lower()
        self.events.extend(Event(scan, "note", state, text) for text in self._context.notes)
        self._context.notes.clear()

    def _orders(self, strongest: int) -> Orders:
        state = self._sequence.state
        reaction = self._fault.reaction if state == _FAULT else strongest
        self._draft.fill(self._context, state, reaction, self._watch, self.first_out)
        return _orders_of(self._draft)
