"""`lostmotion profile compare`: the drive of a bench against its profile, without writing or starting anything."""

from __future__ import annotations

import json

import typer

from definitions.protections import missing_text
from drivers.can.bus import open_can
from drivers.can.other_controller import refuse_other_controller
from drivers.errors import DriverError
from drivers.servo_drive.comparison import Compared, compare_drive
from drivers.servo_drive.objects import missing_protections
from recipes import find_bench, load_bench
from station.bench.assemble import can_config, drive_config, drive_profile
from station.bench.bench_lock import alone_on
from station.bench.files import FileAt
from station.bench.request import find_profile
from station.errors import BenchFaultError, StationError

PERIOD_NS = 1_000_000
"""Scan period whose objects are compared: the one of the shipped recipes."""

EXIT_DIFFERENT = 1
SET_UP_REFUSES = ("refused", "no answer")


def compare(bench_name: str, *, as_json: bool) -> int:
    """Print what every object of the set-up holds; 1 when the set-up would refuse the drive.

    Raises:
        RecipeError: bench file or profile have problems.
        StationError: the bench is the embedded virtual one, which is there only while a run uses it.
        BenchBusyError: another process controls the bench.
        BenchFaultError: the bus cannot be opened, or another controller is on it.

    """
    path = find_bench(bench_name)
    bench = load_bench(path)
    if bench.bench.embedded:
        hint = "Start `lostmotion virtual-bench`, and name a bench file with its ports"
        raise StationError(f"{path}: the embedded virtual bench is there only while a run uses it. {hint}")
    profile = drive_profile(FileAt(find_profile(bench.drive.profile, path)))
    can, drive = can_config(bench), drive_config(bench, profile)
    with alone_on(bench.bench.name, can):
        try:
            link = open_can(can)
            try:
                refuse_other_controller(link, drive)
                compared = compare_drive(link, drive, PERIOD_NS)
            finally:
                link.close()
        except DriverError as error:
            raise BenchFaultError(str(error)) from error
    missing = [missing_text(one) for one in missing_protections(profile)]
    if as_json:
        rows = [one._asdict() for one in compared]
        typer.echo(
            json.dumps({"profile": profile.profile.name, "objects": rows, "missing": missing}, ensure_ascii=False)
        )
    else:
        _say(compared, missing)
    return EXIT_DIFFERENT if any(one.outcome in SET_UP_REFUSES for one in compared) else 0


def _say(compared: list[Compared], missing: list[str]) -> None:
    for one in compared:
        hint = f"; {one.next_step}" if one.next_step else ""
        typer.echo(f"{one.outcome:15} {one.place}  {one.meaning}: found {one.found}, wanted {one.wanted}{hint}")
    for text in missing:
        typer.echo(text)
    counts = {
        outcome: sum(one.outcome == outcome for one in compared)
        for outcome in dict.fromkeys(one.outcome for one in compared)
    }
    typer.echo(", ".join(f"{count} {outcome}" for outcome, count in counts.items()) + "; nothing was written")
