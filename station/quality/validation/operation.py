"""Operational qualification: commissioning of the bench, the tests of the software, units whose verdict is known."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from drivers.servo_drive.objects import missing_protections
from recipes import find_bench, open_regular
from station.bench.assemble import drive_profile
from station.bench.commissioned import parts_of, protocol_path, read_protocol, standings
from station.bench.request import Source, find_profile
from station.documents.validation import MET, NOT_MET, OPEN, OPERATION, Evidence, judged
from station.errors import StationError
from station.quality.validation.installation import some

LARGEST_FILE = 64 << 20
"""Bytes of a file that a person names as evidence."""

COUNTS = ("tests", "failures", "errors", "skipped")

SELF_TEST = (("P1", "PASS"), ("worn", "FAIL"), ("soft", "FAIL"), ("tight", "FAIL"), ("cracked", "FAIL"))
"""Units of the virtual bench, and the verdict that each must get by the recipe of the line."""

SELF_TEST_RECIPE = "rv-40e-121-quick"


@dataclass(frozen=True, slots=True)
class SelfTest:
    """A unit of known verdict that was measured here and now: what it got, and whether the replay is the same bytes."""

    unit: str
    expected: str
    verdict: str
    replay: bool


def _of(asked: str, found: str, state: str, again: str) -> Evidence:
    return Evidence(part=OPERATION, asked=asked, found=found, state=state, again=again)


def operation(bench: str | None, test_reports: Iterable[Path], self_tests: Iterable[SelfTest]) -> Iterator[Evidence]:
    """Yield the evidence; self_tests: none where they were not asked for.

    Raises:
        RecipeError: bench file or a profile cannot be read.
        StationError: a report of tests cannot be read.

    """
    yield from _commissioning(bench)
    reports = tuple(test_reports)
    if not reports:
        again = "pytest --junitxml tests.xml, then --tests tests.xml"
        yield _of("The tests of the software pass on this computer", "no report was named", OPEN, again)
    for report in reports:
        yield report_of_tests(report)
    yield from _self_tests(tuple(self_tests))


def _commissioning(bench: str | None) -> Iterator[Evidence]:
    asked = "The bench was commissioned step by step, as it is now"
    if bench is None:
        yield _of(asked, "no bench was named", OPEN, "--bench FILE")
        return
    source = Source.read(find_bench(bench))
    loaded = source.bench()
    profiles = {name: Source.read(find_profile(name, source.path)) for name in loaded.profile_names}
    if loaded.bench.embedded:
        yield _of(asked, "a virtual bench, which the program starts: nothing to commission", OPEN, "--bench FILE")
        return
    for one in standings(read_protocol(source.path, loaded), parts_of(loaded, profiles)):
        done = "" if one.done is None else f" on {one.done.when} by {one.done.by}, version {one.done.software}"
        changes = some([f"{change.part} was {change.was}, is {change.now}" for change in one.changes])
        state = MET if one.state == "passed" else NOT_MET if one.state == "not passed" else OPEN
        found = f"{one.state}{done}" + (f"; changed since: {changes}" if changes else "")
        again = f"lostmotion bench {one.step.id} --bench {bench}"
        yield _of(f"{one.step.title}: {one.step.proves}", found, state, f"{again}; {protocol_path(source.path).name}")
    profile = drive_profile(profiles[loaded.drive.profile])
    yield _of(
        "A drive of this kind was run by this profile",
        "tried on hardware" if profile.tried_on_hardware else "not tried on hardware, as its profile says",
        MET if profile.tried_on_hardware else OPEN,
        "the profile's tried_on_hardware",
    )
    lacking = [f"{row.meaning} ({row.without})" for row in missing_protections(profile)]
    yield _of(
        "The drive has every protection that this program knows",
        f"it lacks: {some(lacking)}" if lacking else "none is lacking",
        judged(not lacking),
        f"lostmotion profile compare --bench {bench}",
    )


def report_of_tests(report: Path) -> Evidence:
    """Return what a report of tests says, a file as `pytest --junitxml` writes it.

    Raises:
        StationError: it cannot be read, or is no such file.

    """
    content = content_of(report, "--tests")
    try:
        root = ET.fromstring(content)  # noqa: S314 - expat itself ends documents that grow by their entities
        suites = [root] if root.tag == "testsuite" else [*root.iter("testsuite")]
        counts = {name: sum(int(one.get(name, "0")) for one in suites) for name in COUNTS}
    except (ET.ParseError, ValueError) as error:
        raise StationError(_no_report(report, str(error))) from error
    if not suites:
        raise StationError(_no_report(report, f"its outermost element is {root.tag:.40}"))
    when = next((one.get("timestamp", "") for one in suites if one.get("timestamp")), "")
    host = next((one.get("hostname", "") for one in suites if one.get("hostname")), "")
    failed = counts["failures"] + counts["errors"]
    told = f"{report.name}: {counts['tests']} tests, {failed} failed, {counts['skipped']} skipped"
    told += (f", {when}" if when else "") + (f" on {host}" if host else "")
    passed = counts["tests"] > counts["skipped"] and not failed
    sha256 = hashlib.sha256(content).hexdigest()
    asked = "The tests of the software pass on this computer"
    return _of(asked, f"{told}; SHA-256 {sha256}", judged(passed), "pytest --junitxml FILE")


def content_of(path: Path, option: str) -> bytes:
    """Return the bytes of a file that a person named; StationError where it cannot be read, or is too large."""
    try:
        with open_regular(path) as file:
            content = file.read(LARGEST_FILE + 1)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise StationError(f"{option} {path}: this file cannot be read: {why}. Name a readable file") from error
    if len(content) > LARGEST_FILE:
        raise StationError(
            f"{option} {path}: this file is too large: allowed are {LARGEST_FILE >> 20} MiB. Name a smaller file"
        )
    return content


def _no_report(report: Path, why: str) -> str:
    return f"--tests {report}: this is not a test report: {why}. Name a file that 'pytest --junitxml FILE' wrote"


def _self_tests(found: tuple[SelfTest, ...]) -> Iterator[Evidence]:
    asked = "Units of known verdict are judged rightly by this installation, on the virtual bench"
    if not found:
        yield _of(asked, "not done", OPEN, "--self-test")
    for one in found:
        rightly = one.verdict == one.expected and one.replay
        replay = "the controller's replay is the same, byte for byte" if one.replay else "its REPLAY DIFFERS"
        yield _of(
            f"Virtual unit {one.unit} gets {one.expected} by {SELF_TEST_RECIPE}",
            f"{one.verdict}; {replay}",
            judged(rightly),
            f"lostmotion run {SELF_TEST_RECIPE} --unit {one.unit} --virtual-time",
        )
