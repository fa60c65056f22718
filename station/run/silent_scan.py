"""A scan that says nothing any more: told once, and its process ended when it was asked to stop and cannot obey.

It hangs in a driver of the machine, or somebody has stopped its process. The drive notices by itself that the
controller is gone; what is left for the supervisor is to tell the person, and to come to an end when the person wants
one.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from definitions.image import Command
from station.records.ring.reader import RingReader
from station.records.ring.ring import ScanState

SILENT_AFTER_S = 3.0
"""Time without a record after which a scan is silent: longer than any wait of it for a device, or for the disk."""

GIVEN_UP_AFTER_S = 10.0
"""Silence after which a scan that was asked to stop, if only once, is ended: a page asks once, and would wait on."""

MOST_OF_A_LOOK_S = 0.1
"""Silence that one look may add: in what the supervisor was held up itself, nobody could have been heard."""

SILENT = (
    "the scan process says nothing any more. Keep clear of the shafts: the unit may be under torque. Ctrl-C asks it to "
    "stop; if it stays silent it is ended, by Ctrl-C again at once"
)
GIVEN_UP = "the scan process does not answer, and is ended. The drive stops itself when it misses the controller"
WHY_ENDED = "it did not answer any more, and was ended when asked for"


class SilentScan:
    """Listens to the scan of a ring, by how many records it has made: those that found the ring full count too."""

    def __init__(self, ring: RingReader, say: Callable[[str], None], kill: Callable[[], None]) -> None:
        """Prepare; `kill` ends the scan's process at once."""
        self._ring, self._say, self._kill = ring, say, kill
        self._records, self._looked_s = 0, time.monotonic()
        self._silent_s = 0.0
        self._stop_asked = False
        self.ended = False
        """Whether its process was ended here."""

    @property
    def silent(self) -> bool:
        """Whether the scan says nothing any more."""
        return self._silent_s > SILENT_AFTER_S

    def look(self) -> None:
        """Look whether records have come; called at every look of the supervisor."""
        now_s, records, was_silent = time.monotonic(), self._ring.written + self._ring.lost, self.silent
        if records == self._records and self._ring.state is ScanState.RUNNING:
            self._silent_s += min(now_s - self._looked_s, MOST_OF_A_LOOK_S)
        else:
            self._silent_s = 0.0
        self._records, self._looked_s = records, now_s
        if self.silent and not was_silent:
            self._say(SILENT)
        if self._stop_asked and self._silent_s > GIVEN_UP_AFTER_S:
            self._end()

    def end(self, command: Command) -> bool:
        """End the process of a silent scan whose person asks for more than a stop; return whether that was done."""
        self._stop_asked = True
        if not self.silent or command is not Command.QUICK_STOP or self.ended:
            return False
        self._end()
        return True

    def _end(self) -> None:
        if not self.ended:
            self.ended = True
            self._say(GIVEN_UP)
            self._kill()
