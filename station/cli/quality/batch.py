"""`lostmotion quality report`: the report of a batch, as files in a folder."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from station.cli.out_file import refuse_records, writing
from station.errors import StationError
from station.quality.batch.content import batch_of
from station.quality.batch.files import HTML, write_batch
from station.results.export import LOCALES
from station.store.quality.lot import Lot


def write_report(data: Path, lot: Lot, out: Path, loops: int, locale: str, *, as_json: bool) -> int:
    """Write the report and tell its files; return 0.

    Raises:
        StationError: no such locale, a lot without valid runs, or a folder that cannot be written.

    """
    if locale not in LOCALES:
        raise StationError(f"--locale: found {locale!r}; allowed are {', '.join(LOCALES)}")
    refuse_records(out / HTML)
    batch = batch_of(data, lot, loops, _told)
    with writing(out):
        files = write_batch(batch, out, LOCALES[locale])
    if as_json:
        sys.stdout.write(json.dumps({"files": [str(file) for file in files], "loops": len(batch.loops)}) + "\n")
    else:
        sys.stdout.write("\n".join([*batch.notes, *(str(file) for file in files)]) + "\n")
    return 0


def _told(run: str) -> None:
    sys.stderr.write(f"evaluating {run}\n")
