"""Jobs on the cores of this computer: a process for each, and another one in the place of one that died.

A process has one job at a time. The job of one that died is given to another; a job whose processes died three times
is left out, and says so.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any

from station.reevaluation.evaluate_one import Job, Outcome, evaluate_one
from station.reevaluation.question import Question

MOST_DEATHS = 3
NICE = 10
"""A bench that measures on this computer comes first."""

Evaluated = tuple[Job, Outcome]


def evaluate_here(
    jobs: Sequence[Job], question: Question, count: int, died: Callable[[Job], None] = lambda _: None
) -> Iterator[Evaluated]:
    """Yield each job with its outcome, in the order in which they end.

    count: processes. died: hears of a job whose process died.
    """
    waiting, deaths = deque(jobs), Counter[str]()
    workers = [_Worker(question) for _ in range(min(count, len(jobs)))]
    try:
        while waiting or any(one.job for one in workers):
            for one in workers:
                if one.job is None and waiting:
                    one.give(waiting.popleft())
            busy = [one for one in workers if one.job is not None]
            ready = set(wait([one.connection for one in busy]))
            for one in busy:
                if one.connection not in ready:
                    continue
                job, outcome = one.taken()
                if outcome is not None:
                    yield job, outcome
                    continue
                workers[workers.index(one)] = _Worker(question)
                deaths[job.run] += 1
                died(job)
                if deaths[job.run] < MOST_DEATHS:
                    waiting.appendleft(job)
                else:
                    yield job, Outcome(job.run, error=f"its process ended {MOST_DEATHS} times without an answer")
    finally:
        for one in workers:
            one.end()


class _Worker:
    """A process that evaluates, and the job that it has."""

    def __init__(self, question: Question) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["station.reevaluation.forked"])
        self.connection, theirs = context.Pipe()
        self._process: Any = context.Process(target=_serve, args=(theirs, question), daemon=True)
        self._process.start()
        theirs.close()  # so that the end of the process is the end of the line
        self.job: Job | None = None

    def give(self, job: Job) -> None:
        """Give the process a job; one that has died is told when its answer is taken."""
        self.job = job
        with suppress(OSError):
            self.connection.send(job)

    def taken(self) -> tuple[Job, Outcome | None]:
        """Return the job and its outcome; None where the process died."""
        job, self.job = self.job, None
        assert job is not None  # noqa: S101 - only a worker with a job is asked
        try:
            return job, self.connection.recv()
        except (EOFError, OSError):
            self.end()
            return job, None

    def end(self) -> None:
        """End the process."""
        self.connection.close()
        self._process.terminate()
        self._process.join()


def _serve(connection: Connection, question: Question) -> None:
    """Evaluate what comes until nothing does; Ctrl-C is for the process that asks."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICE)
    with suppress(EOFError, OSError):
        while True:
            connection.send(evaluate_one(connection.recv(), question))
