"""Takes and puts back the whole state of a controller, found by looking at its objects, so that none can be forgotten.

Every number, text, tuple or list that hangs on an object of `controller.*` belongs to the state. `Freezer.key` leaves
out what cannot act any more, by the tables below, each row with its reason; everything else counts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from controller.aftermath import FaultReaction
from controller.controller import Controller
from controller.faults import FAULT_BY_ID, FAULTS
from controller.image import State

S = State
CAP = 20
"""Counters of scans stop here in a snapshot; every limit of the small programs is below."""

NEVER_ACTS: dict[str, str] = {
    "events": "taken out by the caller",
    "first_out": "reported only; that it is set is a property of its own",
    "_last_scan": "only its difference to the next scan counts, and that is one",
    "_in_state": "only tells the caller that the run is over",
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
)
UNLOADING_ONLY = ("_fault._torque.", "_fault._unloading.")
"""Begun anew with each controlled unload."""

PLAIN = (int, float, str, tuple, type(None))


class Snapshot(NamedTuple):
    """The state of a controller: values in the order of the freezer's leaves."""

    values: tuple[Any, ...]


class Freezer:
    """Knows where a controller keeps its state."""

    def __init__(self, controller: Controller, watched_alarms: int) -> None:
        self._controller = controller
        self._watched_alarms = watched_alarms
        self._leaves: list[tuple[Any, str]] = []
        self._lists: list[tuple[Any, str]] = []
        self.paths: list[str] = []
        list_paths: list[str] = []
        self._walk(controller, "", set(), list_paths)
        self.paths += list_paths
        unknown = set(NEVER_ACTS) - set(self.paths) - {"events", "_context.notes"}
        assert not unknown, f"no such state in the controller any more: {unknown}"
        self._selected = {
            (state, unloading): self._selection(state, unloading=unloading)
            for state in State
            for unloading in (True, False)
        }
        self._capped = [i for i, path in enumerate(self.paths) if path.endswith(("._waited", "._in_state"))]
        self._capped_lists = [i for i, path in enumerate(self.paths) if path.endswith("._counts")]
        self._at = {path: i for i, path in enumerate(self.paths)}
        self._waited_in_fault = self._selected[S.FAULT, False].index(self._at["_fault._waited"])
        # a condition that has counted beyond its debounce is the same as one that has counted longer
        self._enough = [0] * 64
        for fault in FAULTS:
            self._enough[fault.number] = fault.debounce_scans + 1 if fault.debounce_scans else 0
        self._enough[FAULT_BY_ID["drive_internal_limit"].number] = CAP

    def _walk(self, thing: Any, path: str, seen: set[int], list_paths: list[str]) -> None:
        seen.add(id(thing))
        names = list(getattr(thing, "__dict__", ())) + [
            n for c in type(thing).__mro__ for n in vars(c).get("__slots__", ())
        ]
        for name in names:
            value = getattr(thing, name)
            here = f"{path}{name}"
            if name in {"events", "notes", "program", "_program", "_limits", "_control"} or isinstance(
                value, Callable | dict
            ):
                continue
            if isinstance(value, PLAIN) or type(value).__name__ == "Segment":
                self._leaves.append((thing, name))
                self.paths.append(here)
            elif isinstance(value, list):
                self._lists.append((thing, name))
                list_paths.append(here)
            elif type(value).__module__.startswith("controller.") and id(value) not in seen:
                self._walk(value, f"{here}.", seen, list_paths)

    def _selection(self, state: State, *, unloading: bool) -> list[int]:
        chosen = []
        for index, path in enumerate(self.paths):
            if path in NEVER_ACTS:
                continue
            if any(path.startswith(prefix) and state not in states for prefix, states in ACTS_IN):
                continue
            if path.startswith(UNLOADING_ONLY) and not unloading:
                continue
            if state == S.FAULT and path == "_context.stopping":
                continue  # set when the fault is left
            chosen.append(index)
        return chosen

    def take(self) -> Snapshot:
        """The state as it is now, counters of scans capped."""
        controller = self._controller
        controller.events.clear()
        values = [getattr(thing, name) for thing, name in self._leaves]
        values += [tuple(getattr(thing, name)) for thing, name in self._lists]
        for index in self._capped:
            values[index] = min(values[index], CAP)
        for index in self._capped_lists:
            if any(values[index]):
                values[index] = tuple(map(min, values[index], self._enough))
        return Snapshot(tuple(values))

    def put_back(self, snapshot: Snapshot) -> None:
        """Make the controller what it was."""
        for (thing, name), value in zip(self._leaves, snapshot.values, strict=False):
            setattr(thing, name, value)
        for (thing, name), values in zip(self._lists, snapshot.values[len(self._leaves) :], strict=True):
            setattr(thing, name, list(values))

    def value(self, snapshot: Snapshot, path: str) -> Any:
        """One value of a snapshot."""
        return snapshot.values[self._at[path]]

    def key(self, snapshot: Snapshot) -> tuple[Any, ...]:
        """What makes two snapshots behave alike."""
        values = snapshot.values
        state = values[self._at["_sequence.state"]]
        fault = state == S.FAULT
        unloading = fault and values[self._at["_context.phase"]] == FaultReaction.UNLOADING
        alarms = values[self._at["_watch.latched"]] & self._watched_alarms if fault else 0
        settled = fault and values[self._at["_context.phase"]] == FaultReaction.SETTLED
        chosen = [values[i] for i in self._selected[state, unloading]]
        if settled:
            chosen[self._waited_in_fault] = 0  # begins anew with the way back
        return (alarms, *chosen)
