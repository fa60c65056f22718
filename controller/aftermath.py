"""What follows the load: opening the lock and reading the torque zeroes again, and the reactions to a fault."""

from __future__ import annotations

import math

from controller.context import RUNNING, Context, Outcome
from controller.ramp import TorqueRamp
from controller.unloading import Unloading
from definitions.faults import FAULT_BY_ID
from definitions.image import DriveCommand, DriveMode, DriveState, Image, Link, Reaction

DRIVE_IS_OFF = frozenset(
    {DriveState.SWITCH_ON_DISABLED, DriveState.NOT_READY_TO_SWITCH_ON, DriveState.FAULT, DriveState.READY_TO_SWITCH_ON},
)
"""Drive states without torque."""

RESET_S = 0.1
"""How long the drive is given the bit that resets its fault: there are drives that read their control word every 5 ms,
and some that ask for 50 ms of it."""

DRIVE_FAULT_BIT = 1 << FAULT_BY_ID["drive_fault"].number | 1 << FAULT_BY_ID["drive_emergency"].number


class Release:
    """Torque proven low, drive off, proven again, then the lock opens: a wound-up reducer stores energy."""

    PROVE, DRIVE_OFF, PROVE_OFF, OPEN = 1, 2, 3, 4
    PROVE_SCANS = 50

    def __init__(self, context: Context) -> None:
        self._context = context
        self._waited = self._low = 0

    def enter(self) -> None:
        """Begin with the proof that the torque is low."""
        self._context.phase = self.PROVE
        self._waited = self._low = 0

    def scan(self, image: Image, elapsed: int) -> Outcome:
        """`complete` or `stopped` once the lock is open."""
        context = self._context
        self._waited += elapsed
        if self._waited > context.program.release_scans:
            return Outcome(fault="unload_failed" if context.phase != self.OPEN else "brake_stays_closed")
        if context.phase == self.PROVE:
            if self._proven_low(image):
                context.phase = self.DRIVE_OFF
        elif context.phase == self.DRIVE_OFF:
            context.disable_drive()
            if image.drive_state in DRIVE_IS_OFF:
                context.phase = self.PROVE_OFF
        elif context.phase == self.PROVE_OFF:
            if self._proven_low(image):
                context.phase = self.OPEN
                context.measured.brake_current_expected_a = 0.0
                context.lock_proven = False
                context.lock_found = False
                context.brake_on = 0
                context.brake_current_a = 0.0
        elif not image.brake_on and image.brake_current_a <= context.program.lock.tolerance_a:
            return Outcome(trigger="stopped" if context.stopping else "complete")
        return RUNNING

    def _proven_low(self, image: Image) -> bool:
        """Low in enough fresh samples in a row; the count starts anew for the next proof."""
        self._low = self._low + 1 if self._context.torque_is_low(image) else 0
        if self._low < self.PROVE_SCANS:
            return False
        self._low = 0
        return True


class Rest:
    """The end of a complete run: without load, drive off and lock open, both torque zeroes are recorded once more.

    Whoever evaluates the record compares them with those of the start. They are read when the lock has let go: its
    torque falls with its current, and what was left in the unit stands on the sensors until then.
    """

    LETTING_GO, ZEROES, DONE = 1, 2, 3

    def __init__(self, context: Context) -> None:
        self._context = context
        self._waited = self._samples = 0
        self._counter = -1

    def enter(self) -> None:
        """Begin to wait for the lock."""
        self._context.phase = self.LETTING_GO
        self._waited = self._samples = 0
        self._counter = -1

    def scan(self, image: Image, elapsed: int) -> Outcome:
        """One scan; nothing follows it. The zeroes end after as many samples as the tare has, or twice its time."""
        context, program = self._context, self._context.program
        self._waited += elapsed
        if context.phase == self.LETTING_GO:
            if self._waited >= program.let_go_scans:
                context.phase = self.ZEROES
                self._waited = 0
        elif context.phase == self.ZEROES:
            if image.sample_counter != self._counter:
                self._counter = image.sample_counter
                self._samples += 1
            if self._samples > program.tare.samples or self._waited > 2 * program.tare.samples:
                context.phase = self.DONE
        return RUNNING


class FaultReaction:
    """Carries out the reaction in force and escalates when a stronger one comes; the lock stays as it is.

    After UNLOAD the drive is switched off; QUICK_STOP and POWER_OFF switch it off as fast as the drive can. A fault
    stays latched until a person has acknowledged it and asks for the reset, with every cause gone.
    """

    UNLOADING, STOPPING, POWERLESS, SETTLED, DRIVE_RESET = 1, 2, 3, 4, 5

    def __init__(self, context: Context) -> None:
        self._context = context
        self._torque = TorqueRamp(context.program.control, context.program.period_s)
        self._unloading = Unloading(context, self._torque)
        self._waited = 0
        self._reset_scans = max(1, math.ceil(RESET_S / context.program.period_s))
        self.reaction = Reaction.NONE
        self.acknowledged = False

    def enter(self, reaction: Reaction, image: Image) -> None:
        """Begin the reaction; an unload that the drive cannot carry out becomes a quick stop."""
        context = self._context
        self.acknowledged = False
        self.reaction = Reaction.NONE
        context.hold = False
        self._act(reaction, image)

    def another_cause(self) -> None:
        """Ask for a new acknowledgement: nobody has seen this cause yet, and no recovery goes on without that."""
        self.acknowledged = False
        if self._context.phase == self.DRIVE_RESET:
            self._context.disable_drive()
            self._context.phase = self.SETTLED

    def escalate(self, reaction: Reaction, image: Image) -> None:
        """Take up a stronger reaction; a weaker or equal one changes nothing."""
        if reaction > self.reaction:
            self._act(reaction, image)

    def _act(self, reaction: Reaction, image: Image) -> None:
        context = self._context
        self._waited = 0
        self.reaction = reaction
        context.measured.drive_enabled_expected = False
        context.measured.mode_expected = 0
        # with the lock open there is nothing to unload, and a torque that is shown is no torque in the unit
        lock_closed = context.measured.brake_current_expected_a > 0.0
        if reaction == Reaction.UNLOAD and lock_closed and image.drive_state == DriveState.OPERATION_ENABLED:
            context.phase = self.UNLOADING
            context.drive_command = DriveCommand.ENABLE_OPERATION  # homing may have been under way
            if context.drive_mode != DriveMode.CYCLIC_SYNC_TORQUE:
                context.drive_mode = DriveMode.CYCLIC_SYNC_TORQUE
                context.take_over_torque(image)
            controlled_nm = context.control_from(the_input=not context.program.has_torque_out)
            self._torque.begin(controlled_nm, context.drive_torque_nm)
            self._unloading.begin()
        elif reaction == Reaction.POWER_OFF:
            context.phase = self.POWERLESS
            context.disable_drive()
        else:
            context.phase = self.STOPPING
            context.drive_command = DriveCommand.QUICK_STOP
            context.drive_torque_nm = context.drive_velocity_rad_s = 0.0

    def scan(self, image: Image, elapsed: int, active: int) -> Outcome:
        """One scan of the reaction; `active` is the mask of conditions that are still present."""
        context, program = self._context, self._context.program
        self._waited += elapsed
        phase = context.phase
        if phase == self.UNLOADING:
            self._unload(image)
        elif phase == self.STOPPING:
            # the ramp of the drive's quick stop ends in a state without torque; if it does not, the voltage goes
            if image.drive_state in DRIVE_IS_OFF or self._waited > program.enable_scans:
                context.phase = self.POWERLESS
                context.disable_drive()
                self._waited = 0
        elif phase == self.POWERLESS:
            if self._waited >= program.settle_scans:
                context.phase = self.SETTLED
                if self._is_still_on(image):
                    context.notes.append("the servo drive does not switch off: switch its power off, and keep clear")
        elif phase == self.DRIVE_RESET:
            return self._reset_drive(image, active)
        return RUNNING

    def _unload(self, image: Image) -> None:
        context, program = self._context, self._context.program
        done = image.drive_mode == DriveMode.CYCLIC_SYNC_TORQUE and self._unloading.follow(image)
        if done or self._waited > program.unload_limit_scans or image.drive_state != DriveState.OPERATION_ENABLED:
            context.phase = self.POWERLESS
            context.disable_drive()
            self._waited = 0

    def _is_still_on(self, image: Image) -> bool:
        """Say whether the drive itself says so, and is heard: a silent one has an alarm of its own."""
        fresh = image.drive_age_scans <= self._context.program.limits.drive_stale_scans
        return fresh and not image.links_lost & Link.CAN and image.drive_state not in DRIVE_IS_OFF

    def request_reset(self) -> str:
        """Ask for the recovery; says what stands against it, or '' when it has begun."""
        if not self.acknowledged:
            return "reset refused: the fault is not acknowledged. Acknowledge it first"
        if self._context.phase != self.SETTLED:
            return "reset refused: the fault reaction is still active. Wait until it has ended"
        self._context.phase = self.DRIVE_RESET
        self._waited = 0
        return ""

    def _reset_drive(self, image: Image, active: int) -> Outcome:
        context = self._context
        if active & ~DRIVE_FAULT_BIT:
            context.phase = self.SETTLED
            context.notes.append("reset refused: a cause is still present")
        elif image.drive_state in (DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE):
            # The drive acts on the rising edge: the scans before were without the bit. It stays for as long as a slow
            # drive needs to see it, and comes again after as long without it, for a drive that was not ready for it.
            with_bit = self._waited // self._reset_scans % 2 == 0
            context.drive_command = DriveCommand.FAULT_RESET if with_bit else DriveCommand.DISABLE_VOLTAGE
            if self._waited > context.program.enable_scans:
                context.disable_drive()
                context.phase = self.SETTLED
                context.notes.append("reset refused: the servo drive stays in fault")
        elif active or image.drive_state not in DRIVE_IS_OFF:
            context.disable_drive()
            if self._waited > context.program.enable_scans:
                context.phase = self.SETTLED
                why = "keeps reporting an error" if active else "does not switch off"
                context.notes.append(f"reset refused: the servo drive {why}")
        else:
            context.disable_drive()
            return Outcome(trigger="reset")
        return RUNNING
