"""Start permission: the conditions under which a unit may be measured, one row each, in the order they are told.

A condition looks at what is there and returns why the start is refused, in plain words, or None. All are looked at, so
that nobody mends one to learn of the next.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from recipes import RecipeError
from station.bench.request import Job, load_job
from station.documents.manifest import MASTER, EarlierAttempt
from station.errors import StationError
from station.quality.guided.progress import look, place_of
from station.records.clock_behind import ClockBehind, clock_behind
from station.records.data_folder import Store
from station.records.master_parts import master_parts
from station.records.revisions.history import History
from station.records.revisions.revision import Revision, RevisionError
from station.records.run_record import RunRecord
from station.run.disk_space import refuse_full_disk
from station.run.jog.jogs import jog_is_on
from station.run.way_back.begins_at import recovery_begins_at
from station.run.way_back.last_run import last_run_of, why_not_free
from station.wall_clock import WALL_CLOCK
from station.web.bad_units import Bad, bad_unit_of
from station.web.mes.previous_step import FAILED, PASSED, PreviousStep
from station.web.models import Model, Models

CLOCK = "clock_plausible"
"""Id of the condition whose bypass says that the clock is right."""

EARLIEST = datetime(2025, 1, 1, tzinfo=UTC)
"""A clock before this has lost its battery."""


@dataclass(frozen=True)
class Wanted:
    """What is asked for: a serial number, and why it is measured again where it was before.

    study: the guided study whose next step it is to be, '' for none; operator: who measures it.
    """

    serial: str
    retest_reason: str = ""
    study: str = ""
    operator: str = ""


@dataclass(frozen=True)
class Situation:
    """What the conditions look at. job: of the unit's recipe, None where it cannot be had; then why_no_job says so.

    release: the released revision that the recipe is, letter by letter; None where its text is not released.
    previous_step: what the MES says of the unit; None where the plant has set up no MES.
    label: which label is not on its unit yet, in words; '' where none is awaited.
    behind: by what the computer's clock is behind; None where it is not.
    last: the newest run on the unit's own bench, whatever other benches did since.
    study: why it is not the next step of the study that is asked for, in words; '' where it is, or none is asked for.
    """

    data: Path
    wanted: Wanted
    model: Model | None
    job: Job | None
    why_no_job: str
    release: Revision | None
    busy: bool
    before: tuple[EarlierAttempt, ...]
    behind: ClockBehind | None
    bad: Bad | None
    previous_step: PreviousStep | None = None
    scanner_tested: bool = True
    jogging: bool = False
    label: str = ""
    study: str = ""
    last: RunRecord | None = None

    @property
    def is_master_part(self) -> bool:
        """Whether the unit is a master part of the bench: it may be measured at any time, as often as anybody likes."""
        return self.job is not None and self.job.bench.master_part(self.wanted.serial) is not None

    def run_options(self) -> list[str]:
        """Return recipe, bench and virtual unit as `lostmotion run` takes them: the recipe's file as it was judged."""
        if self.model is None or self.job is None:
            raise StationError("the start conditions are not met, so no recipe is chosen. Scan the unit again")
        model, (recipe, named) = self.model, self.likely
        bench = ["--bench", named] if named else []
        # What was judged is what runs: the files are read again by the process of the run.
        judged = [f"--judged={one.sha256}" for one in (self.job.recipe_source, self.job.bench_source)]
        return [recipe, *bench, *(["--unit", model.unit] if model.unit else []), *judged]

    @property
    def likely(self) -> tuple[str, str]:
        """Recipe and bench of the unit, which are likely to be those of the next one; '' for none."""
        recipe = "" if self.job is None else str(self.job.recipe_source.path)
        return recipe, "" if self.model is None or self.model.bench is None else self.model.bench


class Condition(NamedTuple):
    """One row: id, what it asks in a few words, the look, and whether somebody may set it aside for a while."""

    id: str
    title: str
    why_not: Callable[[Situation], str | None]
    may_be_bypassed: bool = False


def situation_of(
    data: Path, models: Models, wanted: Wanted, *, busy: bool, confirmed: frozenset[str],
    previous_step: PreviousStep | None = None, scanner_tested: bool = True, label: str = "",
) -> Situation:  # fmt: skip
    """Look at what is there; confirmed: runs whose bad unit is in its box; previous_step: what the MES says.

    scanner_tested: whether the test code was read rightly this shift, or need not be. label: which one is awaited.
    """
    model, job, why, release = models.of(wanted.serial), None, "", None
    if model is not None:
        try:
            history = History(data)
            job = load_job(recipe_file(history, model.recipe), model.bench)
            release = history.released_with(job.recipe_source.sha256)
        except (RecipeError, StationError) as error:
            why = str(error)
    store = Store(data)
    before = store.attempts_of(wanted.serial)
    bad = bad_unit_of(data, confirmed)
    study = "" if not wanted.study or job is None else _why_not_next(data, wanted, job)
    return Situation(
        data, wanted, model, job, why, release, busy, before, clock_behind(data), bad, previous_step, scanner_tested,
        jogging=jog_is_on(data), label=label, study=study,
        last=None if job is None or job.bench.bench.embedded else last_run_of(data, job),
    )  # fmt: skip


def _why_not_next(data: Path, wanted: Wanted, job: Job) -> str:
    """Return why a unit is not the next step of a study, '' where it is."""
    try:
        place_of(look(data, wanted.study), wanted.serial, wanted.operator, job)
    except StationError as error:
        return f"{error}."
    return ""


def likely_first(data: Path, models: Models) -> tuple[str, str]:
    """Return recipe and bench of the first model of a table, '' for none: nobody knows which unit comes."""
    first = models.models[0]
    try:
        return recipe_file(History(data), first.recipe), first.bench or ""
    except StationError:
        return "", ""


def recipe_file(history: History, recipe: str) -> str:
    """Return the file of a recipe that the table of models names: of its newest released revision, where it has one."""
    found = history.newest_released(recipe)
    if found is None and any(name == recipe for name, _ in history.own):
        raise RevisionError(f"the recipe {recipe} has no released revision. A second person has to release its draft")
    return recipe if found is None or found.shipped else str(found.path)


def refusals(situation: Situation, bypassed: Collection[str] = ()) -> list[tuple[str, str]]:
    """Return id and reason of every condition that is not met; while a run or a jog is on that alone counts.

    bypassed: ids of conditions that were set aside; of the others none can be.
    """
    if (busy := _bench_free(situation)) is not None:
        return [(CONDITIONS[0].id, busy)]
    counting = [one for one in CONDITIONS if not (one.may_be_bypassed and one.id in bypassed)]
    found = ((one.id, one.why_not(situation)) for one in counting)
    return [(name, why) for name, why in found if why is not None]


def _bench_free(one: Situation) -> str | None:
    if one.busy:
        return "A run is in progress. Wait for its result, then scan again."
    return "The bench is being jogged. End the jog on the page Jog, then scan again." if one.jogging else None


def _model_known(one: Situation) -> str | None:
    if one.model is not None:
        half, rest = one.wanted.serial[: len(one.wanted.serial) // 2], one.wanted.serial[len(one.wanted.serial) // 2 :]
        if half != rest or not one.model.fits(half):
            return None
        return f"The scanner sent two codes as one: '{half}' and '{rest}'. Scan the unit again."
    return (
        f"No model has serial numbers like '{one.wanted.serial}'. Scan the label of the unit, or call the technician."
    )


def _scanner_tested(one: Situation) -> str | None:
    if one.scanner_tested:
        return None
    return "The scanner was not tested this shift. Scan the test code on the card at the bench, then the unit."


def _previous_step_passed(one: Situation) -> str | None:
    step = one.previous_step
    if step is None or one.is_master_part or step.result == PASSED or step.unverified:
        return None
    if step.result == FAILED:
        return "The unit failed its previous process step, says the MES. Put it aside and call the shift leader."
    if not step.away:
        return "The MES has not said that the unit passed its previous process step. Call the shift leader."
    if step.silent_s is None:
        return (
            "The MES was never heard, and has not said that the unit passed its previous process step. Hold the unit."
        )
    return (
        f"The MES was last heard {step.silent_s:.0f} s ago, and has not said that the unit passed its previous process "
        "step. Hold the unit."
    )


def unverified_note(one: Situation) -> str | None:
    """Return what the record says of a unit whose previous process step nobody has confirmed; None otherwise."""
    if one.previous_step is None or one.is_master_part or not one.previous_step.unverified:
        return None
    return "unverified: the MES was not reachable, so the previous process step of this unit was not confirmed"


def _recipe_in_order(one: Situation) -> str | None:
    if one.model is None or one.job is not None:
        return None
    return f"The recipe {one.model.recipe} cannot be run: {one.why_no_job}"


def _recipe_released(one: Situation) -> str | None:
    if one.job is None or one.release is not None:
        return None
    header = one.job.recipe.recipe
    return (
        f"The recipe {header.name} revision {header.revision} ({one.job.recipe_source.path}) is not released. "
        "A technician imports it on the page Recipes, and a second person releases it."
    )


def _bad_unit_put_away(one: Situation) -> str | None:
    return None if one.bad is None else one.bad.text


def _label_read(one: Situation) -> str | None:
    return one.label or None


def _study_step(one: Situation) -> str | None:
    return one.study or None


def _attempts_left(one: Situation) -> str | None:
    # A study says how often its units are measured, and is the reason for it.
    if one.model is None or one.is_master_part or one.wanted.study or _measured(one) < one.model.attempts:
        return None
    return (
        f"This unit was measured {_measured(one)} times ({_told(one.before)}); {one.model.attempts} are allowed. Call "
        "the technician."
    )


def _retest_reason(one: Situation) -> str | None:
    over = one.model is None or _measured(one) >= one.model.attempts
    if not one.before or over or one.is_master_part or one.wanted.study or one.wanted.retest_reason.strip():
        return None
    return f"This unit was measured before ({_told(one.before)}). Measuring it again needs a reason."


def _measured(one: Situation) -> int:
    return one.before[-1].attempt if one.before else 0


def _told(before: tuple[EarlierAttempt, ...]) -> str:
    return "; ".join(str(one) for one in before[-3:])


def _bench_recovered(one: Situation) -> str | None:
    if one.last is None or one.job is None or one.job.bench.bench.embedded:
        return None
    named = "" if one.model is None or one.model.bench is None else f" --bench {one.model.bench}"
    try:
        if not why_not_free(one.data, one.last, ""):
            return None
        offered = recovery_begins_at(one.data)
        there = "on the page Maintenance, or " if offered is not None and offered.id == one.last.id else ""
        to_do = f"A technician recovers the bench {there}with 'lostmotion recover{named}'."
        return why_not_free(one.data, one.last, to_do)
    except StationError as error:
        return f"The recovery after the last run of this bench cannot be read: {error}"


def _master_parts(one: Situation) -> str | None:
    if one.job is None or one.is_master_part:
        return None
    checked = master_parts(Store(one.data), one.job.bench, WALL_CLOCK.now(), one.job.product)
    bad = [part.text.removeprefix(MASTER) for part in checked if not part.in_order]
    if not bad:
        return None
    return f"Master part {'; master part '.join(bad)}. Measure it before any other unit, or call the technician."


def _room_on_disk(one: Situation) -> str | None:
    if one.job is None:
        return None
    try:
        refuse_full_disk(one.data, one.job)
    except StationError as error:
        return str(error)
    return None


def _clock_plausible(one: Situation) -> str | None:
    to_do = "Call the technician to set the clock."
    if one.behind is not None:
        return f"{one.behind.found[0].upper()}{one.behind.found[1:]}. {to_do}"
    now = WALL_CLOCK.now()
    if now < EARLIEST:
        return f"The computer's clock says {now:%Y-%m-%d %H:%M} UTC, which is before this program was made. {to_do}"
    return None


CONDITIONS: tuple[Condition, ...] = (
    Condition("bench_free", "no run and no jog is in progress", _bench_free),
    Condition("model_known", "the serial number belongs to a known model", _model_known),
    Condition(
        "scanner_tested",
        "the scanner read the test code correctly in this shift",
        _scanner_tested,
        may_be_bypassed=True,
    ),
    Condition(
        "previous_step_passed",
        "the MES says that the unit passed its previous process step",
        _previous_step_passed,
        may_be_bypassed=True,
    ),
    Condition("recipe_in_order", "recipe and bench of the model are valid", _recipe_in_order),
    Condition("recipe_released", "a second person has released this text of the recipe", _recipe_released),
    Condition("bad_unit_put_away", "each bad unit is in the NOK box", _bad_unit_put_away),
    Condition("label_read", "the label of the last unit was read back on it", _label_read, may_be_bypassed=True),
    Condition("study_step", "the unit and the operator are those of the study's next step", _study_step),
    Condition(
        "attempts_left", "the unit was measured fewer times than its model allows", _attempts_left, may_be_bypassed=True
    ),
    Condition(
        "retest_reason",
        "a reason is given if the unit was measured before",
        _retest_reason,
        may_be_bypassed=True,
    ),
    Condition("bench_recovered", "the bench was recovered after a fault", _bench_recovered),
    Condition(
        "master_parts",
        "each master part of the bench was measured on time, with the expected verdict",
        _master_parts,
        may_be_bypassed=True,
    ),
    Condition("room_on_disk", "there is room on the disk for the record", _room_on_disk),
    Condition(CLOCK, "the computer's clock is plausible", _clock_plausible, may_be_bypassed=True),
)
"""Conditions of a start. What keeps hands and bench safe, or says what a unit is, nobody can set aside."""
