"""`lostmotion retention`: which records are over their days, and their removal, by the rules of the plant."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from station.archive.fetch import why_not_archived
from station.archive.identity import archive_of
from station.counted import counted
from station.documents.entries import plain
from station.errors import StationError
from station.records.backup import backed_up
from station.records.data_folder import check_operator
from station.records.run_record import RunRecord
from station.store.retention import ARCHIVE, BACKUP, Planned, apply, load_rules, plan
from station.wall_clock import WALL_CLOCK
from station.web.people import audit
from station.web.people.database import FILE, StationDatabase

EXIT_KEPT = 1


def plan_retention(data: Path, rules: Path | None, *, as_json: bool) -> int:
    """Print the runs whose days are over, and why some of them would stay; return 0.

    Raises:
        StationError, RecipeError: there are no rules, or they are wrong.

    """
    found = plan(data, load_rules(data, rules), WALL_CLOCK.now())
    if as_json:
        sys.stdout.write(json.dumps({"runs": plain(found)}, ensure_ascii=False) + "\n")
        return 0
    sys.stdout.writelines(f"{_line(one)}\n" for one in found)
    going = [one for one in found if not one.why_not]
    size = sum(one.bytes for one in going) / 1e6
    sys.stdout.write(f"{len(going)} of {len(found)} runs would be removed, {size:.1f} MB. Nothing was removed.\n")
    return 0


def apply_retention(data: Path, rules: Path | None, backup: Path | None, operator: str, *, as_json: bool) -> int:
    """Remove the runs whose days are over and that are in a backup, or in the archive; 0, or 1 where some of them stay.

    backup: None where no rule asks for one.

    Raises:
        StationError, RecipeError: there are no rules or no whole backup, no archive that a rule asks for, or the folder
            cannot be written.

    """
    person = check_operator(operator)
    planned = plan(data, load_rules(data, rules), WALL_CLOCK.now())
    asked = {one.kept_in for one in planned if not one.why_not}
    if BACKUP in asked and backup is None:
        raise StationError(
            "--backup is missing: a rule needs a copy of each run in a backup. Name the backup file, or write kept_in: "
            "archive into the rule"
        )
    place = archive_of(data) if ARCHIVE in asked else None

    def told(one: Planned) -> None:
        if not as_json:
            sys.stdout.write(_line(one) + "\n")
            sys.stdout.flush()

    def why_not(run: RunRecord) -> str:
        return "is not in the archive" if place is None else why_not_archived(data, place, run)

    done = apply(data, planned, {} if backup is None else backed_up(backup), person, told, why_not_archived=why_not)
    _audit(data, person, done.removed)
    if as_json:
        sys.stdout.write(json.dumps(plain(done), ensure_ascii=False) + "\n")
    else:
        sys.stdout.write(
            f"{counted(len(done.removed), 'run')} removed, {len(done.kept)} kept. See 'lostmotion verify'\n"
        )
    return EXIT_KEPT if done.kept else 0


def _audit(data: Path, person: str, removed: tuple[Planned, ...]) -> None:
    """Write a line for each run into the audit trail of the station, where one was served here."""
    if not removed or not (data / FILE).is_file():
        return
    database = StationDatabase(data)
    with database.writing() as connection:
        for one in removed:
            detail = {"run": one.run, "rule": one.rule, "then": one.then}
            audit.write(connection, person, "retention", audit.DONE, detail)
    database.close()


def _line(one: Planned) -> str:
    outcome = f"stays: {one.why_not}" if one.why_not else f"then {one.then}"
    return f"run {one.run} is {one.days} days old, rule '{one.rule}': {outcome}"
