"""Entry of the supervisor that faults of the machine reach: `python -m faultlab.supervisor_process SPEC.json`.

Spec: recipe, bench, scenario (paths), unit (null behind a gateway), data (folder of the records). On standard output
it says where its record is, and at its end whether the bench was refused, one JSON line each; a supervisor that is
killed does not come to the second.
"""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from pathlib import Path

from faultlab.supervisor import EXIT_RECORD_WAITS, run_here
from station.bench.request import load_job
from station.bench.virtual_unit import VirtualUnit
from station.documents.reading import of_plain
from station.errors import RecordError
from station.run.faults.machine_faults import free_disk


def _say(text: str) -> None:
    with suppress(OSError):
        sys.stderr.write(f"{text}\n")


def _tell(**what: str) -> None:
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def main() -> int:
    """Run a spec; 0 when the run was concluded, 4 when its records wait for the disk."""
    spec = json.loads(Path(sys.argv[1]).read_text())
    job = load_job(spec["recipe"], spec["bench"])
    try:
        scenario, data = Path(spec["scenario"]), Path(spec["data"])
        unit = None if spec["unit"] is None else of_plain(VirtualUnit, spec["unit"], Path(sys.argv[1]))
        left = run_here(job, unit, scenario, data, _say, begun=lambda folder: _tell(record=str(folder)))
    except RecordError as error:
        free_disk()  # what is still to be said may go to a file
        _say(f"the record could not be kept: {error}")
        return EXIT_RECORD_WAITS
    _tell(refused=left.refused)
    return 0


if __name__ == "__main__":
    sys.exit(main())
