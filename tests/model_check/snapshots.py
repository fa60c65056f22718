"""Takes and puts back the whole state of a controller, found by looking at its objects, so that none can be forgotten.

Every number, text, tuple or list that hangs on an object of `controller.*` belongs to the state. `Freezer.key` leaves
out what cannot act any more, by the tables below, each row with its reason; everything else counts.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple

from controller.aftermath import FaultReaction
from controller.controller import Controller
from controller.debounce import debounce_scans
from controller.faults import FAULT_BY_ID, FAULTS
from controller.image import State
from controller.unloading import Unloading

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
    "_last_counter": "the counter of the small bench says the same",
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
    "_context.measured.counter_stands": "computed anew in every scan",
    "_loading._line._n": "the small programs do not measure the torque ratio",
    "_loading._line._sum_in": "same",
    "_loading._line._sum_out": "same",
    "_loading._line._sum_in_in": "same",
    "_loading._line._sum_in_out": "same",
}

LOADING = frozenset({S.LOCK, S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG, S.UNLOAD})
ACTS_IN: tuple[tuple[str, frozenset[State]], ...] = (
    # a step is entered anew with its state, by its own `enter` or `begin`
    ("_readiness.", frozenset({S.IDLE})),
    ("_home.", frozenset({S.HOME})),
    ("_close_lock.", frozenset({S.LOCK})),
    ("_release.", frozenset({S.RELEASE})),
    ("_fault.", frozenset({S.FAULT})),
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


Parts = tuple[tuple[Any, ...], ...]


class Snapshot(NamedTuple):
    """The state of a controller: one tuple of values per object that keeps state, then one per list."""

    parts: Parts


class Freezer:
    """Knows where a controller keeps its state.

    A scan changes few of the controller's objects. So what they hold is remembered, and only those that differ are
    written when a snapshot is put back. Numbers that are equal count as the same there, as they do in the keys.
    """

    def __init__(self, controller: Controller, watched_alarms: int) -> None:
        self._controller = controller
        self._watched_alarms = watched_alarms
        self._things: list[tuple[Any, tuple[str, ...], Callable[[Any], tuple[Any, ...]]]] = []
        self._lists: list[tuple[Any, str]] = []
        self._holds: Parts | None = None
        self.paths: list[str] = []
        list_paths: list[str] = []
        self._walk(controller, "", set(), list_paths)
        self.paths += list_paths
        unknown = set(NEVER_ACTS) - set(self.paths) - {"events", "_context.notes"}
        assert not unknown, f"no such state in the controller any more: {unknown}"
        self._at = {path: i for i, path in enumerate(self.paths)}
        self._selected = {
            (state, unloading): self._selection(state, unloading=unloading)
            for state in State
            for unloading in (True, False)
        }
        caps = {"_waited": CAP, "_at_bound": Unloading.STUCK_SCANS + 1}
        self._caps = {
            which: [
                (position, caps[name])
                for position, i in enumerate(selected)
                if (name := self.paths[i].rpartition(".")[2]) in caps
            ]
            for which, selected in self._selected.items()
        }
        self._select = {which: itemgetter(*selected) for which, selected in self._selected.items()}
        self._waited_in_fault = self._selected[S.FAULT, False].index(self._at["_fault._waited"])
        self._pulsed_in_fault = self._selected[S.FAULT, False].index(self._at["_fault._pulsed"])
        # a condition that has counted beyond its debounce is the same as one that has counted longer
        self._enough = [0] * 64
        for fault in FAULTS:
            scans = debounce_scans(fault, controller.program)
            self._enough[fault.number] = scans + 1 if scans else 0
        self._enough[FAULT_BY_ID["drive_internal_limit"].number] = CAP

    def _walk(self, thing: Any, path: str, seen: set[int], list_paths: list[str]) -> None:
        seen.add(id(thing))
        names = list(getattr(thing, "__dict__", ())) + [
            n for c in type(thing).__mro__ for n in vars(c).get("__slots__", ())
        ]
        plain, inner = [], []
        for name in names:
            value = getattr(thing, name)
            if name in {"events", "notes", "program", "_program", "_limits", "_control"} or isinstance(
                value, Callable | dict
            ):
                continue
            if isinstance(value, PLAIN) or type(value).__name__ == "Segment":
                plain.append(name)
            elif isinstance(value, list):
                self._lists.append((thing, name))
                list_paths.append(f"{path}{name}")
            elif type(value).__module__.startswith("controller.") and id(value) not in seen:
                inner.append((value, f"{path}{name}."))
        if plain:
            # the name that is there twice makes `attrgetter` answer a tuple for a single one, too
            self._things.append((thing, tuple(plain), attrgetter(*plain, plain[0])))
            self.paths += [f"{path}{name}" for name in (*plain, plain[0])]
        for value, here in inner:
            if id(value) not in seen:
                self._walk(value, here, seen, list_paths)

    def _selection(self, state: State, *, unloading: bool) -> list[int]:
        chosen = []
        for path in dict.fromkeys(self.paths):
            if path in NEVER_ACTS:
                continue
            if any(path.startswith(prefix) and state not in states for prefix, states in ACTS_IN):
                continue
            if path.startswith(UNLOADING_ONLY) and not unloading:
                continue
            if state == S.FAULT and path == "_context.stopping":
                continue  # set when the fault is left
            chosen.append(self._at[path])
        return chosen

    def take(self) -> Snapshot:
        """The state as it is now."""
        self._controller.events.clear()
        parts = [read(thing) for thing, _, read in self._things]
        parts += [tuple(getattr(thing, name)) for thing, name in self._lists]
        self._holds = tuple(parts)
        return Snapshot(self._holds)

    def put_back(self, snapshot: Snapshot) -> None:
        """Make the controller what it was."""
        parts = snapshot.parts
        now = self._holds or ((),) * len(parts)
        self._holds = None  # until it is looked at again: a step may follow
        plain = len(self._things)
        for index, (part, held) in enumerate(zip(parts, now, strict=True)):
            if part == held:
                continue
            if index < plain:
                thing, names, _ = self._things[index]
                for name, value in zip(names, part, strict=False):
                    setattr(thing, name, value)
            else:
                thing, name = self._lists[index - plain]
                setattr(thing, name, list(part))

    def value(self, snapshot: Snapshot, path: str) -> Any:
        """One value of a snapshot."""
        return self._flat(snapshot)[self._at[path]]

    def _flat(self, snapshot: Snapshot) -> list[Any]:
        plain = len(self._things)
        return [*chain.from_iterable(snapshot.parts[:plain]), *snapshot.parts[plain:]]

    def key(self, snapshot: Snapshot) -> tuple[Any, ...]:
        """What makes two snapshots behave alike; counters of scans stop where no limit is beyond."""
        values, at = self._flat(snapshot), self._at
        state = values[at["_sequence.state"]]
        fault = state == S.FAULT
        phase = values[at["_context.phase"]] if fault else 0
        which = state, fault and phase == FaultReaction.UNLOADING
        values[at["_context.segment"]] = values[at["_context.segment"]].index
        counts = values[at["_watch._counts"]]
        if any(counts):
            values[at["_watch._counts"]] = tuple(map(min, counts, self._enough))
        alarms = values[at["_watch.latched"]] & self._watched_alarms if fault else 0
        chosen = list(self._select[which](values))
        for position, cap in self._caps[which]:
            chosen[position] = min(chosen[position], cap)
        # both begin anew with the way back
        if fault and phase == FaultReaction.SETTLED:
            chosen[self._waited_in_fault] = 0
        if fault and phase not in (FaultReaction.UNLOADING, FaultReaction.DRIVE_RESET):
            chosen[self._pulsed_in_fault] = False
        return (alarms, *chosen)
