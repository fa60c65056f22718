"""Where runs are kept: one folder per run, named by moment and serial number, and how a run is found again.

The run id sorts by time, also where the computer's clock was set back between two runs. Several runs of one serial
number are attempts 1, 2, 3 ...; the numbers come from the folder's chain, which a deleted run does not shorten.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import unicodedata
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from itertools import islice
from operator import itemgetter
from pathlib import Path

from definitions.number_formats import LARGEST_COUNT
from station.atomic_file import seen_text, sync_folder
from station.documents.entries import plain
from station.documents.manifest import EarlierAttempt, Manifest, Setup
from station.errors import RecordError, StationError
from station.records.archive_note import only_archived
from station.records.attempts import earlier_attempts
from station.records.begun_by import beginning_of, begun_and_left, begun_text, concluded_and_lost, is_begun_with
from station.records.chain.chain_file import CHAIN, CREATED_MANIFEST, Chain, put_created_in_place
from station.records.chain.entries import CREATED, Entry
from station.records.chain.lookup import last_attempt
from station.records.chain.missing import is_data_folder, stands_alone
from station.records.chain.writing import writing_to
from station.records.folder_check import about_concluded, is_from_here, runs_before
from station.records.run_folders import STAMP, is_run, is_text, moment_of, runs_there
from station.records.run_record import MANIFEST, RECORDING, RunRecord, running_process
from station.records.samples.layout import CURRENT, LAYOUT
from station.records.seal import RESTORE
from station.there import is_folder, is_there
from station.wall_clock import WALL_CLOCK, now_text

FORMAT_VERSION = 1
LONGEST_SERIAL = 128
LONGEST_REASON = 200
LONGEST_NOTE = 400

FURTHEST_AHEAD = timedelta(days=3660)
"""A folder named by a later moment than this from now was not named by a clock: new ids do not come after it.

That of a run which the chain has begun was.
"""

WORTH_KEEPING = 1000
"""Names in a folder; fewer are listed faster than anybody notices."""

SETTLED = timedelta(seconds=2)
"""After this time without a change, a later change of a folder has another time."""

_LISTED: dict[Path, tuple[str, list[str]]] = {}
"""The names in the folder that was listed last, and what was seen of the folder then."""


def check_serial(serial: str) -> str:
    """Return a serial number as it may be stored; StationError when it is not `is_serial`."""
    if not is_serial(serial):
        usual = unicodedata.normalize("NFKC", serial).strip()
        other = f" The usual form of this one is {usual[:40]!r}." if usual not in ("", serial) else ""
        raise StationError(
            f"--serial: found {serial[:40]!r}; allowed are 1 to {LONGEST_SERIAL} printable characters in their usual "
            f"form, with no blank at the ends.{other} Scan it again",
        )
    return serial


def is_serial(text: str) -> bool:
    """Whether a text may be a new serial number: printable, and not another one to the eye alone.

    A blank at the end or a full-width letter would make a second unit of one that failed. Stored runs keep what they
    have.
    """
    alike = text.strip() == text == unicodedata.normalize("NFKC", text)
    return 0 < len(text) <= LONGEST_SERIAL and text.isprintable() and alike


def check_operator(name: str) -> str:
    """Return an operator's name as it may be stored; StationError when it is empty, too long or not printable."""
    if not name.strip() or len(name) > LONGEST_SERIAL or not name.isprintable():
        raise StationError(f"--operator: found {name[:40]!r}; allowed are 1 to {LONGEST_SERIAL} printable characters")
    return name.strip()


def check_reason(text: str) -> str:
    """Return why a unit is measured again as it may be stored; StationError as `check_operator`."""
    if not text.strip() or len(text) > LONGEST_REASON or not text.isprintable():
        allowed = f"1 to {LONGEST_REASON} printable characters"
        raise StationError(f"--retest-reason: found {text[:40]!r}; allowed are {allowed}")
    return text.strip()


def check_note(text: str, option: str = "--note") -> str:
    """Return a note for the record as it may be stored; StationError as `check_operator`."""
    if not text.strip() or len(text) > LONGEST_NOTE or not text.isprintable():
        allowed = f"1 to {LONGEST_NOTE} printable characters"
        raise StationError(f"{option}: found {text[:40]!r}; allowed are {allowed}")
    return text.strip()


def _folder_name(serial: str) -> str:
    return re.sub(r"[^A-Za-z0-9._+-]", "_", serial).lstrip(".") or "_"


def _stamp(moment: datetime) -> str:
    return moment.strftime(STAMP)[:-3] + "Z"


def _named_folder(path: Path) -> Path:
    """Return the folder of a run by the path that a person names, whole.

    A link in a data folder is not followed: a run that was moved and linked back is vouched for by the chain beside the
    link. Any other link only leads to where the run lies.
    """
    if path.name in ("", ".."):  # a run is named by its folder, and these have no name
        return path.resolve()
    data = path.parent.resolve()
    return data / path.name if is_data_folder(data) else path.resolve()


def _lay_out(record: RunRecord, files: Mapping[str, bytes]) -> None:
    """Write what is known of a run before it starts; where that fails nothing of it stays."""
    try:
        for name, content in files.items():
            (record.folder / name).parent.mkdir(exist_ok=True)
            record.write_bytes(name, content)
        record.samples.touch()  # a run without this file has lost it
        record.write_bytes(LAYOUT, CURRENT.described)
    except (OSError, RecordError):
        shutil.rmtree(record.folder, ignore_errors=True)
        raise


def _attempt_of(manifest: Manifest, run: str, chain: Chain, created: Entry | None) -> int:
    """Return the number of a run among the attempts of its unit; 0 for one that was not begun here.

    created: the line that begins it. Where the list of runs that are older than the chain was changed, any run may be
    one of them that says so.
    """
    if created is not None:
        return int(created.fields["attempt"])
    before, changed = runs_before(chain)
    return manifest.attempt if run in before or (changed and manifest.chain is None) else 0


class Store:
    """All runs below one folder."""

    def __init__(self, data: Path) -> None:
        self.data = data
        self.warnings: list[str] = []
        """What was noticed of the chain when a run was created."""

    def create(
        self, serial: str, setup: Setup, files: dict[str, bytes], *, own: bool = False, clock_right: str = ""
    ) -> RunRecord:
        """Create the folder of a new run with its manifest and the files that are known before it starts.

        The run has all these files, and its line in the chain, before anybody can see it: a process that is killed on
        the way leaves either no run, or one that can be concluded. With `own` this process owns it by then, until the
        lock is released or the process ends. clock_right: why the clock is right, where entries of the chain are later.

        Raises:
            RecordError: the folder or its chain cannot be written, this computer has no key to sign with, or the
                attempts of this serial number have come to their end.

        """
        try:
            self.data.mkdir(parents=True, exist_ok=True)
            with writing_to(self.data) as chain:
                names = self._names()
                attempt, place = self._next_attempt(serial, names, chain.chain), chain.next_place
                before = () if setup.recovery_of is not None else self._attempts(serial, names)
                record = self._new_folder(serial, names, begun=chain.newest_run)
                if own:
                    record.lock.take()
                _lay_out(record, files)
                manifest = Manifest(
                    id=record.id,
                    serial=serial,
                    attempt=attempt,
                    state=RECORDING,
                    chain=place,
                    recipe=setup.recipe,
                    bench=setup.bench,
                    software=setup.software,
                    unit=setup.unit,
                    scenario=setup.scenario,
                    operator=setup.operator,
                    retest_reason=setup.retest_reason,
                    before=before or None,
                    clock=setup.clock,
                    period_ns=setup.period_ns,
                    recovery_of=setup.recovery_of,
                    left=setup.left,
                    study=setup.study,
                    verdict=None,
                    notes=setup.notes,
                    ring=None,
                    started=now_text(),
                    ended=None,
                    format=FORMAT_VERSION,
                    desk=running_process(os.getpid()),
                )
                record.write_json(CREATED_MANIFEST, plain(manifest))
                parts = {"recipe": setup.recipe.sha256, "bench": setup.bench.sha256, "clock_right": clock_right}
                begun = {name: hashlib.sha256(files[name]).hexdigest() for name in files if is_begun_with(name)}
                chain.append(CREATED, run=record.id, serial=serial, attempt=attempt, files=begun, **parts)
                put_created_in_place(record.folder)
                self.warnings += chain.warnings
        except OSError as error:
            raise RecordError(
                f"{self.data}: the data folder cannot be written: {error.strerror}. Choose another folder with --data"
            ) from error
        sync_folder(self.data)
        return record

    def _new_folder(self, serial: str, names: list[str], *, begun: str) -> RunRecord:
        """Make a folder that is not there yet, and whose name comes after these names.

        begun: the newest run by the chain, which a clock has named, however far this one is behind: a battery that is
        empty sets it back by decades. '' for none.
        """
        latest = WALL_CLOCK.now() + FURTHEST_AHEAD
        moments = ((name, moment_of(name)) for name in sorted([begun, *names], reverse=True))
        newest, before = next(
            ((name, at) for name, at in moments if at is not None and (name <= begun or at <= latest)), ("", None)
        )
        while True:
            now = WALL_CLOCK.now()
            stamp = _stamp(now)
            if before is not None and f"{stamp}-" < newest:  # the clock was set back since then: a millisecond after it
                stamp = _stamp(max(now, before + timedelta(milliseconds=1)))
            folder = self.data / f"{stamp}-{_folder_name(serial)}"
            try:
                folder.mkdir()
            except FileExistsError:
                continue
            return RunRecord(folder)

    def _names(self) -> list[str]:
        """Names of the folders that may be runs: by them runs are found without a look into each.

        With 200 000 runs a listing takes a good part of a second, so it is kept for as long as the folder is as it was.
        """
        try:
            found = self.data.stat()
            seen, kept = seen_text(found), _LISTED.get(self.data)
            if kept is not None and kept[0] == seen:
                return kept[1]
            with os.scandir(self.data) as there:
                names = sorted(entry.name for entry in there if is_text(entry.name))
        except OSError:
            return []
        # Of a folder that changed just now, the next change may have the same time.
        if len(names) > WORTH_KEEPING and WALL_CLOCK.now() - datetime.fromtimestamp(found.st_mtime, UTC) > SETTLED:
            _LISTED.clear()
            _LISTED[self.data] = seen, names
        return names

    def of_serial(self, serial: str) -> list[RunRecord]:
        """Return the runs of a serial number, oldest first; damaged ones are left out."""
        return [run for run in self._named_by(serial, self._names()) if run.serial() == serial]

    def attempts_of(self, serial: str) -> tuple[EarlierAttempt, ...]:
        """Return what became of a serial number so far: its newest attempts, oldest first, also lost ones."""
        return self._attempts(serial, self._names())

    def _attempts(self, serial: str, names: list[str]) -> tuple[EarlierAttempt, ...]:
        return earlier_attempts(self.data, self._named_by(serial, names), serial)

    def named_by(self, serial: str) -> list[RunRecord]:
        """Return the folders that are named after a serial number, oldest first, without a look into each."""
        return self._named_by(serial, self._names())

    def _named_by(self, serial: str, names: list[str]) -> list[RunRecord]:
        end = f"-{_folder_name(serial)}"
        runs = (RunRecord(self.data / name) for name in names if name.endswith(end))
        return [run for run in runs if is_run(run.folder)]

    def other_case_of(self, serial: str) -> str:
        """Return the newest serial number here that differs from this one by case only; '' where none does.

        By the names of the folders, so of letters without accents.
        """
        own = f"Z-{_folder_name(serial)}"
        end = own.lower()
        alike = (one for one in reversed(self._names()) if one[-len(end) :].lower() == end and not one.endswith(own))
        # Several serial numbers may share the name of a folder.
        found = (RunRecord(self.data / one).serial() for one in alike)
        return next((one for one in found if one is not None and one.casefold() == serial.casefold()), "")

    def _next_attempt(self, serial: str, names: list[str], chain: Chain) -> int:
        """Return the number of the next attempt: one more than the chain knows of, and the folders from before it.

        A damaged run that the chain does not know counts, for it may have been one of this serial number. The number
        in a run.json counts only of a run from before the chain: any other has its number from the chain. A later run
        that has lost its line counts as one, whatever its number: the next one must not be the first again.
        """
        (highest, newest), lost, where = last_attempt(self.data, serial), 0, chain.path
        for record in self._named_by(serial, names):
            try:
                manifest = record.manifest()
            except RecordError:
                lost += not chain.entries_of(record.id)
                continue
            if manifest.serial != serial:
                continue
            later, higher = record.id > newest, manifest.attempt > highest
            created = beginning_of(chain, record.id) if later or higher else None
            # Begun here by its run.json, and no line says so: of this chain some were lost.
            lost += later and created is None and manifest.id == record.id and is_from_here(manifest, chain)
            if higher:
                said = _attempt_of(manifest, record.id, chain, created)
                highest, where = max((highest, where), (said, record.folder / MANIFEST), key=itemgetter(0))
        attempt = 1 + highest + lost
        if attempt > LARGEST_COUNT:
            raise RecordError(
                f"{where}: has attempt {highest} of {serial}; allowed is at most {LARGEST_COUNT - 1} before another "
                "attempt. Run 'lostmotion verify' and restore what it names, or move the run's folder out of the data "
                "folder"
            )
        return attempt

    def runs(self) -> list[RunRecord]:
        """All runs, oldest first; without folders whose names are no text: nobody can name them."""
        return [RunRecord(self.data / name) for name in self.folders() if is_text(name)]

    def folders(self) -> list[str]:
        """Names of all folders that are runs, sorted; they need not be text."""
        return runs_there(self.data)

    def newest(self, count: int) -> list[RunRecord]:
        """Return the newest runs, oldest first; folders that are no run are passed over, older ones are not touched."""
        return list(islice(self.newest_first(), count))[::-1]

    def newest_first(self) -> Iterator[RunRecord]:
        """Yield the runs from the newest on, each when it is asked for."""
        named = (RunRecord(self.data / name) for name in reversed(self._names()) if "Z-" in name)
        return (run for run in named if is_run(run.folder))

    def by_id(self, run: str) -> RunRecord | None:
        """Return the run whose id this is, letter by letter; None where there is none."""
        return RunRecord(self.data / run) if run in self._names() and self._is_run(run) else None

    def find(self, name: str, *, alone: bool = False) -> RunRecord:
        """Find a run by id, folder, the end of its id, serial number (newest attempt), or `last`.

        alone: who asks shows also a single run by its own files, and tells that no chain vouches for it.

        Raises:
            StationError: there is none, or the name fits several.

        """
        if not name.strip():
            raise StationError("RUN is empty; allowed are a run id or part of it, a serial number, a folder, or 'last'")
        if is_there(Path(name) / MANIFEST) is not False:
            folder = _named_folder(Path(name))
            return RunRecord(folder, shown_alone=alone and stands_alone(folder))
        names = self._names()
        by_serial = [run for run in self._named_by(name, names) if run.serial() == name]
        exact = name in names and self._is_run(name)
        if is_folder(Path(name)) and not exact and not by_serial:
            raise StationError(f"{name}: this folder is not a run: it has no {MANIFEST}. See 'lostmotion list'")
        newest = next((one for one in reversed(names) if self._is_run(one)), None)
        self._refuse_lost(name, names, newest or "", of_serial=by_serial[-1].id if by_serial else "")
        self._refuse_begun(name, names, newest or "", by_part=not (exact or by_serial))
        archived = [] if name == "last" or exact or by_serial else only_archived(self.data, name)
        if archived and not any(name in one and self._is_run(one) for one in names):
            raise StationError(
                f"run {archived[-1]}: this run is only in the archive. Bring it back with "
                f"'lostmotion archive fetch {archived[-1]}'"
            )
        if newest is None:
            raise StationError(
                f"{self.data}: this data folder has no runs. Measure a unit with 'lostmotion run', or name another "
                "folder with --data"
            )
        if name == "last" or exact:
            return RunRecord(self.data / (newest if name == "last" else name))
        if by_serial:
            return by_serial[-1]
        by_part = [one for one in names if name in one and self._is_run(one)]
        if len(by_part) == 1:
            return RunRecord(self.data / by_part[0])
        if by_part:
            ids = ", ".join(by_part[:8])
            raise StationError(
                f"{name}: the ids of {len(by_part)} runs contain this: {ids}. Give more characters of the run id"
            )
        raise StationError(f"{name}: no such run in {self.data}; the newest run is {newest}. See 'lostmotion list'")

    def _refuse_lost(self, name: str, names: list[str], newest: str, *, of_serial: str) -> None:
        """Raise StationError where a name is that of a run that was concluded, and whose run.json is gone.

        of_serial: the newest run of the serial number that the name is; '' where it is the name of none.
        """
        if name == "last":
            meant = [one for one in names if one > newest]
        elif of_serial:
            meant = [one for one in names if one > of_serial and one.endswith(f"-{_folder_name(name)}")]
        else:
            meant = [one for one in names if name in one]
        line = concluded_and_lost(self.data, (one for one in reversed(meant) if moment_of(one) is not None))
        if line is not None and (not of_serial or line.fields["serial"] == name):
            run, said = line.fields["run"], about_concluded(line)
            raise StationError(
                f"run {run}: {said}; its {MANIFEST} is missing, and {CHAIN} has the run as concluded. {RESTORE}"
            )

    def _refuse_begun(self, name: str, names: list[str], newest: str, *, by_part: bool) -> None:
        """Raise StationError where a name is that of the one run behind the newest that was begun and nothing more."""
        line = begun_and_left(self.data, (one for one in reversed(names) if one > newest))
        if line is None:
            return
        run, serial = line.fields["run"], line.fields["serial"]
        if name in ("last", run, serial) or (by_part and name in run):
            raise StationError(begun_text(line))

    def _is_run(self, name: str) -> bool:
        return is_run(self.data / name)
