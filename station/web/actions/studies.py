"""Actions about guided studies: begin one, and write which runs it has taken; its runs are started as any run is."""

from __future__ import annotations

from recipes import RecipeError
from station.errors import StationError
from station.quality.guided.plan import Asked, begin
from station.quality.guided.progress import Standing, settle
from station.records.revisions.history import History
from station.web.actions.row import Call, NotNowError
from station.web.actions.values import NamedStudy, NewStudy, StudyTold
from station.web.permission import recipe_file
from station.web.scanner import serial_of


def begin_study(call: Call, given: NewStudy) -> StudyTold:
    """Begin a study by the recipe and the bench that the table of models has for its first unit.

    Raises:
        StationError: the study could not be measured or evaluated so. NotNowError: an unknown model.

    """
    parts = [serial_of(one) for one in given.parts]
    model = call.station.read_models().of(parts[0])
    if model is None:
        raise NotNowError([("model_known", f"No model has serial numbers like '{parts[0]}'. Scan a label of a unit.")])
    asked = Asked(
        kind=given.kind,
        recipe=recipe_file(History(call.station.data), model.recipe),
        bench=model.bench,
        parts=[f"{one}={model.unit}" for one in parts] if model.unit else parts,
        operators=given.operators,
        metrics=given.metrics,
        references=given.references,
        tolerances=given.tolerances,
        trials=given.trials,
    )
    try:
        begin(call.station.data, given.study, asked, call.person.name)
    except RecipeError as error:
        raise StationError(str(error.problems[0])) from error
    return _told(settle(call.station.data, given.study, call.person.name))


def settle_study(call: Call, given: NamedStudy) -> StudyTold:
    """Write into the file of a study which runs it has taken; StudyError: there is none, or its file was changed."""
    return _told(settle(call.station.data, given.study, call.person.name))


def _told(found: Standing) -> StudyTold:
    return StudyTold(study=found.study.name, measured=len(found.measured), steps=len(found.plan.order))
