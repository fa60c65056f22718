"""The manifest of a run, `run.json`: who measured what, on which bench, by which software, and how far the run came."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime
from typing import Annotated

from pydantic import AfterValidator, Field

from definitions.number_formats import LARGEST, LARGEST_COUNT
from station.documents.entries import Count, Number, left_out, one_of, whole_number

MANIFEST = "run.json"
RECORDING = "recording"
INTERRUPTED = "interrupted"
STATES = (RECORDING, "complete", "stopped", "fault", INTERRUPTED)
VERDICTS = ("PASS", "FAIL", "NOT DECIDABLE")
CLOCK_NAMES = ("wall", "scan", "virtual", "real")
"""Names that a record may give its clock: those of `station.records.clocks`, and what the first one was called once."""

LARGEST_PERIOD_NS = 1_000_000_000
LARGEST_PID = 1 << 22


SIMULATED, INJECTED = "simulated", "faults injected"
"""Why an attempt says nothing of a real unit: nothing real was measured, or faults were injected on purpose."""

MASTER = "master part "
"""How the notes begin that say what the master parts of a bench read."""


def _filled(text: str) -> str:
    if not text.strip():
        raise ValueError(text)
    return text


def _path(text: str) -> str:
    if not text or "\0" in text:
        raise ValueError(text)
    return text


def _moment(text: str) -> str:
    moment = datetime.fromisoformat(text)
    if moment.tzinfo is None or date.fromisoformat(text[:10]) != moment.date():
        raise ValueError(text)
    return text


Name = Annotated[str, AfterValidator(_filled), Field(description="a text that is not empty")]
PathText = Annotated[str, AfterValidator(_path), Field(description="a path")]
Moment = Annotated[
    str,
    AfterValidator(_moment),
    Field(description="a moment with its time zone, as 2026-01-05T08:00:00.000+00:00"),
]
RunState = Annotated[str, one_of(*STATES)]
VerdictName = Annotated[str, one_of(*VERDICTS)]
ClockName = Annotated[str, one_of(*CLOCK_NAMES)]
CountFrom1 = Annotated[int, whole_number(1, LARGEST_COUNT)]
Large = Annotated[int, whole_number(0, LARGEST)]
Finite = Annotated[Number, Field(allow_inf_nan=False, description="a number")]
ProcessId = Annotated[int, whole_number(0, LARGEST_PID)]
Period = Annotated[int, whole_number(1, LARGEST_PERIOD_NS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecipeHead:
    """A recipe by name, revision and the SHA-256 of its file."""

    name: Name
    revision: Count
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RecipeSource(RecipeHead):
    """A recipe as a run was started with it; `file` is where it was read from."""

    file: str | None = left_out()

    @property
    def head(self) -> RecipeHead:
        """Without its place."""
        return RecipeHead(name=self.name, revision=self.revision, sha256=self.sha256)


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchSource:
    """A bench file; `embedded`: the virtual bench; `public_key`: that of its computer, where the file names one.

    `fixture`: name of the fixture, where the file gives one.
    """

    name: Name
    revision: Count
    sha256: str
    file: str | None = left_out()
    embedded: bool
    public_key: str | None = None
    fixture: str | None = left_out()


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """The unit under test; on the virtual bench with its name there and the seed of the noise.

    `master`: of a master part, the verdict that a sound bench gives it.
    """

    model: Name
    virtual: str | None = None
    noise_seed: Large | None = None
    master: VerdictName | None = left_out()


@dataclass(frozen=True, slots=True, kw_only=True)
class Software:
    """What made a run, and on which computer. Versions before some of it was kept say name and version."""

    name: str
    version: str
    commit: str | None = None
    changed: bool | None = None
    files_sha256: str | None = None
    decisions: Count | None = None
    dependencies: Mapping[str, str | None] = field(default_factory=dict)
    python: str = ""
    platform: str = ""
    host: str | None = None
    user: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainPlace:
    """The entry of the chain that begins a run: id of the chain, its counter, hash of the entry before it."""

    id: str
    counter: Count
    previous: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningProcess:
    """The supervisor process or the scan process of a run: its id, and its start in ticks of the kernel.

    The start tells it from a later process that got the same id.
    """

    pid: ProcessId
    birth: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Checksum:
    """SHA-256 and size of a file."""

    sha256: str
    bytes: Large


@dataclass(frozen=True, slots=True, kw_only=True)
class PackedSamples:
    """The packed samples of a concluded run, with SHA-256 and size of the records as they were before."""

    file: PathText
    sha256: str
    bytes: Large


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftBy:
    """How the bench was left before a recovery: number of its fault, zeroes of the torque sensors.

    `zeroes_of`: the earlier run of the bench that took the zeroes, where the last one did not. `zeroes_unknown`: true
    where none did.
    """

    fault: Count
    torque_in_tare_nm: Finite
    torque_out_tare_nm: Finite
    zeroes_of: str | None = left_out()
    zeroes_unknown: bool | None = left_out()


@dataclass(frozen=True, slots=True, kw_only=True)
class EarlierAttempt:
    """A run of the same serial number before this one; `failed`: titles of the metrics out of their limits.

    `aside`: why it is no attempt at a real unit. It keeps its number: the numbers are those of the chain.
    """

    attempt: CountFrom1
    run: Name
    state: RunState
    verdict: VerdictName | None
    failed: tuple[str, ...] = ()
    aside: Annotated[str, one_of(SIMULATED, INJECTED)] | None = left_out()

    def __str__(self) -> str:
        outcome = " ".join(word for word in (self.aside, self.verdict or self.state) if word)
        return f"attempt {self.attempt} {outcome}{' ' if self.failed else ''}{', '.join(self.failed)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyPlace:
    """A step of a guided study that a run measures: name of the study, hash of its plan's line, step of how many."""

    name: Name
    plan: str
    step: CountFrom1
    steps: CountFrom1

    def __str__(self) -> str:
        return f"study {self.name}, step {self.step} of {self.steps}"


def attempt_text(attempt: int | None, before: Sequence[EarlierAttempt] | None, reason: str | None) -> str:
    """Return which attempt a run is, what became of those before it, and why the unit was measured again."""
    told = "".join(f"; {one}" for one in before or ())
    return f"attempt {attempt or 1}{told}{f'; measured again: {reason}' if reason else ''}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """What is known of a run before it has a place in a data folder."""

    recipe: RecipeSource
    bench: BenchSource
    software: Software
    unit: Unit
    scenario: str | None = None
    operator: str | None = None
    retest_reason: str | None = None
    clock: ClockName
    period_ns: Period
    recovery_of: Name | None = None
    left: LeftBy | None = None
    study: StudyPlace | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """The manifest of a run. `files`, `records` and `samples` are there when it is concluded.

    `before`: the attempts before it, the newest of many; `retest_reason`: why the unit was measured again.
    `study`: step of a guided study that it measures; such a run is no production.
    `trouble`: why it has no result, or what became of its supervisor process. `ring`: where its records wait.
    """

    id: Name
    serial: Name
    attempt: CountFrom1
    state: RunState
    chain: ChainPlace | None = left_out()
    recipe: RecipeSource
    bench: BenchSource
    software: Software
    unit: Unit
    scenario: str | None = None
    operator: str | None = None
    retest_reason: str | None = left_out()
    before: tuple[EarlierAttempt, ...] | None = left_out()
    clock: ClockName
    period_ns: Period
    recovery_of: Name | None = left_out()
    left: LeftBy | None = left_out()
    study: StudyPlace | None = left_out()
    verdict: VerdictName | None
    notes: tuple[str, ...]
    ring: PathText | None
    started: Moment
    ended: str | None
    format: CountFrom1
    desk: RunningProcess
    trouble: str | None = left_out()
    records: Count | None = left_out()
    samples: PackedSamples | None = left_out()
    files: Mapping[PathText, Checksum] | None = left_out()
