"""Leads a person through the recovery from a fault: what the bench shows, what to check, and then step by step.

Called at every look of the supervisor, so it never waits: a question stands until it is answered, and the supervisor
goes on.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import Enum, auto

from controller.aftermath import FaultReaction
from controller.sample import shown_torque_nm
from definitions.faults import FAULT_BY_NUMBER, FAULTS
from definitions.image import Command, DriveState, Image, Link, Orders, Reaction, State
from definitions.program import Program
from definitions.states import row_of
from drivers.servo_drive.emcy import emcy_sentence
from station.records.ring.reader import RingReader
from station.records.samples.scan_record import unpack

QUESTION = "All checked? The torque is then brought to zero and the lock opened; the shaft turns. [y/N] "
NOT_KNOWN = "NOT KNOWN: the device does not answer"
UNPROVEN_DRIVE = (
    "The watchdogs of this drive were not measured. If this program dies, the shaft may go on turning. Keep clear, "
    "with a hand at the emergency stop."
)
"""What is said before the question where nobody knows that the drive ends its torque without this program."""
MOST_TRIES = 3
ANSWER_WITHIN_S = 3.0
"""A reset that was accepted leaves the fault within this time: a drive in fault is reset first."""


class Step(Enum):
    """Where the recovery stands."""

    WAITING = auto()
    ASKING = auto()
    ORDERED = auto()
    LEFT = auto()


class Guide:
    """One recovery. `answer` returns what a person said, None while nothing has come; `asks` is called before that.

    `unproven`: nobody has measured that the drive ends its torque when this program dies; it is said with the question.
    """

    def __init__(
        self,
        program: Program,
        say: Callable[[str], None],
        answer: Callable[[], str | None],
        asks: Callable[[], None],
        *,
        unproven: bool = False,
    ) -> None:
        self._unproven = unproven
        self._program, self._say, self._answer, self._asks = program, say, answer, asks
        self._step = Step.WAITING
        self._tries = 0
        self._ordered_s = 0.0
        self._shown: State | None = None

    def attend(self, ring: RingReader) -> None:
        """Look at the newest record; tell, ask, and give the commands of the person."""
        _, image, orders = unpack(ring.last())
        state = State(orders.state)
        led_here = state != State.STOPPED or self._shown == State.RELEASE  # else it was stopped before it began
        if row_of(state).way_back and state != self._shown and led_here:
            self._shown = state
            self._say(f"  {row_of(state).way_back} ({torque_text(image, orders, self._program)})")
        settled = state == State.FAULT and orders.phase == FaultReaction.SETTLED
        if not settled:
            if self._step is Step.ORDERED and state != State.FAULT:
                self._step = Step.WAITING
        elif self._step is Step.WAITING:
            self._ask_or_leave(image, orders, ring)
        elif self._step is Step.ASKING:
            self._take_answer(ring)
        elif self._step is Step.ORDERED and time.monotonic() - self._ordered_s > ANSWER_WITHIN_S:
            self._say("the bench did not leave the fault: a cause is still present, or a new one has come")
            self._step = Step.WAITING

    def _ask_or_leave(self, image: Image, orders: Orders, ring: RingReader) -> None:
        for line in situation(image, orders, self._program):
            self._say(line)
        if self._tries >= MOST_TRIES:
            self._say(f"not released after {MOST_TRIES} tries: the bench stays as it is")
            self._leave(ring)
            return
        self._asks()
        if self._unproven:
            self._say(f"WARNING  {UNPROVEN_DRIVE}")
        self._say(QUESTION)
        self._step = Step.ASKING

    def _take_answer(self, ring: RingReader) -> None:
        answer = self._answer()
        if answer is None:
            return
        if answer.strip().lower() not in ("y", "yes"):
            self._say("left as it is: lock, drive and torque were not touched")
            self._leave(ring)
            return
        self._say("  acknowledged, reset requested")
        self._tries += 1
        self._ordered_s = time.monotonic()
        self._shown = None
        self._step = Step.ORDERED
        ring.send(Command.ACKNOWLEDGE)
        ring.send(Command.RESET)

    def _leave(self, ring: RingReader) -> None:
        self._step = Step.LEFT
        ring.send(Command.STOP)


def torque_text(image: Image, orders: Orders, program: Program) -> str:
    """Return the torque at the output in words."""
    torque_nm = shown_torque_nm(image, orders, program)
    return "not known: no fresh sample" if torque_nm is None else f"{torque_nm:+.1f} N·m"


def _heard(image: Image, program: Program) -> set[Link]:
    """Return the connections whose last values are fresh: what another one said last, it may not say any more."""
    limits = program.limits
    fresh = {
        Link.CAN: image.drive_age_scans <= limits.drive_stale_scans,
        Link.BRAKE: image.brake_age_scans <= limits.brake_stale_scans,
        Link.REMOTE_IO: image.io_age_scans <= limits.io_stale_scans,
    }
    return {link for link, is_fresh in fresh.items() if is_fresh and not image.links_lost & link}


def situation(image: Image, orders: Orders, program: Program) -> list[str]:
    """Return what the bench shows and what a person checks before anything is acknowledged, one line each."""
    torque = torque_text(image, orders, program)
    drive = DriveState(image.drive_state).name.lower().replace("_", " ")
    lock = f"closed, {image.brake_current_a:.2f} A" if image.brake_on else "open"
    estop = "released" if image.estop_released else "PRESSED"
    guard = "closed" if image.guard_closed else "OPEN"
    heard = _heard(image, program)
    lines = [
        f"Torque at the output  {torque} (the lock may open below {program.release_torque_nm:.1f} N·m)",
        f"Lock                  {lock if Link.BRAKE in heard else NOT_KNOWN}",
        f"Servo drive           {drive if Link.CAN in heard else NOT_KNOWN}",
        f"Emergency stop        {NOT_KNOWN if Link.REMOTE_IO not in heard else estop}",
        f"Guard                 {NOT_KNOWN if Link.REMOTE_IO not in heard else guard}",
    ]
    if image.drive_emcy_code:
        lines.append(f"Servo drive reports   {emcy_sentence(image.drive_emcy_code)}")
    first = FAULT_BY_NUMBER[orders.fault]
    lines += [f"Fault: {first.text}. {first.cause}.", f"  Check: {first.next_action}."]
    others = [f for f in FAULTS if orders.alarms >> f.number & 1 and f != first and f.reaction >= Reaction.UNLOAD]
    lines += [f"Also: {fault.text}. Check: {fault.next_action}." for fault in others]
    return lines
