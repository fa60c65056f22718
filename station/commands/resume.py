"""`lostmotion resume`: the new desk of a run whose desk died while its scan goes on."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from controller.image import Command
from station.record.ring_reader import RingReader
from station.record.run_record import RunRecord
from station.record.store import Store
from station.run.asked_to_stop import listening
from station.run.recovery import recover, resume


class Operator:
    """Ctrl-C once: stop; again: quick stop."""

    def __init__(self) -> None:
        self._asked = 0
        self._sent = 0

    def interrupt(self, *_: object) -> None:
        """Note one Ctrl-C."""
        self._asked += 1

    def attend(self, ring: RingReader) -> None:
        """Pass what was asked on to the scan."""
        if self._asked > self._sent:
            ring.send(Command.STOP if self._sent == 0 else Command.QUICK_STOP)
            self._sent += 1


def resume_run(name: str, data: Path, *, as_json: bool) -> int:
    """Take over a run, or conclude it when its scan has ended; return the exit code of its result.

    Raises:
        StationError: there is no such run.

    """
    run: RunRecord = Store(data).find(name)
    operator = Operator()
    with listening(operator.interrupt):
        resume(run, operator.attend)
        recover(run)
    # Only now: what shows a result takes longer to load than the scan waits for a new desk on a busy machine.
    from station.commands.run import exit_code  # noqa: PLC0415
    from station.commands.show import stored_result  # noqa: PLC0415
    from station.reports.result_view import result_console, show_result  # noqa: PLC0415

    result = stored_result(run)
    if as_json:
        sys.stdout.write(json.dumps(result, ensure_ascii=False) + "\n")
    else:
        show_result(result_console(), result)
    return exit_code(result)
