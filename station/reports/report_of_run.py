"""The report of a run whose record is as it was left, for those who only look: no file of the run is touched."""

from __future__ import annotations

from jinja2 import TemplateError

from analysis.trace.errors import AnalysisError
from recipes import RecipeError
from station.bench.request import stored_job
from station.documents.result import Result
from station.errors import RecordError
from station.records.run_record import RESULT, RunRecord
from station.records.samples.samples import check_samples
from station.records.seal import alterations, is_sealed
from station.reports.illustrate import Shown, illustrate
from station.results.run_analysis import complete_run


def report_of(run: RunRecord) -> tuple[bytes, bytes]:
    """Return the report as HTML and as PDF.

    Raises:
        RecordError: the run is not concluded, or its record is not as it was left: then it has no verdict to report.

    """
    manifest = run.manifest()
    if not is_sealed(manifest):
        raise RecordError(f"{run.id}: not concluded yet, so there is no result to report")
    doubts = [*alterations(run), *check_samples(run, manifest.records).problems]
    if doubts:
        raise RecordError(f"{run.id}: the record is not as it was left: {doubts[0]}. It has no verdict any more")
    try:
        return illustrate(run, _shown(run), keep=False)
    except RecipeError as error:
        raise RecordError(f"{run.id}: its recipe or bench cannot be read any more: {error}") from error
    except (KeyError, TypeError, AttributeError, ValueError, TemplateError) as error:
        what = " ".join(str(error).split())
        raise RecordError(f"{run.id}: no report: its record is damaged: {what}") from error


def _shown(run: RunRecord) -> Shown:
    result = run.read(Result, RESULT)
    if result.state == "complete":
        try:
            found = complete_run(run)
        except AnalysisError:
            return Shown(stored_job(run), result, None)
        return Shown(found.job, result, found.result)
    return Shown(stored_job(run), result, None)
