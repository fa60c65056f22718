"""Actions about labels: a scan reads one on its unit, one is printed again, a unit goes without."""

from __future__ import annotations

from station.errors import StationError
from station.web.actions.row import Call, NotNowError
from station.web.actions.values import LabelOfRun, LabelTold, NoLabel, Scanned
from station.web.labels import outbox
from station.web.labels.settings import Labels
from station.web.people.badges import refuse_badge


def awaited_label(call: Call) -> str:
    """Return why the next unit has to wait for a label, in words; '' where it has not."""
    labels = call.station.labels
    return "" if labels is None else outbox.why_not_next(call.connection, call.station.data, labels)


def read_label(call: Call, given: Scanned) -> LabelTold:
    """Note that the awaited label was read on its unit; NotNowError: it is another one."""
    labels = _labels(call)
    refuse_badge(call.station.settings, given.scanned)
    try:
        found = outbox.read_back(call.connection, call.station.data, labels, given.scanned, call.person.name)
    except StationError as error:
        raise NotNowError([("label", str(error))]) from error
    return LabelTold(run=found.run, serial=found.serial)


def print_label(call: Call, given: LabelOfRun) -> LabelTold:
    """Have a label printed once more; NotNowError: there is none, or it waits for the printer already."""
    labels = _labels(call)
    try:
        copy = outbox.print_again(call.connection, call.station.data, labels, given.run)
    except StationError as error:
        raise NotNowError([("label", str(error))]) from error
    return LabelTold(run=given.run, copy_number=copy)


def set_label_aside(call: Call, given: NoLabel) -> LabelTold:
    """Let a unit go without a label that was read; NotNowError: none is awaited of it."""
    _labels(call)
    try:
        outbox.set_aside(call.connection, given.run, call.person.name, given.reason)
    except StationError as error:
        raise NotNowError([("label", str(error))]) from error
    return LabelTold(run=given.run)


def _labels(call: Call) -> Labels:
    if call.station.labels is None:
        raise NotNowError([("no_labels", "This station prints no labels. They are set up in labels.yaml.")])
    return call.station.labels
