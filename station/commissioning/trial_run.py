"""A small run for a step that needs torque: a recipe of its own, by the ordinary scan with all of its interlocks.

The recipe is made of the one that is named, for unit, lock, zeroes and limits are its own: what differs is the
sequence. So nothing moves that has not proven its lock, and there is no second way to bring torque onto a unit. The
record lies in a folder of its own, where no statistics of products look.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from definitions.faults import FAULT_BY_ID
from recipes import find_recipe, parse_bench, read_bytes
from station.bench.request import Job, Source, load_job
from station.commissioning.on_wires import OnWires
from station.documents.result import Result
from station.errors import BenchFaultError
from station.records.run_record import RunRecord
from station.records.samples.check import sound_table
from station.records.samples.samples import samples_bytes
from station.records.samples.table import Table
from station.run.conclusion import conclude
from station.run.new_record import Wanted, new_record
from station.run.outcome import RunOutcome
from station.run.pacing import pacing_of
from station.run.supervisor import Supervisor

FOLDER = "commissioning"
"""Below the runs: where the records of these runs lie."""

SERIAL = "commissioning"


@dataclass(frozen=True)
class Tried:
    """A small run that was made: its job, its record, its result, and its scan records."""

    job: Job
    record: RunRecord
    result: Result
    table: Table

    @property
    def complete(self) -> bool:
        """Whether it came to its end."""
        return self.result.state == "complete"

    @property
    def why(self) -> str:
        """Why it did not come to its end, as the fault table says it; '' when it did."""
        if self.complete:
            return ""
        alarms = [(FAULT_BY_ID[alarm.id], alarm.detail) for alarm in self.result.alarms or ()]
        return (
            "; ".join(f"{one.text} ({one.id}{f', {said}' if said else ''})" for one, said in alarms)
            or self.result.state
        )


@dataclass(frozen=True)
class Plan:
    """What a small run does. `peak`: torque of its steps, of rated torque; `rate_nm_s`: of its ramps at the output.

    proof: torque that verifies the lock, of rated torque. gain_per_s: of the torque loop, None for the bench's.
    """

    step: str
    proof: float
    peak: float
    rate_nm_s: float
    dwell_s: float
    count: int = 1
    gain_per_s: float | None = None


def try_out(  # noqa: PLR0917 - a run, and who is told of it
    bench: OnWires, recipe: str, plan: Plan, data: Path, by: str | None, say: Callable[[str], None]
) -> Tried:
    """Make a small run on a bench and conclude it; a fault ends it as any run, and its records tell why.

    Raises:
        RecipeError: the recipe cannot run on this bench.
        BenchFaultError: the bench could not be opened; nothing has moved.
        RecordError: the disk takes no record.

    """
    job = trial_job(bench, recipe, plan)
    pacing = pacing_of(job)
    wanted = Wanted(SERIAL, None, None, by, pacing.clock)
    record = new_record(data / FOLDER, job, wanted, notes=[f"commissioning: {plan.step}"])
    with contextlib.closing(record.lock):
        try:
            outcome = Supervisor(job, record, _nothing, say, pacing=pacing).run(None, None)
        except BenchFaultError as error:
            record.samples.touch()
            conclude(record, job, RunOutcome.refused_by(record, error))
            raise
        result = conclude(record, job, outcome).result
    return Tried(job, record, result, sound_table(samples_bytes(record), record.layout()))


def _nothing(_record: bytes) -> None:
    """Show nothing: what counts is in the record."""


def trial_job(bench: OnWires, recipe: str, plan: Plan) -> Job:
    """Return recipe and bench of a small run, checked against each other; RecipeError with what speaks against it."""
    path = find_recipe(recipe)
    text = _changed(read_bytes(path), lambda document: _planned(document, plan))
    with tempfile.TemporaryDirectory(prefix="lostmotion-trial-") as folder:
        file = Path(folder) / f"{path.stem}-{plan.step}.yaml"
        file.write_bytes(text)
        job = load_job(str(file), str(bench.path))
    if plan.gain_per_s is None:
        return job
    content = _changed(job.bench_source.content, lambda document: _with_gain(document, plan.gain_per_s))
    tried = parse_bench(content, str(bench.path))
    return replace(job, bench=tried, bench_source=Source(bench.path, content))


Sections = dict[str, Any]
"""Sections of a recipe or bench file as YAML has them: few are replaced, the others pass as they were written."""


def _changed(content: bytes, change: Callable[[Sections], None]) -> bytes:
    document = YAML(typ="safe").load(content)
    change(document)
    text = io.BytesIO()
    YAML(typ="safe").dump(document, text)
    return text.getvalue()


def _with_gain(document: Sections, gain_per_s: float | None) -> None:
    document["torque_control"] = {**(document.get("torque_control") or {}), "gain": gain_per_s}


def _planned(document: Sections, plan: Plan) -> None:
    """Put the sequence of a plan into a recipe, with its own home, lock, unloading and release."""
    document["recipe"] = {**document["recipe"], "name": f"bench-{plan.step}"}
    document["measurement"] = {"output_torque": "reaction", "reference_torque": _percent(plan.peak)}
    steps: Sequence[Mapping[str, Sections]] = document["sequence"]
    own = {name: options for step in steps for name, options in step.items()}
    lock = {**own["lock"], "proof_torque": _percent(plan.proof)}
    cycle = {
        "count": plan.count,
        "peak_torque": _percent(plan.peak),
        "torque_rate": f"{plan.rate_nm_s:g} N·m/s",
        "dwell": f"{plan.dwell_s:g} s",
    }
    document["sequence"] = [
        {"home": own["home"]},
        {"lock": lock},
        {"torque_cycles": cycle},
        {"unload": own["unload"]},
        {"release": own["release"]},
    ]
    document["metrics"] = [{"id": "windup"}]
    for section in ("presets", "report"):
        document.pop(section, None)


def _percent(share: float) -> str:
    return f"{100.0 * share:g} %"
