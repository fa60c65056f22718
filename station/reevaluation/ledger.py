"""The ledger of a question: a line for each run that was evaluated, in `reevaluations/` of the data folder.

A line is known by the SHA-256 of the run's run.json, the hash of the question and the software that evaluated it. What
has its line is not evaluated again; so who is killed goes on where the ledger ends. A stored verdict is never touched:
these stand beside it. Times and places are not in it, so that the ledgers of one computer and of a cluster are equal.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

from station.atomic_file import append_line, refused
from station.documents.entries import plain
from station.documents.reading import whole_lines
from station.reevaluation.evaluate_one import Job, MetricOutcome, Outcome
from station.reevaluation.question import ReevaluationError

FOLDER = "reevaluations"
NAME_DIGITS = 16


@dataclass(frozen=True, kw_only=True)
class LedgerLine:
    """A run that was evaluated: its own verdict, and what it is by the question."""

    run: str
    serial: str
    sha256: str
    question: str
    software: str
    before: str
    after: str
    reasons: tuple[str, ...] = ()
    metrics: tuple[MetricOutcome, ...] = ()

    @property
    def flips(self) -> bool:
        """Whether the verdict would be another one; metrics without a limit, asked for alone, decide none."""
        return self.before != self.after and (not self.metrics or any(one.limited for one in self.metrics))


class Key(NamedTuple):
    """What a line is known by, beside the question that the whole ledger is of."""

    sha256: str
    software: str


class Ledger:
    """The ledger of one question, open to add to it."""

    def __init__(self, path: Path, question: str) -> None:
        self.path = path
        self._question = question
        self.lines: dict[Key, LedgerLine] = {}
        self.twice = 0
        """Lines that say again what another one says."""
        for line in whole_lines(LedgerLine, path):
            key = Key(line.sha256, line.software)
            self.twice += key in self.lines
            self.lines[key] = line

    def has(self, job: Job, software: str) -> bool:
        """Whether a run has its line by this software."""
        return Key(job.sha256, software) in self.lines

    def add(self, job: Job, outcome: Outcome) -> LedgerLine:
        """Add a line durably.

        Raises:
            RecordError: the file cannot be written.

        """
        line = LedgerLine(
            run=job.run,
            serial=job.serial,
            sha256=job.sha256,
            question=self._question,
            software=outcome.software,
            before=job.verdict,
            after=outcome.verdict,
            reasons=outcome.reasons,
            metrics=outcome.metrics,
        )
        append_line(self.path, _as_text(line).encode())
        self.lines[Key(line.sha256, line.software)] = line
        return line

    def digest(self) -> str:
        """Return the SHA-256 over all lines, in whatever order they came."""
        return hashlib.sha256("\n".join(sorted(_as_text(line) for line in self.lines.values())).encode()).hexdigest()


@contextmanager
def open_ledger(data: Path, question: str, text: str) -> Iterator[Ledger]:
    """Yield the ledger of a question; text: the question for a person, which stands beside it.

    Raises:
        ReevaluationError: another process is evaluating the same question.
        RecordError: the folder cannot be written.

    """
    path = data / FOLDER / f"{question[:NAME_DIGITS]}.jsonl"
    try:
        path.parent.mkdir(exist_ok=True)
        path.with_suffix(".txt").write_text(f"{text}\n{question}\n", encoding="utf-8")
        handle = os.open(path.with_suffix(".lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise refused(path, error) from error
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ReevaluationError(
                f"{path}: another process is doing the same re-evaluation. Wait until it ends"
            ) from None
        yield Ledger(path, question)
    finally:
        os.close(handle)


def _as_text(line: LedgerLine) -> str:
    return json.dumps(plain(asdict(line)), ensure_ascii=False, separators=(",", ":"))
