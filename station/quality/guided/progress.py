"""How far a study is: which run is the measurement of which step, which runs do not count and why, what comes next.

A run names its step when it is started, and counts when it was concluded, is unaltered, came to its end without
injected faults and measured what the plan says. A verdict does not matter: a part may be bad, and one that lies near
a limit, where no verdict is possible, has a value all the same; to leave such values out would choose by the value. A
run whose measurement was invalid has none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from station.bench.request import Job
from station.documents.manifest import Manifest, StudyPlace
from station.documents.result import Result
from station.documents.study import StudyCell, StudyPlan
from station.errors import RecordError, StationError
from station.records.chain.chain_file import Chain
from station.records.data_folder import Store
from station.records.run_record import MANIFEST, RECORDING, RESULT, RunRecord
from station.records.seal import alterations, fingerprint, is_sealed
from station.records.studies import Study, add_taken, read_study
from station.reports.headline import manifest_badges, objection

COMPLETE = "complete"


@dataclass(frozen=True)
class DoesNotCount:
    """A run of a study that is no measurement of its step, and why."""

    step: int
    run: str
    why: str


@dataclass(frozen=True)
class Standing:
    """How a study stands: runs by the step that they measure, and those that do not count.

    beside: runs of its units since it was begun that nobody started for the study. running: the run that is on.
    """

    study: Study
    measured: dict[int, str]
    does_not_count: tuple[DoesNotCount, ...]
    beside: tuple[str, ...]
    running: str

    @property
    def plan(self) -> StudyPlan:
        """The plan."""
        return self.study.plan

    @property
    def open(self) -> tuple[int, ...]:
        """Steps that are not measured, in their order."""
        return tuple(step for step in range(1, len(self.plan.order) + 1) if step not in self.measured)

    @property
    def next(self) -> tuple[int, StudyCell] | None:
        """The step that comes next; None when everything is measured."""
        return (self.open[0], self.plan.order[self.open[0] - 1]) if self.open else None

    def missing_trials(self) -> dict[tuple[str, str], list[int]]:
        """Return what is missing: the trials by unit and operator, '' where none is named."""
        found: dict[tuple[str, str], list[int]] = {}
        for cell in (self.plan.order[step - 1] for step in self.open):
            found.setdefault((cell.part, cell.operator), []).append(cell.trial)
        return found

    def missing(self) -> list[str]:
        """Return in words what is missing: of which unit and operator which trials."""
        rows = []
        for (part, operator), trials in self.missing_trials().items():
            by = f" by {operator}" if operator else ""
            rows.append(f"unit {part}{by}: trial{'s' if len(trials) > 1 else ''} {ranges(trials)}")
        return rows


def ranges(numbers: list[int], between: str = " to ") -> str:
    """Return numbers as text: `1, 3 to 5`; between: what stands between the ends of a range."""
    groups: list[list[int]] = []
    for one in sorted(numbers):
        if groups and one == groups[-1][-1] + 1:
            groups[-1].append(one)
        else:
            groups.append([one])
    return ", ".join(f"{one[0]}" if len(one) == 1 else f"{one[0]}{between}{one[-1]}" for one in groups)


def look(data: Path, name: str, *, samples: bool = False) -> Standing:
    """Return how a study stands, and write nothing; samples: compare those of its runs too, not only their size.

    Raises:
        StationError: as `read_study`.

    """
    study, chain = read_study(data, name), Chain(data)
    chain.index()
    there = _runs_of(data, study)
    measured: dict[int, str] = {}
    refused: list[DoesNotCount] = []
    for step in range(1, len(study.plan.order) + 1):
        for run, why in _judged(study, step, there.by_step.get(step, []), chain, samples=samples):
            if not why and step in measured:
                refused.append(DoesNotCount(step, run, f"the step was measured by run {measured[step]}"))
            elif why:
                refused.append(DoesNotCount(step, run, why))
            else:
                measured[step] = run
    return Standing(study, measured, tuple(refused), tuple(there.beside), there.running)


class _Runs(NamedTuple):
    """Runs of the units of a study since it was begun: those that were started for a step of it, and the others."""

    by_step: dict[int, list[tuple[RunRecord, Manifest]]]
    beside: list[str]
    running: str


def _runs_of(data: Path, study: Study) -> _Runs:
    store, found, running = Store(data), _Runs({}, [], ""), ""
    for run in sorted((run for part in study.plan.parts for run in store.named_by(part)), key=lambda one: one.id):
        try:
            manifest = run.manifest()
        except RecordError:
            continue  # whose it is nobody can say; of a run that was taken it is said by its step
        of = manifest.study
        if of is not None and of.plan == study.plan_sha256:
            found.by_step.setdefault(of.step, []).append((run, manifest))
            running = run.id if manifest.state == RECORDING and not run.deserted() else running
        elif manifest.serial in study.plan.parts and manifest.started >= study.begun and manifest.recovery_of is None:
            found.beside.append(run.id)
    return found._replace(running=running)


def _judged(
    study: Study, step: int, found: list[tuple[RunRecord, Manifest]], chain: Chain, *, samples: bool
) -> Iterator[tuple[str, str]]:
    """Yield the runs of a step, the one that was taken first, with why each does not count, '' where it does."""
    taken = study.taken.get(step)
    if taken is not None and taken.run not in (run.id for run, _ in found):
        yield taken.run, "its folder is missing or damaged. Put it back, or 'lostmotion archive fetch' brings it"
    for run, manifest in sorted(found, key=lambda one: taken is not None and one[0].id != taken.run):
        why = _why_not(run, manifest, study, step, chain, samples=samples)
        if not why and taken is not None and taken.run == run.id and _sha256(run) != taken.sha256:
            why = f"altered since it was taken: the SHA-256 of its {MANIFEST} differs"
        yield run.id, why


def settle(data: Path, name: str, person: str) -> Standing:
    """Return how a study stands, and write into its file which runs are taken.

    Raises:
        StationError: as `read_study`. RecordError: the file cannot be written.

    """
    found = look(data, name)
    for step, run in found.measured.items():
        taken = found.study.taken.get(step)
        if taken is None or taken.run != run:
            add_taken(data, found.study, step, run, _sha256(RunRecord(data / run)), person)
    return found


def place_of(standing: Standing, serial: str, operator: str | None, job: Job) -> StudyPlace:
    """Return the step that a run may measure now, by what is about to be started.

    Raises:
        StationError: everything is measured, a run is on, or another unit, operator, recipe or bench is next.

    """
    study, plan, now = standing.study, standing.plan, standing.next
    if now is None:
        raise StationError(
            f"study {study.name}: every step is measured. 'lostmotion quality study evaluate {study.name}' evaluates it"
        )
    step, cell = now
    if standing.running:
        raise StationError(f"study {study.name}: run {standing.running} is in progress. Wait for its end")
    place = f"study {study.name}, step {step} of {len(plan.order)}"
    if serial != cell.part:
        raise StationError(f"{place}: found unit {serial}; unit {cell.part} is next. Put that unit on the bench")
    if cell.operator and operator != cell.operator:
        found = f"operator {operator}" if operator else "no operator"
        raise StationError(
            f"{place}: found {found}; this step is for operator {cell.operator}. Change the operator, or name the "
            "right one"
        )
    wanted = (("recipe", job.recipe_source, plan.recipe_sha256, plan.recipe_file),
              ("bench", job.bench_source, plan.bench_sha256, plan.bench_file))  # fmt: skip
    for what, source, sha256, path in wanted:
        if source.sha256 != sha256:
            raise StationError(
                f"{place}: found {what} file {source.path} ({source.sha256[:8]}); the study was begun with {path} "
                f"({sha256[:8]}). All steps of a study need the same file. Restore it, or begin a new study"
            )
    return study.place(step)


def _sha256(run: RunRecord) -> str:
    return fingerprint(run.folder / MANIFEST).sha256


def _why_not(  # noqa: PLR0911 - a row for each reason
    run: RunRecord, manifest: Manifest, study: Study, step: int, chain: Chain, *, samples: bool
) -> str:
    """Return why a run is no measurement of its step, '' where it is one."""
    plan, cell = study.plan, study.plan.order[step - 1]
    try:
        if not is_sealed(manifest):
            return f"the run is {run.state()}"
        if altered := alterations(run, samples=samples, chain=chain):
            return f"altered: {altered[0]}"
        if manifest.serial != cell.part:
            return f"the run measured unit {manifest.serial}, and the plan of the study has unit {cell.part} here"
        if cell.operator and manifest.operator != cell.operator:
            return (
                f"the run has the operator {manifest.operator or 'none'}, and the plan of the study has {cell.operator}"
            )
        if manifest.scenario is not None:
            return "faults were injected"
        if manifest.state != COMPLETE:
            return f"the run ended as {manifest.state}"
        if (manifest.recipe.sha256, manifest.bench.sha256) != (plan.recipe_sha256, plan.bench_sha256):
            return "the run was measured with another recipe or bench file than the study began with"
        if bool(manifest_badges(manifest)) != plan.virtual:
            return "the run is simulated" if not plan.virtual else "the run is not of the virtual bench"
        return _without_value(run.read(Result, RESULT), plan)
    except StationError as error:
        return f"the run cannot be read: {error}"


def _without_value(result: Result, plan: StudyPlan) -> str:
    if said := objection(result):
        return f"not decidable: {said}"
    for name in (one.id for one in plan.metrics):
        wanted, *choices = name.split()
        found = [one for one in result.metrics if one.id == wanted and set(choices) <= set(one.choices)]
        values = [one.value for one in found] + [side.value for one in found for side in one.sides.values()]
        if not found or None in values:
            return f"the run has no value of {name}"
    return ""
