"""What a run gave, with its times: faults, alarms, reactions, orders and states; said where others were expected."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

from definitions.image import Command, DriveCommand, Orders, Reaction, State
from faultlab.run import FaultRun

MOST = 16
"""Entries of a list that are shown: of more, the first and the last ones."""


class Visit(NamedTuple):
    """Stay in a state: its name, the scan of its entry, and the last scan in it."""

    state: str
    entered: int
    last: int

    @property
    def scans(self) -> int:
        """Scans from the entry to the last one."""
        return self.last - self.entered


class Change(NamedTuple):
    """Something that changed: its new name, and the place in the run's lists."""

    name: str
    place: int


def visits(run: FaultRun) -> list[Visit]:
    """Return the states in the order in which they were visited, each with its first and last scan."""
    states = [*_changes(run, lambda orders: State(orders.state).name.lower())]
    ends = [*(change.place - 1 for change in states[1:]), len(run.scans) - 1][: len(states)]  # none without a scan
    return [
        Visit(change.name, run.scans[change.place], run.scans[end]) for change, end in zip(states, ends, strict=True)
    ]


def reactions(run: FaultRun) -> list[Change]:
    """Return the reactions as they came into force, without the scans in which none was."""
    changes = _changes(run, lambda orders: Reaction(orders.reaction).name.lower())
    return [change for change in changes if change.name != Reaction.NONE.name.lower()]


def orders(run: FaultRun, since: int = 0) -> list[Change]:
    """Return the drive commands as they changed from a place on, the one that was in force there first."""
    return [
        Change(change.name, change.place + since)
        for change in _changes(run, lambda given: DriveCommand(given.drive_command).name.lower(), since)
    ]


def commands(run: FaultRun) -> list[Change]:
    """Return the commands of the operator, each with the scan that took it; the start of the run is one."""
    return [
        Change(Command(image.command).name.lower(), place) for place, image in enumerate(run.images) if image.command
    ]


def _changes(run: FaultRun, name_of: Callable[[Orders], str], since: int = 0) -> Iterable[Change]:
    names = [name_of(given) for given in run.orders[since:]]
    if names:
        yield Change(names[0], 0)
    for place, (before, after) in enumerate(pairwise(names), start=1):
        if before != after:
            yield Change(after, place)


def at(run: FaultRun, place: int) -> str:
    """Say when a place of the run's lists was: scan, seconds, and the scans since the first fault acted."""
    since = run.acted[0][1] if run.acted else None
    after = "" if since is None or place <= since else f", {run.waited(since, place)} after the fault"
    return f"at scan {run.scans[place]} ({run.scans[place] * run.period_s:.3f} s{after})"


def listed(items: Sequence[str], separator: str = ", ") -> str:
    """Join items, with the number of those that are left out in the middle of a long list; 'none' without any."""
    if len(items) > MOST:
        items = [*items[: MOST // 2], f"{len(items) - MOST} more", *items[-(MOST // 2) :]]
    return separator.join(items) or "none"


def alarms_given(run: FaultRun) -> str:
    """List the alarms with their times and states."""
    return listed([f"{event.text} {at(run, run.place(event.scan))} in {event.state}" for event in run.alarms()])


def changes_given(run: FaultRun, changes: Sequence[Change]) -> str:
    """List changes with their times."""
    return listed([f"{change.name} {at(run, change.place)}" for change in changes])


def states_given(run: FaultRun) -> str:
    """List the states with the scans of their entries."""
    return listed([f"{visit.state} at scan {visit.entered}" for visit in visits(run)], " → ")


def begin(run: FaultRun) -> int:
    """Place from which on orders are of interest: the first fault or alarm, or the start of a run without."""
    places = [place for _, place in run.acted[:1]] + [run.place(event.scan) for event in run.alarms()[:1]]
    return min(places, default=0)


def given(run: FaultRun) -> dict[str, str]:
    """Return all that a run gave as lines of text, by what they list."""
    if not run.scans:
        return {"states": "none: nothing has moved"}
    return {
        "faults": listed([f"{name} {at(run, place)}" for name, place in run.acted]),
        "alarms": alarms_given(run),
        "reactions": changes_given(run, reactions(run)),
        "orders": changes_given(run, orders(run, begin(run))),
        "states": states_given(run),
    }


def given_lines(run: FaultRun) -> list[str]:
    """Return all that a run gave, a line for each kind."""
    return [f"  {kind:9} {text}" for kind, text in given(run).items()]
