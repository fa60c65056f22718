"""`lostmotion profile`: profiles drafted from the EDS files of drives; a drive held against its profile."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import typer

from definitions.protections import missing_text
from drivers.can.bus import open_can
from drivers.can.other_controller import refuse_other_controller
from drivers.errors import DriverError
from drivers.servo_drive.comparison import Compared, compare_drive
from drivers.servo_drive.unused import missing_on
from recipes import RecipeError, find_bench
from station.atomic_file import write_atomic
from station.bench.assemble import can_config, drive_config, drive_profile
from station.bench.bench_lock import alone_on
from station.bench.eds_profile import ENDINGS, Draft, draft, eds_files
from station.bench.files import FileAt, load_named_bench
from station.bench.request import find_profile
from station.cli.out_file import refuse_records
from station.errors import BenchFaultError, StationError

EXIT_UNUSABLE = 1

PERIOD_NS = 1_000_000
"""Scan period whose objects are compared: the one of the shipped recipes."""

EXIT_DIFFERENT = 1
SET_UP_REFUSES = ("refused", "no answer")


def from_eds(place: Path, out: Path | None, *, as_json: bool) -> int:
    """Draft a profile for each EDS or DCF file; 1 when a drive cannot be used, or a file of a folder not be read.

    Raises:
        RecipeError: the one file that was named cannot be read.
        StationError: there is no such file, no EDS in the folder, or a draft cannot be written.

    """
    if out is not None:
        refuse_records(out / "profile.yaml")
    if not place.exists():
        raise StationError(f"{place}: there is no such file or folder. Check the path")
    files = eds_files(place)
    if not files:
        raise StationError(f"folder {place}: found no drive file ({' or '.join(ENDINGS)}). Choose another folder")
    drafts, unreadable = _drafts(files, place)
    _write(drafts, out)
    if as_json:
        rows = [asdict(one) | {"source": str(one.source)} for one in drafts]
        typer.echo(json.dumps({"drafts": rows, "unreadable": unreadable}, ensure_ascii=False))
    else:
        for one in drafts:
            _say_draft(one, out)
        for text in unreadable:
            typer.echo(f"# {text}")
        if len(files) > 1:
            usable = sum(not one.refused for one in drafts)
            typer.echo(
                f"# {len(files)} drive files: {usable} usable, {len(drafts) - usable} of drives that cannot be used, "
                f"{len(unreadable)} not readable"
            )
    return EXIT_UNUSABLE if unreadable or any(one.refused for one in drafts) else 0


def _drafts(files: list[Path], place: Path) -> tuple[list[Draft], list[str]]:
    """Draft a profile of each file that can be read; why the others cannot, unless the one was named itself."""
    drafts: list[Draft] = []
    unreadable: list[str] = []
    for file in files:
        try:
            drafts.append(draft(file))
        except RecipeError as error:
            if file == place:
                raise
            unreadable.append(str(error))
    return drafts, unreadable


def _write(drafts: list[Draft], out: Path | None) -> None:
    if out is None:
        return
    taken: dict[str, Path] = {}
    for one in drafts:
        other = taken.setdefault(one.name, one.source)
        path = out / f"{one.name}.yaml"
        if other != one.source:
            raise StationError(
                f"the drafts of {other} and {one.source} would both be written to {path}. Rename one of the two drive "
                "files"
            )
        if path.exists():
            raise StationError(
                f"file {path} exists already and is not overwritten. Move it, or choose another folder with --out"
            )
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StationError(f"{out}: {error.strerror or error}") from error
    for one in drafts:
        write_atomic(out / f"{one.name}.yaml", one.text.encode())


def _say_draft(one: Draft, out: Path | None) -> None:
    if out is None:
        typer.echo(f"---  # {one.source}\n{one.text}")
    else:
        typer.echo(f"{one.source}: drafted {out / one.name}.yaml")
    for heading, texts in (
        ("cannot be used", one.refused),
        ("this drive lacks", one.lacks),
        ("to check", one.open_places),
    ):
        for text in texts:
            typer.echo(f"# {heading}: {text}")


def compare(bench_name: str, *, as_json: bool) -> int:
    """Print what every object of the set-up holds; 1 when the set-up would refuse the drive.

    Raises:
        RecipeError: bench file or profile have problems.
        StationError: the bench is the embedded virtual one, which is there only while a run uses it.
        BenchBusyError: another process controls the bench.
        BenchFaultError: the bus cannot be opened, or another controller is on it.

    """
    path = find_bench(bench_name)
    bench = load_named_bench(path)
    if bench.bench.embedded:
        raise StationError(
            f"{path}: the embedded virtual bench exists only during a run. Start `lostmotion virtual-bench`, and name "
            "a bench file with its ports"
        )
    profile = drive_profile(FileAt(find_profile(bench.drive.profile, path)))
    can, drive = can_config(bench), drive_config(bench, profile)
    with alone_on(bench.bench.name, can):
        try:
            link = open_can(can)
            try:
                refuse_other_controller(link, drive)
                compared = compare_drive(link, drive, PERIOD_NS)
                answers = not any(one.outcome == "no answer" for one in compared)
                left_out = missing_on(link, drive) if answers else []
            finally:
                link.close()
        except DriverError as error:
            raise BenchFaultError(str(error)) from error
    missing = [missing_text(one.protection) for one in left_out]
    missing += [f"{one.what} {one.cure(profile.profile.name)}" for one in left_out if one.there]
    if as_json:
        rows = [one._asdict() for one in compared]
        typer.echo(
            json.dumps({"profile": profile.profile.name, "objects": rows, "missing": missing}, ensure_ascii=False)
        )
    else:
        _say_compared(compared, missing)
    return EXIT_DIFFERENT if any(one.outcome in SET_UP_REFUSES for one in compared) else 0


def _say_compared(compared: list[Compared], missing: list[str]) -> None:
    for one in compared:
        hint = f"; {one.next_step}" if one.next_step else ""
        typer.echo(
            f"{one.outcome:15} object {one.place}  {one.meaning}: found {one.found}, expected {one.wanted}{hint}"
        )
    for text in missing:
        typer.echo(text)
    counts = {
        outcome: sum(one.outcome == outcome for one in compared)
        for outcome in dict.fromkeys(one.outcome for one in compared)
    }
    told = ", ".join(f"{count} {outcome}" for outcome, count in counts.items())
    typer.echo(f"Objects of the drive: {told}. Nothing was written to the drive.")
