"""The report of a stored run, and its loop as a file; for those who only look, of a record that is as it was left."""

from __future__ import annotations

from jinja2 import TemplateError

from analysis.trace.errors import AnalysisError
from recipes import RecipeError
from station.bench.request import stored_job
from station.errors import RecordError
from station.records.run_record import RunRecord
from station.reports.content import loop_csv
from station.reports.illustrate import Shown, illustrate
from station.reports.stored_result import refuse_doubtful, stored_result
from station.results.run_analysis import complete_run


def shown_of(run: RunRecord) -> Shown:
    """Return what is shown of a run: its stored result, and its evaluation where the record bears one.

    Raises:
        RecordError: its recipe or bench cannot be read any more.

    """
    result = stored_result(run)
    try:
        if result.state == "complete" and not result.altered:
            found = complete_run(run)
            return Shown(found.job, result, found.result)
        job = stored_job(run)
    except AnalysisError:
        job = stored_job(run)
    except RecipeError as error:
        raise RecordError(
            f"run {run.id}: the report cannot be made: the recipe or bench file of the run cannot be read: {error}. "
            "Restore the run from a backup"
        ) from error
    return Shown(job, result, None)


def made_report(run: RunRecord, *, keep: bool) -> tuple[bytes, bytes]:
    """Return the report as HTML and as PDF; of an altered record it says so. keep: as for `illustrate`.

    Raises:
        RecordError: the record cannot be read, or is damaged.

    """
    try:
        return illustrate(run, shown_of(run), keep=keep)
    except (KeyError, TypeError, AttributeError, ValueError, TemplateError) as error:
        what = " ".join(str(error).split())
        raise RecordError(
            f"run {run.id}: the report cannot be made, because the record is damaged: {what}. Restore the run from a "
            "backup"
        ) from error


def report_of(run: RunRecord) -> tuple[bytes, bytes]:
    """Return the report as HTML and as PDF, without touching a file of the run.

    Raises:
        RecordError: the run is not concluded, or its record is not as it was left: then it has no verdict to report.

    """
    refuse_doubtful(run)
    return made_report(run, keep=False)


def loop_of(run: RunRecord) -> bytes:
    """Return the branches of every cycle as CSV: torque at the output [N·m], wind-up [arcmin], segment.

    Raises:
        RecordError: as `report_of`; the record bears no evaluation, so there are no branches.

    """
    refuse_doubtful(run)
    analysis = shown_of(run).analysis
    if analysis is None:
        raise RecordError(
            f"run {run.id} was not evaluated, so it has no loop of torque and angle. For the reason, run: lostmotion "
            f"show {run.id}"
        )
    return loop_csv(analysis)
