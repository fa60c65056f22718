"""The action about AQDEF files: somebody has seen that a run is in none."""

from __future__ import annotations

from station.errors import StationError
from station.web.actions.row import Call, NotNowError
from station.web.actions.values import AqdefTold, RunInNoFile
from station.web.aqdef import outbox


def acknowledge_aqdef(call: Call, given: RunInNoFile) -> AqdefTold:
    """Note that a run is in no AQDEF file and that this is known; NotNowError: it is no such run, or known already."""
    try:
        left = outbox.acknowledge(call.connection, given.run, call.person.name, given.reason)
    except StationError as error:
        raise NotNowError([("aqdef", str(error))]) from error
    return AqdefTold(run=given.run, refused=left)
