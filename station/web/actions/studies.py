"""Actions about guided studies: begin one, and write which runs it has taken; its runs are started as any run is."""

from __future__ import annotations

from collections.abc import Sequence

from recipes import RecipeError
from station.errors import StationError
from station.quality.guided.plan import Asked, begin
from station.quality.guided.progress import Standing, settle
from station.records.revisions.history import History
from station.web.actions.row import Call, NotNowError
from station.web.actions.values import NamedStudy, NewStudy, StudyTold
from station.web.models import Model
from station.web.permission import recipe_file
from station.web.scanner import serial_of


def begin_study(call: Call, given: NewStudy) -> StudyTold:
    """Begin a study by the recipe and the bench that the table of models has for its units.

    Raises:
        StationError: the study could not be measured or evaluated so. NotNowError: a unit of an unknown model, or of
            one that has another recipe or bench than that of the first unit.

    """
    units = _with_models(call, [serial_of(one) for one in given.parts])
    _, model = units[0]
    asked = Asked(
        kind=given.kind,
        recipe=recipe_file(History(call.station.data), model.recipe),
        bench=model.bench,
        parts=[f"{serial}={one.unit}" if one.unit else serial for serial, one in units],
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


def _with_models(call: Call, parts: Sequence[str]) -> list[tuple[str, Model]]:
    """Return serial numbers with their models; NotNowError as `begin_study`."""
    table, found = call.station.read_models(), list[tuple[str, Model]]()
    for serial in parts:
        model = table.of(serial)
        if model is None:
            raise NotNowError(
                [("model_known", f"No model has serial numbers like '{serial}'. Scan a label of a unit.")]
            )
        found.append((serial, model))
    (first, wanted), others = found[0], found[1:]
    for serial, model in others:
        if (model.recipe, model.bench) != (wanted.recipe, wanted.bench):
            words = (
                f"Units '{first}' and '{serial}' are measured by different recipes or benches. Name units of one model."
            )
            raise NotNowError([("parts", words)])
    return found


def settle_study(call: Call, given: NamedStudy) -> StudyTold:
    """Write into the file of a study which runs it has taken; StudyError: there is none, or its file was changed."""
    return _told(settle(call.station.data, given.study, call.person.name))


def _told(found: Standing) -> StudyTold:
    return StudyTold(study=found.study.name, measured=len(found.measured), steps=len(found.plan.order))
