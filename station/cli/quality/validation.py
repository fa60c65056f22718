"""`lostmotion quality validation`: fills a validation pack from this installation, or checks one."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from analysis.trace.errors import AnalysisError
from station.cli.line.gage import judged_study
from station.cli.line.stored_metric import Ask
from station.cli.out_file import refuse_records, writing
from station.counted import counted
from station.documents.entries import plain
from station.documents.validation import INSTALLATION, MET, NOT_MET, OPEN, Evidence
from station.errors import StationError
from station.own_program import own_module
from station.quality.validation.installation import installation, some
from station.quality.validation.operation import SELF_TEST, SELF_TEST_RECIPE, SelfTest, operation
from station.quality.validation.pack import (
    PAGE,
    attachments,
    check_pack,
    counts,
    fulfilled,
    pack_of,
    write_pack,
)
from station.quality.validation.performance import GageFigure, KnownPart, performance
from station.store.quality.lot import Lot, production
from station.version import ROOT
from station.web.people import audit
from station.web.people.database import FILE, StationDatabase

EXIT_MISSING = 1
VERDICTS = {0: "PASS", 1: "FAIL", 3: "NOT DECIDABLE"}
"""Exit codes of `lostmotion run`."""

LONGEST_S = 600.0
"""Seconds that one unit of the self-test may take on a busy computer."""


@dataclass(frozen=True)
class Wanted:
    """What a command line asks for; gages: metrics of gage studies, and what stands for the operator there."""

    bench: str | None
    tests: tuple[Path, ...]
    evidence: tuple[Path, ...]
    parts: tuple[KnownPart, ...]
    gages: tuple[str, ...]
    by: str
    lot: Lot
    self_test: bool


def make(data: Path, out: Path, wanted: Wanted, *, as_json: bool) -> int:
    """Fill a pack and write it; 0 when everything is met, 1 when something is not met or open.

    Raises:
        StationError, RecipeError: no such folder or file, or a folder that has files already.

    """
    if not data.is_dir():
        raise StationError(f"--data {data}: there is no such folder; name the one that 'lostmotion run' wrote to")
    refuse_records(out / PAGE)
    files = attachments(ROOT / "docs", wanted.evidence)
    tests = tuple(_self_test()) if wanted.self_test else ()
    gages = [_gage(data, one, wanted) for one in wanted.gages]
    evidence = (
        *installation(data, wanted.bench),
        *_audit(data),
        *operation(wanted.bench, wanted.tests, tests),
        *performance(data, wanted.bench, wanted.lot, wanted.parts, gages, wanted.by),
    )
    pack = pack_of(data, wanted.bench, evidence, files)
    with writing(out):
        written = write_pack(pack, files, out)
    if as_json:
        document = {"files": [str(one) for one in written], "counts": counts(pack), "pack": plain(pack)}
        sys.stdout.write(json.dumps(document, ensure_ascii=False) + "\n")
    else:
        missing = [one for one in pack.evidence if one.state in {NOT_MET, OPEN}]
        lines = [f"{one.state + ':':9}{one.asked}\n         {one.found}" for one in missing]
        lines += [", ".join(f"{number} {state}" for state, number in counts(pack).items()), str(out / PAGE)]
        sys.stdout.write("".join(f"{line}\n" for line in lines))
    return 0 if fulfilled(pack) else EXIT_MISSING


def check(folder: Path, *, as_json: bool) -> int:
    """Say whether a pack is as it was made; 0 it is, and by a key that this computer knows, else 1.

    Raises:
        StationError, RecordError: there is no pack, or its list cannot be read.

    """
    found = check_pack(folder)
    passed = found.known and not found.problems
    if as_json:
        document = {"made": found.files.made, "software": found.files.software, "key": found.key}
        document |= {"known": found.known, "problems": found.problems, "passed": passed}  # type: ignore[dict-item]
        sys.stdout.write(json.dumps(document, ensure_ascii=False) + "\n")
    else:
        trust = (
            "" if found.known else ", WHICH THIS COMPUTER DOES NOT KNOW: compare it, then lostmotion key --trust KEY"
        )
        head = (
            f"{counted(len(found.files.files), 'file')}, made {found.files.made} by lostmotion {found.files.software}"
        )
        lines = [head, f"signed by {found.key}{trust}", *found.problems, "passed" if passed else "NOT PASSED"]
        sys.stdout.write("".join(f"{line}\n" for line in lines))
    return 0 if passed else EXIT_MISSING


def _audit(data: Path) -> Iterator[Evidence]:
    """Yield whether the station's audit trail is as it was written."""
    asked, again = "The audit trail is as it was written", f"lostmotion audit verify --data {data}"
    found, state = "no station was served in this folder", OPEN
    if (data / FILE).is_file():
        with closing(StationDatabase(data)) as database, database.reading() as connection:
            head, problems = audit.head_of(connection), audit.problems_of(connection)
        found = f"{counted(head.lines, 'line')}, head {head.head_sha256}" + (f": {some(problems)}" if problems else "")
        state = NOT_MET if problems else MET
    yield Evidence(part=INSTALLATION, asked=asked, found=found, state=state, again=again)


def _gage(data: Path, metric: str, wanted: Wanted) -> GageFigure | str:
    """Return a gage study of the stored runs, or why there is none."""
    lot = wanted.lot
    try:
        with production(data) as look:
            runs, others = look.measured(lot), look.measured(lot._replace(virtual=not lot.virtual))
        if not runs:
            return f"{metric}: {_no_run(lot, len(others))}"
        study = judged_study(data, Ask(metric, recipe=lot.recipe), wanted.by, runs)
    except (StationError, AnalysisError) as error:
        return f"{metric}: {error}"
    design, found = study
    told = f"{len(design.parts)} parts, {len(design.operators)} by {wanted.by}, each {design.values.shape[2]} times"
    return GageFigure(metric, found.grr_pct.value, found.tolerance_pct, found.ndc, told)


def _no_run(lot: Lot, others: int) -> str:
    """Return that a lot has no run for a gage study, and that there are `others` of the other kind of unit."""
    kind, other, do = ("virtual", "real", "leave out") if lot.virtual else ("real", "virtual", "add")
    hint = f" There are {counted(others, 'run')} of {other} units: {do} --virtual" if others else " Choose another lot"
    return f"the chosen lot has no run of a {kind} unit.{hint}"


def _self_test() -> Iterator[SelfTest]:
    """Measure the units of known verdict by this installation, each in a folder that is removed, and replay each."""
    with tempfile.TemporaryDirectory() as kept:
        for unit, expected in SELF_TEST:
            sys.stderr.write(f"measuring the virtual unit {unit}\n")
            place = ("--data", kept, "--json")
            run = (
                "run",
                SELF_TEST_RECIPE,
                "--serial",
                unit,
                "--unit",
                unit,
                "--seed",
                "1",
                "--virtual-time",
                "--no-report",
            )
            verdict = VERDICTS.get(_own_command(*run, *place), "no verdict")
            yield SelfTest(unit, expected, verdict, _own_command("replay", unit, *place) == 0)


def _own_command(*words: str) -> int:
    """Return the exit code of a command of this program."""
    return subprocess.run(  # noqa: S603 - this program itself
        own_module("station", *words), capture_output=True, timeout=LONGEST_S, check=False
    ).returncode
