"""A question asked of many runs: what has its line in the ledger is not evaluated again."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from station.archive.settings import ArchiveSettings
from station.reevaluation.evaluate_one import Job, Outcome, software_key
from station.reevaluation.jobs import Wanted, Where, jobs_of
from station.reevaluation.ledger import LedgerLine, open_ledger
from station.reevaluation.limits_by_sql import LimitsAnswers, limits_outcomes
from station.reevaluation.on_ray import evaluate_on
from station.reevaluation.question import LimitsQuestion, Question, ReevaluationError
from station.reevaluation.workers import Evaluated, evaluate_here


@dataclass(frozen=True)
class Means:
    """How a question is asked.

    workers: processes. archive: of the data folder, None where it has none. cluster: address of a Ray cluster, None for
    this computer. from_archive: runs are read from the archive, although they are here.
    """

    workers: int
    archive: ArchiveSettings | None = None
    cluster: str | None = None
    from_archive: bool = False


@dataclass
class Reevaluated:
    """What came of a question: a line for each run, runs that could not be evaluated, and what it took.

    known: runs whose line was there already. died: how many processes died in the middle of a run. processor_s: what
    the evaluations took of a processor, without those that died.
    """

    question: str
    hash: str
    software: str
    ledger: Path
    lines: list[LedgerLine] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    known: int = 0
    died: int = 0
    processor_s: float = 0.0
    seconds: float = 0.0
    digest: str = ""
    twice: int = 0

    @property
    def evaluated(self) -> int:
        """Runs that were evaluated now."""
        return len(self.lines) - self.known

    def count_death(self, _job: Job) -> None:
        """Count a process that died in the middle of a run."""
        self.died += 1

    def changes(self) -> Counter[tuple[str, str]]:
        """Return how many runs go from which verdict to which."""
        return Counter((line.before, line.after) for line in self.lines)

    def flips(self) -> list[LedgerLine]:
        """Return the runs whose verdict would be another one, oldest first."""
        return [line for line in self.lines if line.flips]


Told = Callable[[int, int], None]


def ask_of_runs(
    data: Path,
    question: Question | LimitsQuestion,
    where: Where,
    means: Means,
    told: Told = lambda _done, _of: None,
) -> Reevaluated:
    """Ask a question of every run that fits, and note each answer in the ledger before the next.

    told: hears of the runs that are done and of how many there are.

    Raises:
        StationError: the runs, the archive or the cluster cannot be reached, or another process asks the same.

    """
    if isinstance(question, LimitsQuestion):
        if means.cluster is not None or means.from_archive:
            raise ReevaluationError("--limits reads the stored results only; leave out --cluster and --archive")
        answers = limits_outcomes(data, question, where)
        return _ask(data, question.text, answers.hash, lambda _: _answered(answers), told)

    def asked(found: Reevaluated) -> tuple[list[Job], Evaluating]:
        return _asked(data, question, where, means, found)

    return _ask(data, question.text, question.hash, asked, told)


def ask_of_jobs(data: Path, question: Question, wanted: Wanted, workers: int, told: Told) -> Reevaluated:
    """Ask a question of some runs on this computer; workers: processes. Otherwise as `ask_of_runs`."""

    def asked(found: Reevaluated) -> tuple[list[Job], Evaluating]:
        found.failed |= wanted.unreadable
        return wanted.jobs, lambda jobs: evaluate_here(jobs, question, workers, found.count_death)

    return _ask(data, question.text, question.hash, asked, told)


Asking = Callable[[Reevaluated], "tuple[list[Job], Evaluating]"]


def _ask(data: Path, text: str, question: str, asked: Asking, told: Told) -> Reevaluated:
    """Evaluate the jobs that have no line in the ledger of a question yet; text: the question, and then its hash."""
    begun = time.monotonic()
    found = Reevaluated(text, question, software_key(), data)
    with open_ledger(data, question, text) as ledger:
        found.ledger = ledger.path
        jobs, evaluated = asked(found)
        todo = [job for job in jobs if not ledger.has(job, found.software)]
        found.known = len(jobs) - len(todo)
        done = found.known
        told(done, len(jobs))
        for job, outcome in evaluated(todo):
            found.processor_s += outcome.processor_s
            error = outcome.error or _other_software(outcome, found.software)
            if error:
                found.failed[job.run] = error
            else:
                ledger.add(job, outcome)
            done += 1
            told(done, len(jobs))
        lines = {line.run: line for (_, software), line in ledger.lines.items() if software == found.software}
        found.lines = [lines[job.run] for job in jobs if job.run in lines]
        found.digest, found.twice = ledger.digest(), ledger.twice
    found.seconds = time.monotonic() - begun
    return found


def _other_software(outcome: Outcome, software: str) -> str:
    if outcome.software == software:
        return ""
    return (
        f"the run was evaluated by version {outcome.software}; this computer has version {software}. Install the same "
        "version on every computer"
    )


Evaluating = Callable[[list[Job]], Iterator[Evaluated]]


def _answered(answers: LimitsAnswers) -> tuple[list[Job], Evaluating]:
    outcomes = {job.run: outcome for job, outcome in answers.outcomes}
    return [job for job, _ in answers.outcomes], lambda jobs: ((job, outcomes[job.run]) for job in jobs)


def _asked(
    data: Path, question: Question, where: Where, means: Means, found: Reevaluated
) -> tuple[list[Job], Evaluating]:
    """Return the jobs of a question, and what evaluates those that are left."""
    far = means.cluster is not None
    if far and means.archive is None:
        raise ReevaluationError(
            "--cluster needs an archive, because its computers read the runs there. Write archive.yaml, and "
            "run 'lostmotion archive push'"
        )
    whole = question.whole_record
    wanted = jobs_of(data, where, means.archive, whole_record=whole, from_archive=means.from_archive or far)
    found.failed |= wanted.unreadable
    if means.cluster is not None:
        address = means.cluster
        died = found.count_death
        return wanted.jobs, lambda jobs: evaluate_on(address, jobs, question, means.workers, died) if jobs else iter(())
    return wanted.jobs, lambda jobs: evaluate_here(jobs, question, means.workers, found.count_death)
