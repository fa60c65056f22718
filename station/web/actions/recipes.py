"""Actions about recipes: save a draft, try it, ask for its release, release it or send it back."""

from __future__ import annotations

from recipes import RecipeError
from station.records.revisions import writing
from station.records.revisions.history import History
from station.records.revisions.revision import Revision
from station.web.actions.row import Call
from station.web.actions.values import (
    DryRunStarted,
    RecipeChanged,
    RecipeRevision,
    RecipeSentBack,
    RecipeText,
    RecipeTried,
)
from station.web.recipe_text.check import BadRecipeError, bench_of, encoded, refuse_unfit
from station.web.station import Station


def save_recipe(call: Call, given: RecipeText) -> RecipeChanged:
    """Save the draft of a revision; BadRecipeError: the text is no recipe."""
    try:
        found = writing.save_draft(call.station.data, encoded(given.text), call.person.name, given.replaces)
    except RecipeError as error:
        raise BadRecipeError(str(error.problems[0])) from error
    return _changed(found)


def ask_release(call: Call, given: RecipeRevision) -> RecipeChanged:
    """Ask for the release of a draft; BadRecipeError: it cannot be run here."""
    _refuse_unfit(call.station, given)
    return _changed(writing.ask_release(call.station.data, given.name, given.revision, given.sha256, call.person.name))


def release_recipe(call: Call, given: RecipeRevision) -> RecipeChanged:
    """Release what another person has written; BadRecipeError: it cannot be run here."""
    _refuse_unfit(call.station, given)
    return _changed(writing.release(call.station.data, given.name, given.revision, given.sha256, call.person.name))


def send_recipe_back(call: Call, given: RecipeSentBack) -> RecipeChanged:
    """Send a draft back to its authors; RevisionError: nobody has asked for its release."""
    what = (given.name, given.revision, given.sha256, call.person.name, given.reason)
    return _changed(writing.send_back(call.station.data, *what))


def try_recipe(call: Call, given: RecipeTried) -> DryRunStarted:
    """Start a run of a recipe in virtual time; BadRecipeError: it cannot be run here."""
    content = encoded(given.text)
    header = refuse_unfit(content, call.station.models).recipe.recipe
    title = f"{header.name} revision {header.revision}"
    begun = call.station.dry_runs.start(content, title, bench_of(call.station.models, header.name))
    return DryRunStarted(name=header.name, revision=header.revision, sha256=begun.sha256)


def _refuse_unfit(station: Station, given: RecipeRevision) -> None:
    """Refuse a text that cannot be run; one that is not there is refused by whoever looks for it."""
    there = History(station.data).find(given.name, given.revision)
    if there is not None and there.sha256 == given.sha256:
        refuse_unfit(there.text(), station.models)


def _changed(found: Revision) -> RecipeChanged:
    return RecipeChanged(name=found.name, revision=found.revision, sha256=found.sha256, state=found.state.value)
