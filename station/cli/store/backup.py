"""`lostmotion backup` and `restore`: a data folder as one file, and back, checked as `verify` checks it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from station.counted import counted
from station.documents.entries import plain
from station.records.backup import Kept, back_up, below, not_concluded, restore
from station.records.run_record import RunRecord
from station.records.to_paste import to_its_result, to_paste
from station.records.verify import verify_folder
from station.web.people import audit
from station.web.people.database import FILE, StationDatabase

EXIT_PROBLEMS = 1

MOST = 20
"""Problems, and runs that are not concluded, that are named."""


def backup(file: Path, data: Path, *, as_json: bool) -> int:
    """Write a data folder into a file; return 0, or 1 where the folder does not pass `verify` or has an open run.

    Raises:
        StationError, RecordError: it cannot be made; nothing is left behind then.

    """
    return _say(file, data, back_up(data, file), as_json=as_json)


def restored(file: Path, data: Path, *, as_json: bool) -> int:
    """Make a data folder of a backup; return 0, or 1 where the folder does not pass `verify` or has an open run.

    Raises:
        StationError, RecordError: the file is no whole backup, or the folder is not empty; nothing is left behind then.

    """
    return _say(file, data, restore(file, data), as_json=as_json)


def _say(file: Path, data: Path, kept: Kept, *, as_json: bool) -> int:
    found = verify_folder(data)
    others = {one.name: verify_folder(one) for one in below(data)}
    problems = [*found.problems, *(problem for one in others.values() for problem in one.problems)]
    left = not_concluded(data)
    head = _audit_head(data)
    begun = list(found.walk.created)
    newer = len(begun) - begun.index(kept.reaches) - 1 if kept.reaches in begun else len(begun)
    if as_json:
        document = plain(kept) | {
            "file": str(file),
            "data": str(data),
            "runs": found.runs,
            "newer_runs": newer,
            **{name: one.runs for name, one in others.items()},
            "chain_entries": found.walk.entries,
            "audit": None if head is None else {"lines": head.lines, "sha256": head.head_sha256},
            "passed": not problems,
            "not_concluded": left,
        }
        sys.stdout.write(json.dumps(document, ensure_ascii=False) + "\n")
    else:
        every = to_paste("conclude", "--all", data=data)
        lines = [
            f"{file}: {counted(kept.files, 'file')}, {kept.bytes / 1e6:.1f} MB, made {kept.made}",
            ", ".join(
                [
                    f"{data}: {counted(found.runs, 'run')}",
                    *(f"{one.runs} {name}" for name, one in others.items()),
                    f"{counted(found.walk.entries, 'entry', 'entries')} of the chain",
                ]
            ),
            *([f"reaches run {kept.reaches} of the chain"] if kept.reaches else []),
            *(
                [f"{counted(newer, 'run')} of {data} began later, not in this file. Make another backup"]
                if newer
                else []
            ),
            *([] if head is None else [f"audit trail: {head.lines} lines, head {head.head_sha256}"]),
            "every file has its recorded hash; 'verify' " + ("passed" if not problems else "finds problems:"),
            *(f"  {problem.text}" for problem in problems[:MOST]),
            *(f"run {run} is not concluded. Run '{to_its_result(RunRecord(data / run))}'" for run in left[:MOST]),
            *([f"{len(left)} runs are not concluded. Run '{every}'"] if len(left) > MOST else []),
        ]
        sys.stdout.writelines(f"{line}\n" for line in lines)
    return EXIT_PROBLEMS if problems or left else 0


def _audit_head(data: Path) -> audit.Head | None:
    if not (data / FILE).is_file():
        return None
    database = StationDatabase(data)
    with database.reading() as connection:
        head = audit.head_of(connection)
    database.close()
    return head
