"""Actions about the bench: the recovery after a fault, and start conditions that are set aside."""

from __future__ import annotations

from station.web import bypasses
from station.web.actions.row import Call, NotNowError
from station.web.actions.values import (
    BypassAdded,
    BypassEnded,
    EndedBypass,
    NewBypass,
    Nothing,
    Recovery,
    RecoveryBegun,
    RecoveryTold,
)


def begin_recovery(call: Call, _given: Nothing) -> RecoveryBegun:
    """Begin the recovery after a fault; NotNowError: one is on, or there is no fault."""
    way_back, standing = call.station.bench.way_back, call.station.bench.standing()
    if standing.recovery or way_back.starting():
        raise NotNowError([("recovery_on", "The recovery is already in progress.")])
    if standing.fault is None or standing.released:
        why = standing.why_none or "The bench was recovered: the lock is open, and the unit can be taken out."
        raise NotNowError([("no_fault", why)])
    way_back.start(call.person.name, standing.fault.run)
    return RecoveryBegun(run=standing.fault.run, cause=standing.fault.cause)


def acknowledge_fault(call: Call, given: Recovery) -> RecoveryTold:
    """Let the recovery go on: torque to zero, lock open; NotNowError: nothing waits for it."""
    seen = call.station.bench.look()
    if seen.sight is None or not (seen.live and seen.recovery and seen.sight.settled):
        raise NotNowError([("not_asked", "Nothing waits to be acknowledged now. See the steps.")])
    return _tell_recovery(call, given, go_on=True)


def leave_recovery(call: Call, given: Recovery) -> RecoveryTold:
    """End the recovery; NotNowError: that one is not on."""
    return _tell_recovery(call, given, go_on=False)


def _tell_recovery(call: Call, given: Recovery, *, go_on: bool) -> RecoveryTold:
    if not call.station.bench.way_back.tell(given.recovery, go_on=go_on):
        raise NotNowError([("no_recovery", f"No recovery {given.recovery[:80]!r} is on.")])
    return RecoveryTold(recovery=given.recovery)


def add_bypass(call: Call, given: NewBypass) -> BypassAdded:
    """Set a start condition aside for some hours."""
    found = bypasses.add_bypass(call.connection, given.condition, call.person.name, given.reason, given.hours)
    return BypassAdded(condition=found.condition, text=str(found))


def end_bypass(call: Call, given: EndedBypass) -> BypassEnded:
    """Let a start condition count again; NotNowError: it does."""
    if not bypasses.end_bypass(call.connection, given.condition):
        raise NotNowError([("no_bypass", f"The condition {given.condition!r} is not bypassed.")])
    return BypassEnded(condition=given.condition)
