"""Every safety row and guard of the controller, each made wrong once: the check must notice all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple
from unittest import mock

import small_bench
from safety_rules import AGREEMENT_STATES, CONDITIONS
from small_bench import LOCK_A

from controller import aftermath, conditions, interlocks, jog, preparation, states
from controller.aftermath import FaultReaction, Release
from controller.context import Context, Outcome
from controller.held_lock import HeldLock
from controller.interlocks import INTERLOCKS
from controller.jog import Jog
from controller.preparation import CloseLock, Home
from controller.ramp import TorqueRamp
from controller.states import TRANSITIONS
from definitions.faults import FAULT_BY_ID
from definitions.image import DriveMode, DriveState, Reaction, State
from definitions.jog import DIRECTIONS, JogPhase
from definitions.program import Program


class Mutant(NamedTuple):
    """One change: what is replaced (object, attribute) and by what.

    `fault`: of the row that is changed; its conditions are what notices it first.
    """

    name: str
    thing: Any
    attribute: str
    value: Any
    on_the_way_back: bool = False
    of_a_jog: bool = False
    fault: str = ""

    @contextmanager
    def applied(self) -> Iterator[None]:
        """Make the change for as long as the context lasts."""
        with mock.patch.object(self.thing, self.attribute, self.value):
            yield


def trip_rows() -> list[Mutant]:
    """Each trip row missing."""
    return [
        Mutant(f"no trip from {row.source.name}", states, "TRANSITIONS", tuple(r for r in TRANSITIONS if r != row))
        for row in TRANSITIONS
        if row.trigger == "trip"
    ]


def interlock_rows() -> list[Mutant]:
    """Each interlock missing, and each with a weaker reaction."""
    missing = [
        Mutant(f"no {row.fault}", interlocks, "INTERLOCKS", tuple(r for r in INTERLOCKS if r != row), fault=row.fault)
        for row in INTERLOCKS
    ]
    weaker = [
        Mutant(
            f"{row.fault} only {Reaction(fault.reaction - 1).name}",
            interlocks,
            "FAULT_BY_ID",
            {**FAULT_BY_ID, row.fault: fault._replace(reaction=Reaction(fault.reaction - 1))},
            fault=row.fault,
        )
        for row in INTERLOCKS
        for fault in [FAULT_BY_ID[row.fault]]
    ]
    return missing + weaker


def debounce_rows() -> list[Mutant]:
    """Each interlock slower by one scan than it is allowed to be."""
    return [
        Mutant(
            f"{row.fault} slow", interlocks, "FAULT_BY_ID",
            {**FAULT_BY_ID, row.fault: fault._replace(debounce_scans=fault.debounce_scans + 3)}, fault=row.fault,
        )
        for row in INTERLOCKS
        for fault in [FAULT_BY_ID[row.fault]]
        if row.fault not in ("drive_internal_limit", "torque_channels_disagree")
    ]  # fmt: skip


SEEN_OTHERWISE: dict[tuple[str, State], str] = {
    **{
        ("drive_fault", state): "drive_dropped_out sees it in the same scan, with the same reaction"
        for state in (State.LOCK, State.CALIBRATE, State.RAMP_POS, State.REVERSE, State.RAMP_NEG, State.UNLOAD)
    },
    ("drive_mode_refused", State.REVERSE): "a dwell of the small programs lasts one scan; the next ramp sees it",
}
"""Rows that another one stands in for: their absence changes nothing that a rule could see."""


def asked_for(fault: str, state: State) -> bool:
    """Whether the rules want a condition to be seen in a state."""
    if fault == "torque_channels_disagree":
        return state in AGREEMENT_STATES
    asking = [c for name, c in CONDITIONS.items() if name.split(" ")[0] == fault]
    return any(state in (*c.states, *c.established_in) for c in asking)


NOT_ASKED_FOR: dict[tuple[str, State], str] = {
    ("drive_mode_refused", State.HOME): "no mode is expected before HOME ends; its steps wait for the modes they need",
    **{
        (fault, State.RELEASE): "the torque is low, and RELEASE itself switches the drive off"
        for fault in ("drive_dropped_out", "drive_mode_refused", "drive_internal_limit")
    },
    **{
        (row.fault, State.FAULT): "its reaction is the weakest of a fault: in force already; it stands against a reset"
        for row in INTERLOCKS
        if State.FAULT in row.live_in
        and FAULT_BY_ID[row.fault].reaction == Reaction.UNLOAD
        and not asked_for(row.fault, State.FAULT)
    },
}
"""Where a row is live and no rule wants it, so that there is no mutant of it."""


def live_states() -> list[Mutant]:
    """Each interlock blind in one of the states where it must see."""
    found = []
    for row in INTERLOCKS:
        for state in State:
            if state not in row.live_in or not asked_for(row.fault, state) or (row.fault, state) in SEEN_OTHERWISE:
                continue
            blind = row._replace(live_in=row.live_in - {state})
            rows = tuple(blind if r == row else r for r in INTERLOCKS)
            name = f"{row.fault} blind in {state.name}"
            of_a_jog = state == State.JOG
            found.append(Mutant(name, interlocks, "INTERLOCKS", rows, of_a_jog=of_a_jog, fault=row.fault))
    return found


def _program_with(change: Callable[[Program], Program]) -> Callable[..., Program]:
    original = small_bench.small_program
    return lambda **options: change(original(**options))


def _endless(name: str) -> Mutant:
    return Mutant(f"{name} without end", small_bench, "small_program",
                  _program_with(lambda program: replace(program, **{name: 10**9})))  # fmt: skip


def _endless_ramps(program: Program) -> Program:
    return replace(program, segments=tuple(replace(s, limit_scans=10**9) for s in program.segments))


def _reset_without_look(original: Callable[..., Outcome], self: FaultReaction, image: Any, _active: int) -> Outcome:
    return original(self, image, 0)


def _reset_without_acknowledgement(original: Callable[..., str], self: FaultReaction) -> str:
    self.acknowledged = True
    return original(self)


def _unlimited(original: Callable[..., None], self: TorqueRamp, control: Any, period_s: float, field: str) -> None:
    original(self, replace(control, **{field: 1e9}), period_s)


def _take_over_blindly(self: Context, image: Any) -> None:
    self.drive_torque_nm = image.drive_torque_nm


def _skip_tare(self: Home, _image: Any) -> Outcome:
    return self._next(self.ENABLE)


def _lock_at_once(self: CloseLock, _image: Any, _elapsed: int) -> Outcome:
    self._context.phase = self.PROOF
    return Outcome(trigger="closed")


def _with_image(**shown: float) -> Callable[..., Any]:
    """A step that takes something for granted that it should have seen."""
    original = HeldLock.scan
    return lambda self, image, elapsed: original(self, image._replace(**shown), elapsed)


def _always(*, value: bool) -> property:
    return property(lambda _self: value, lambda _self, _value: None)


def _method(function: Callable[..., Any], *args: Any, **options: Any) -> Callable[..., Any]:
    return lambda self, *more: function(*args, self, *more, **options)


def guards() -> list[Mutant]:
    """Each guard outside the tables missing."""
    nothing = _method(lambda *_: None)
    ramp = TorqueRamp.__init__
    found = [
        Mutant("release without proof", Release, "_proven_low", lambda *_: True),
        Mutant("release with one sample", Release, "PROVE_SCANS", 0),
        Mutant("release with the drive on", aftermath, "DRIVE_IS_OFF", frozenset(DriveState)),
        Mutant("torque always low", Context, "torque_is_low", lambda *_: True),
        Mutant("torque low by late samples", Context, "sample_is_fresh", lambda *_: True),
        Mutant("reset without acknowledgement", FaultReaction, "request_reset",
               partial(_method, _reset_without_acknowledgement)(FaultReaction.request_reset)),
        Mutant("reset with the cause present", FaultReaction, "_reset_drive",
               partial(_method, _reset_without_look)(FaultReaction._reset_drive)),
        Mutant("another cause needs no acknowledgement", FaultReaction, "another_cause", nothing),
        Mutant("no reaction gets stronger", FaultReaction, "escalate", nothing),
        Mutant("power off that leaves the drive on", Context, "disable_drive", nothing),
        Mutant("drive's torque taken over blindly", Context, "take_over_torque", _take_over_blindly),
        Mutant("no tare", Home, "_tare", _skip_tare),
        Mutant("lock taken for closed", CloseLock, "scan", _lock_at_once),
        Mutant("no slew", TorqueRamp, "__init__", lambda s, c, p: _unlimited(ramp, s, c, p, "slew_nm_s")),
        Mutant("ramps without end", small_bench, "small_program", _program_with(_endless_ramps)),
        Mutant("lock without end", small_bench, "small_program", _program_with(
            lambda program: replace(program, lock=replace(program.lock, limit_scans=10**9)))),
        Mutant("drive enabled from anywhere", preparation, "ENABLE_PATH", dict.fromkeys(DriveState, 3)),
        # the drive that does not follow, in each of the modes
        Mutant("following not asked for by torque", conditions, "CYCLIC_MODES", (DriveMode.CYCLIC_SYNC_VELOCITY,)),
        Mutant("following not asked for by speed", conditions, "CYCLIC_MODES", (DriveMode.CYCLIC_SYNC_TORQUE,)),
    ]  # fmt: skip
    budgets = ("enable_scans", "homing_scans", "mode_scans", "release_scans", "unload_limit_scans")
    return found + [_endless(name) for name in budgets]


def way_back() -> list[Mutant]:
    """Each guard of a lock that was found or left closed missing."""
    changes: list[tuple[str, type, str, Any]] = [
        ("held lock proven by one scan", HeldLock, "HOLD_SCANS", 1),
        ("held lock without its current", HeldLock, "scan", _with_image(brake_on=1, brake_current_a=LOCK_A)),
        ("held lock with late samples", HeldLock, "scan", _with_image(sample_age_scans=1)),
        ("held lock without end", HeldLock, "PATIENCE", 10**9),
        ("recovery on a lock that is not proven", Context, "lock_proven", _always(value=True)),
        ("lock that is found closed not kept", Context, "keep_lock", _method(lambda *_: None)),
        ("lock never taken for found", Context, "lock_found", _always(value=False)),
        ("lock taken for found for ever", Context, "lock_found", _always(value=True)),
    ]
    return [Mutant(*change, on_the_way_back=True) for change in changes]


def _press_at_any_time(self: Jog, image: Any, _jog: Any) -> Outcome:
    return self._next(JogPhase.ENABLING) if self._held and image.enabling_device else Outcome()


def _at_once(self: Jog, speed_rad_s: float, _acceleration_rad_s2: float) -> None:
    self._context.drive_velocity_rad_s = speed_rad_s


def _with_jog(**changes: int) -> Callable[..., Program]:
    return _program_with(lambda p: replace(p, jog=None if p.jog is None else replace(p.jog, **changes)))


def _with_device_pressed(original: Callable[..., Outcome], self: Jog, image: Any, elapsed: int) -> Outcome:
    return original(self, image._replace(enabling_device=1), elapsed)


def _deaf_to_a_stop(original: Callable[..., None], self: Jog, *told: Any) -> None:
    self._context.stopping = False
    original(self, *told)


def jogs() -> list[Mutant]:
    """Each guard of a jog missing."""
    both_ways = dict.fromkeys(DIRECTIONS, 1)
    changes: list[tuple[str, Any, str, Any]] = [
        ("token that never ages", small_bench, "small_program", _with_jog(token_scans=10**9)),
        ("token that lives a scan longer", small_bench, "small_program", _with_jog(token_scans=3)),
        ("enabling device taken for pressed", Jog, "scan", partial(_method, _with_device_pressed)(Jog.scan)),
        ("enabling device pressed before the key", Jog, "_wait", _press_at_any_time),
        ("key of the other direction", jog, "DIRECTIONS", both_ways),
        ("shaft stopped without a ramp", Jog, "_approach", _at_once),
        ("stuck contact borne for ever", small_bench, "small_program", _with_jog(longest_press_scans=10**9)),
        ("shaft that turns on borne for ever", small_bench, "small_program", _with_jog(stop_scans=10**9)),
        ("stop that is not heard", Jog, "_take_token", partial(_method, _deaf_to_a_stop)(Jog._take_token)),
        ("lock taken for open", conditions, "BRAKE_STAYS_CLOSED", 0),
    ]
    return [Mutant(*change, of_a_jog=True) for change in changes]


ALL: dict[str, Callable[[], list[Mutant]]] = {
    "trip rows": trip_rows,
    "interlock rows": interlock_rows,
    "debounce": debounce_rows,
    "guards": guards,
    "recovery": way_back,
    "jog": jogs,
    "live states": live_states,
}
