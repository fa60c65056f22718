"""`lostmotion resume`: the new supervisor of a run whose supervisor died while its scan goes on."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path

from station.errors import RecordError
from station.records.data_folder import Store
from station.records.ring.reader import RingReader
from station.records.run_record import RunRecord
from station.records.seal import is_sealed
from station.run.asked_to_stop import STOP_WORDS, Stopping, listening
from station.run.screen.late_screen import LateScreen
from station.run.silent_scan import SilentScan
from station.run.way_back.recover import recover, resume


def resume_run(name: str, data: Path, *, as_json: bool, report: bool | None = None) -> int:
    """Take over a run, or conclude it when its scan has ended, with its report; return the exit code of its result.

    A run that was concluded before is shown only, and that is said.

    Raises:
        StationError: there is no such run.

    """
    run: RunRecord = Store(data).find(name)
    before = is_sealed(run.manifest())
    refused = None
    try:
        _take_over(run, as_json=as_json)
    except RecordError as error:
        refused = error
    # Only now: what shows a result takes longer to load than the scan waits for a new supervisor on a busy machine.
    from recipes import RecipeError  # noqa: PLC0415
    from station.bench.request import stored_job  # noqa: PLC0415
    from station.cli.measure.run import exit_code, finish, no_record, print_result, report_wanted  # noqa: PLC0415
    from station.log import open_log  # noqa: PLC0415
    from station.reports.report_of_run import shown_of  # noqa: PLC0415
    from station.reports.stored_result import stored_result  # noqa: PLC0415

    if refused is not None:
        return no_record(run, refused, as_json=as_json)
    result = stored_result(run)
    if before:
        sys.stderr.write(f"{run.id}: nothing is left to resume: the run was concluded before, {run.manifest().ended}\n")
    if before or not is_sealed(run.manifest()):
        print_result(result, as_json=as_json)
        return exit_code(result)
    try:
        wanted = report_wanted(stored_job(run).recipe, asked=report)
    except RecipeError:  # the result is there all the same, and is what counts
        wanted = bool(report)
    with open_log(run.folder / "log.jsonl") as log:
        return finish(run, result, partial(shown_of, run) if wanted else None, log, as_json=as_json)


def _take_over(run: RunRecord, *, as_json: bool) -> None:
    stopping = Stopping()
    with LateScreen(run, as_json=as_json) as screen, listening(stopping.hear):
        scans: list[SilentScan] = []  # one, from the first look on

        def attend(ring: RingReader) -> None:
            if not scans:
                scans.append(SilentScan(ring, screen.say, partial(_kill, run)))
            (scan,) = scans
            scan.look()
            if (command := stopping.take_command()) and not scan.end(command):
                screen.say(STOP_WORDS[command])
                ring.send(command)
            screen.look(ring)

        resume(run, attend)
        recover(run)


def _kill(run: RunRecord) -> None:
    """End the scan process of a run, and no other one that has got its id."""
    pid = run.scanning()
    if pid:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
