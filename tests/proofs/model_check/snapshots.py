"""Takes and puts back the whole state of a controller, found by looking at its objects, so that none can be forgotten.

Every number, text, tuple or list that hangs on an object of `controller.*` belongs to the state. `Freezer.key` leaves
out what cannot act any more, by the tables below, each row with its reason; everything else counts.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import Any, NamedTuple

from controller.aftermath import FaultReaction
from controller.controller import Controller
from controller.debounce import debounce_scans
from controller.unloading import Unloading
from definitions.faults import FAULT_BY_ID, FAULTS
from definitions.image import State

S = State
CAP = 20
"""Counters of scans stop here in a key; every limit of the small programs is below."""

NEVER_ACTS: dict[str, str] = {
    "events": "taken out by the caller",
    "first_out": "reported only; that it is set is a property of its own",
    "_last_scan": "only its difference to the next scan counts, and that is one",
    "_in_state": "only tells the caller that the run is over",
    "_waits_for_person": "same",
    "_logged": "equal to `latched` after every step",
    "_context.last_counter": "the counter of the small bench says the same",
    "_home._counter": "the counter of the small bench says the same",
    "_watch.active": "computed anew in every scan",
    "_watch._counting": "tells which counts are not zero",
    "_watch.latched": "acts in FAULT only, see `key`",
    "_context.hold": "computed anew in every scan",
    "_context.notes": "taken out in the same scan",
    "_context.reference_nm": "reported only",
    "_context.measured.torque_in_nm": "computed anew in every scan",
    "_context.measured.torque_out_nm": "computed anew in every scan",
    "_context.measured.controlled_nm": "computed anew in every scan",
    "_context.measured.travel_rad": "computed anew in every scan",
    "_context.measured.locked_motion_rad": "computed anew in every scan",
    "_context.measured.speed_rad_s": "computed anew in every scan",
    "_context.measured.drive_apart_rad": "computed anew in every scan",
    "_context.measured.fastest_rad_s": "no angle of the walks moves",
    "_context._fastest_now_rad_s": "same",
    "_context._fastest_before_rad_s": "same",
    "_context._fast_for_scans": "same",
    "_context._oldest_scans": "never changes",
    "_context.measured.request_age_scans": "the walks turn no shaft",
    "_context._answer_took_scans": "same",
    "_context._sample_age_scans": "same",
    "_context.measured.counter_stands": "computed anew in every scan",
    "_loading._line._n": "the small programs do not measure the torque ratio",
    "_loading._line._sum_in": "same",
    "_loading._line._sum_out": "same",
    "_loading._line._sum_in_in": "same",
    "_loading._line._sum_in_out": "same",
}

NO_STATE = frozenset({"events", "notes", "program", "_program", "_limits", "_control", "_draft"})
"""Taken out by the caller, the same for ever, or (the draft of the orders) filled anew in every scan."""

LOADING = frozenset({S.LOCK, S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG, S.UNLOAD})
ACTS_IN: tuple[tuple[str, frozenset[State]], ...] = (
    # a step is entered anew with its state, by its own `enter` or `begin`
    ("_readiness.", frozenset({S.IDLE})),
    ("_home.", frozenset({S.HOME})),
    ("_close_lock.", frozenset({S.LOCK})),
    ("_release.", frozenset({S.RELEASE})),
    ("_rest.", frozenset({S.COMPLETE})),
    ("_fault.", frozenset({S.FAULT})),
    ("_jog.", frozenset({S.JOG})),
    ("_loading._unloading.", frozenset({S.UNLOAD})),
    ("_loading.", LOADING),
    ("_context.segment", LOADING),
    # the walks turn no shaft, so that no limit above zero tells; a probe does, where every way in has set the limit
    ("_context.measured.lock_motion_limit_rad", LOADING),
    # set with the run and at a reset, which lead to these states
    ("_context.measured.angles_compared", LOADING),
)
UNLOADING_ONLY = ("_fault._torque.", "_fault._unloading.")
"""Begun anew with each controlled unload."""

PLAIN = (int, float, str, tuple, type(None))
CAPS: dict[str, int] = {"_waited": CAP, "_token_age": CAP, "_pressed": CAP, "_at_bound": Unloading.STUCK_SCANS + 1}
"""Counters that stop in a key, by their last name."""

Snapshot = tuple[Any, ...]
"""The state of a controller: the values of each object that keeps state, then one tuple per list."""

Read = Callable[[Any], Any]


class Selection(NamedTuple):
    """What counts in a state: values of objects as they are, counters with the number where they stop, and lists."""

    plain: tuple[tuple[Any, Read], ...]
    capped: tuple[tuple[Any, str, int], ...]
    lists: tuple[tuple[Any, str], ...]


class Freezer:
    """Knows where a controller keeps its state."""

    def __init__(self, controller: Controller, watched_alarms: int) -> None:
        self._controller = controller
        self._watched_alarms = watched_alarms
        self._things: list[tuple[Any, str, tuple[str, ...], Read]] = []
        self._lists: list[tuple[Any, str, str]] = []
        self._walk(controller, "", set())
        paths = {f"{path}{name}" for _, path, names, _ in self._things for name in names}
        paths |= {f"{path}{name}" for _, path, name in self._lists}
        self._writers = [_writer(thing, names) for thing, _, names, _ in self._things]
        unknown = set(NEVER_ACTS) - paths - {"events", "_context.notes"}
        assert not unknown, f"no such state in the controller any more: {unknown}"
        self._selected: dict[tuple[State, int], Selection] = {}
        # a condition that has counted beyond its debounce is the same as one that has counted longer
        self._enough = [0] * 64
        for fault in FAULTS:
            scans = debounce_scans(fault, controller.program)
            self._enough[fault.number] = scans + 1 if scans else 0
        self._enough[FAULT_BY_ID["drive_internal_limit"].number] = CAP
        self._no_counts = (0,) * len(self._enough)

    def _walk(self, thing: Any, path: str, seen: set[int]) -> None:
        seen.add(id(thing))
        names = list(getattr(thing, "__dict__", ())) + [
            n for c in type(thing).__mro__ for n in vars(c).get("__slots__", ())
        ]
        plain, inner = [], []
        for name in names:
            if name in NO_STATE:
                continue
            value = getattr(thing, name)
            if isinstance(value, Callable | dict):
                continue
            if isinstance(value, PLAIN) or type(value).__name__ == "Segment":
                plain.append(name)
            elif isinstance(value, list):
                self._lists.append((thing, path, name))
            elif type(value).__module__.startswith("controller.") and id(value) not in seen:
                inner.append((value, f"{path}{name}."))
        if plain:
            self._things.append((thing, path, tuple(plain), _reader(plain)))
        for value, here in inner:
            if id(value) not in seen:
                self._walk(value, here, seen)

    def _select(self, state: State, phase: int) -> Selection:
        """Return what counts in a state; `phase` is that of the reaction to a fault."""
        plain, capped = [], []
        for thing, path, names, _ in self._things:
            acting = [name for name in names if _acts(f"{path}{name}", state, phase)]
            capped += [(thing, name, CAPS[name]) for name in acting if name in CAPS]
            # of a segment its number tells all
            uncapped = ["segment.index" if name == "segment" else name for name in acting if name not in CAPS]
            if uncapped:
                plain.append((thing, attrgetter(*uncapped)))
        lists = [
            (thing, name)
            for thing, path, name in self._lists
            if f"{path}{name}" != COUNTS and _acts(f"{path}{name}", state, phase)
        ]
        return Selection(tuple(plain), tuple(capped), tuple(lists))

    def take(self) -> Snapshot:
        """The state as it is now."""
        parts = [read(thing) for thing, _, _, read in self._things]
        return (*parts, *(tuple(getattr(thing, name)) for thing, _, name in self._lists))

    def put_back(self, snapshot: Snapshot) -> None:
        """Make the controller what it was."""
        for (thing, _, _, read), write, values in zip(self._things, self._writers, snapshot, strict=False):
            if read(thing) != values:  # by the comparison that keys are compared with
                write(values)
        for (thing, _, name), part in zip(self._lists, snapshot[len(self._things) :], strict=True):
            setattr(thing, name, list(part))

    def key(self) -> tuple[Any, ...]:
        """What the controller is now, so that two which behave alike have the same.

        Counters of scans stop where no limit is beyond.
        """
        controller = self._controller
        state, watch = controller._sequence.state, controller._watch
        fault = state == S.FAULT
        which = state, controller._context.phase if fault else 0
        selected = self._selected.get(which)
        if selected is None:
            selected = self._selected[which] = self._select(*which)
        return (
            watch.latched & self._watched_alarms if fault else 0,
            tuple(map(min, watch._counts, self._enough)) if watch._counting else self._no_counts,
            *[read(thing) for thing, read in selected.plain],
            *[min(getattr(thing, name), cap) for thing, name, cap in selected.capped],
            *[tuple(getattr(thing, name)) for thing, name in selected.lists],
        )


COUNTS = "_watch._counts"
"""The one list whose numbers stop somewhere: each at its own debounce."""


def _reader(names: list[str]) -> Read:
    """Return what reads names of an object as a tuple, of a single name too."""
    if len(names) > 1:
        return attrgetter(*names)
    (name,) = names
    return lambda thing: (getattr(thing, name),)


def _writer(thing: Any, names: tuple[str, ...]) -> Callable[[tuple[Any, ...]], None]:
    """Return what sets the values of names of an object: at once where it has a dictionary."""
    if hasattr(thing, "__dict__"):
        held = vars(thing)
        return lambda values: held.update(zip(names, values, strict=True))

    def write(values: tuple[Any, ...]) -> None:
        for name, value in zip(names, values, strict=True):
            setattr(thing, name, value)

    return write


def _acts(path: str, state: State, phase: int) -> bool:
    """Whether a value may still act in a state, and in a phase of the reaction to a fault."""
    if path in NEVER_ACTS or any(path.startswith(prefix) and state not in states for prefix, states in ACTS_IN):
        return False
    if path.startswith(UNLOADING_ONLY) and not (state == S.FAULT and phase == FaultReaction.UNLOADING):
        return False
    if state != S.FAULT:
        return True
    if path == "_fault._waited":
        return phase != FaultReaction.SETTLED  # begins anew with the recovery
    return path != "_context.stopping"  # set when the fault is left
