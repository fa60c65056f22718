"""The label of one sealed run: whether it gets one, and what stands on it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from station.documents.manifest import Manifest
from station.documents.result import Result
from station.errors import StationError
from station.records.certificate_code import code_of
from station.records.chain.entries import Fields
from station.records.revisions.history import History
from station.records.run_record import RunRecord
from station.records.seal import CONCLUDED
from station.reports.headline import manifest_badges
from station.results.sealed_runs import result_of
from station.run.way_back.recover import recover
from station.web.labels.settings import Labels
from station.web.labels.template import LabelError, Source, filled

COMPLETE = "complete"
NO_LABEL = (
    "There are no labels for master parts, for virtual units, and for runs that did not complete, had faults injected, "
    "are part of a study or have a recipe that is not released"
)


class NotYetError(StationError):
    """A run that is being concluded: it is looked at again."""


class NewLabel(NamedTuple):
    """A label that is to be printed; one that cannot be made has no text, and says why."""

    run: str
    serial: str
    label: str = ""
    reads_as: str = ""
    trouble: str = ""


def label_for(data: Path, fields: Fields, labels: Labels) -> NewLabel | None:
    """Return the label of a sealed run; None where it gets none.

    Raises:
        NotYetError: its sealed run.json has not got its name yet.

    """
    run, serial = str(fields["run"]), str(fields["serial"])
    record = RunRecord(data / run)
    try:
        _wait_for_its_name(record)
        altered, result = result_of(data, run)
        if altered:
            raise LabelError(altered[0])
        manifest = record.manifest()
        if not gets_label(data, manifest, labels):
            return None
        if result is None:
            raise LabelError("the run has no result")
        return NewLabel(run, serial, *label_of(data, manifest, result, labels, 1))
    except NotYetError:
        raise
    except StationError as error:
        # Of a record that is not to be believed there is only what the chain says.
        counts = fields["state"] == COMPLETE and fields["verdict"] in labels.templates
        return NewLabel(run, serial, trouble=str(error)) if counts else None


def _wait_for_its_name(record: RunRecord) -> None:
    """Refuse a run between its line in the chain and the name of its run.json, which has no verdict before that."""
    if record.has(CONCLUDED) and record.deserted():
        recover(record)  # its process was killed in that moment
    if record.has(CONCLUDED):
        raise NotYetError(f"run {record.id} is being concluded")


def gets_label(data: Path, manifest: Manifest, labels: Labels) -> bool:
    """Say whether the unit of a run gets a label: by its verdict, never of a master part, a study or with faults.

    Nor does one whose limits nobody has released, as a technician's trial by `lostmotion run`.
    """
    counts = manifest.state == COMPLETE and manifest.unit.master is None and manifest.scenario is None
    counts = counts and manifest.study is None
    real = labels.settings.virtual_units or not manifest_badges(manifest)
    if not (counts and real and manifest.verdict in labels.templates):
        return False
    return History(data).released_with(manifest.recipe.sha256) is not None


def label_of(data: Path, manifest: Manifest, result: Result, labels: Labels, copy: int) -> tuple[str, str]:
    """Return the label of a run in ZPL, and what a scan of it reads; LabelError where it cannot be made."""
    template = labels.templates.get(manifest.verdict or "")
    if template is None:
        raise LabelError(f"run {manifest.id}: units with {manifest.verdict or 'no verdict'} get no label")
    if not gets_label(data, manifest, labels):
        raise LabelError(f"run {manifest.id} gets no label. {NO_LABEL}")
    source = Source(manifest, result, code_of(RunRecord(data / manifest.id)), copy)
    wanted = labels.settings.read_back
    return template.fill(source), "" if wanted is None else filled(wanted, source)
