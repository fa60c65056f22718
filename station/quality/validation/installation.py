"""Installation qualification: which software, computer, key, records, recipes and bench files these are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from recipes import find_bench
from station.bench.request import Source, find_profile
from station.counted import counted
from station.documents.validation import INSTALLATION, MET, OPEN, Evidence, judged
from station.records.chain.keys import own_public_key
from station.records.revisions.history import History
from station.records.revisions.revision import State
from station.records.verify import verify_folder
from station.scan.machine import look
from station.version import software

MOST_NAMED = 5
"""Problems that one line names."""


def installation(data: Path, bench: str | None) -> Iterator[Evidence]:
    """Yield the evidence; bench: its file or the name of a shipped one, None: none is looked at.

    Raises:
        RecipeError: bench file or a profile cannot be read.
        RecordError: the chain cannot be read.

    """
    yield from _software()
    yield from _computer()
    yield from _records(data)
    yield from _recipes(data)
    yield from _bench_files(bench)


def _of(asked: str, found: str, state: str, again: str) -> Evidence:
    return Evidence(part=INSTALLATION, asked=asked, found=found, state=state, again=again)


def some(problems: list[str]) -> str:
    """Return the first problems in words, with the number of the others."""
    more = len(problems) - MOST_NAMED
    return "; ".join(problems[:MOST_NAMED]) + (f"; and {more} more" if more > 0 else "")


def _software() -> Iterator[Evidence]:
    found = software()
    changed = "; files were changed since the commit" if found.changed else ""
    commit = "" if found.commit is None else f", commit {found.commit}"
    yield _of(
        "The software is one version, and unchanged",
        f"lostmotion {found.version}{commit}{changed}",
        judged(not found.changed),
        "lostmotion --version",
    )
    yield _of(
        "Its files have this SHA-256", found.files_sha256 or "unknown", judged(bool(found.files_sha256)), "run.json"
    )
    versions = dict(found.dependencies or {})
    yield _of(
        "Libraries that a measurement or a decision goes through are installed",
        ", ".join(f"{name} {version or 'missing'}" for name, version in versions.items()),
        judged(all(versions.values())),
        "pip list",
    )
    yield _of("It runs on", f"Python {found.python}, {found.platform}, computer {found.host}", MET, "run.json")


def _computer() -> Iterator[Evidence]:
    in_the_way = [f"{one.name}: {one.found}" for one in look() if not one.in_order]
    yield _of(
        "Nothing on this computer makes a scan late",
        some(in_the_way) or "nothing stands in the way",
        judged(not in_the_way),
        "lostmotion doctor",
    )
    key = own_public_key()
    yield _of(
        "This computer signs what it measures",
        "no key yet: it is made with the first run" if key is None else f"public key {key}",
        OPEN if key is None else MET,
        "lostmotion key",
    )


def _records(data: Path) -> Iterator[Evidence]:
    found = verify_folder(data)
    problems = [one.text for one in found.problems]
    counts = f"{counted(found.runs, 'run')}, {found.concluded} concluded, {found.removed} removed by rule"
    yield _of(
        "No run is missing or altered: chain, signatures, every file",
        f"{counts}: {some(problems)}" if problems else counts,
        OPEN if not found.runs and not problems else judged(not problems),
        f"lostmotion verify --data {data}",
    )


def _recipes(data: Path) -> Iterator[Evidence]:
    history = History(data)
    problems = [*history.problems, *history.text_problems()]
    yield _of(
        "The history of the recipes is complete and signed",
        some(problems) or counted(len(history.entries), "entry", "entries"),
        judged(not problems),
        f"lostmotion verify --data {data}",
    )
    for one in history.all():
        if one.state is State.RELEASED:
            yield _of(
                "Recipe released",
                f"{one.title} by {one.released_by}, SHA-256 {one.sha256}",
                MET,
                f"lostmotion recipes show {one.name} {one.revision} --data {data}",
            )


def _bench_files(bench: str | None) -> Iterator[Evidence]:
    if bench is None:
        yield _of("Bench file and device profiles", "none was named", OPEN, "--bench FILE")
        return
    source = Source.read(find_bench(bench))
    files = [source, *(Source.read(find_profile(name, source.path)) for name in source.bench().profile_names)]
    for one in files:
        yield _of(
            "Bench file" if one is source else "Device profile",
            f"{one.path.name}, SHA-256 {one.sha256}",
            MET,
            f"sha256sum {one.path}",
        )
