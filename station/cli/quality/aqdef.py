"""`lostmotion quality dfq --outbox`: one pass of the outbox of AQDEF files, without a server."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from station.errors import StationError
from station.web.aqdef.collect import begin_here
from station.web.aqdef.outbox import look, waiting
from station.web.aqdef.settings import FILE, load_aqdef
from station.web.people.database import StationDatabase

EXIT_WAITING = 1


def write_outbox(data: Path, *, as_json: bool) -> int:
    """Write the files that are complete; return 0, or 1 where the folder has not taken all.

    Raises:
        StationError, RecipeError: there is no `aqdef.yaml`, it is refused, or chain, store or database cannot be used.

    """
    settings = load_aqdef(data)
    if settings is None:
        raise StationError(
            f"{data / FILE}: is missing, so no AQDEF file is written. Write this settings file: see docs/quality.md"
        )
    database = StationDatabase(data)
    try:
        begin_here(database, data)
        written = look(database, data, settings, at_once=True)
        with database.reading() as connection:
            stand = waiting(connection)
    finally:
        database.close()
    if as_json:
        sys.stdout.write(json.dumps({"written": written, **stand._asdict()}, ensure_ascii=False) + "\n")
    else:
        sys.stdout.write(f"written  {written}\nwaiting  {stand.waiting}\nopen     {stand.open}\n")
        if stand.last_error:
            sys.stdout.write(f"why      {stand.last_error}\n")
        if stand.refused:
            sys.stdout.write(f"refused  {stand.refused}, the newest: {stand.last_refused}\n")
    return EXIT_WAITING if stand.waiting else 0
