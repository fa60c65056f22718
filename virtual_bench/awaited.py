"""What a scan says it has sent, against what has come: what is waited for, and what no longer is.

What does not come within the bound is done without. It is late as a rule, for a busy host holds processes up: so it is
taken back when as many have come, and what follows is waited for again. Else the bench would act one message early in
every scan from then on, and each answer would come after its request had been given up. What stays away time after time
is lost for good: a connection that ended had it.
"""

from __future__ import annotations

LOST_AFTER = 20
"""Scans in a row, each with a wait in vain, after which what is missing counts as lost for good."""


class Awaited:
    """Messages of one kind: the frames, or the requests of one device."""

    def __init__(self) -> None:
        self._sent = 0
        self._late = 0
        self._lost = 0
        self._in_vain = 0

    def take_back(self, come: int) -> bool:
        """Look whether something that was given up has come after all, and wait again for what follows it."""
        late, self._late = self._late, min(self._late, max(self._sent - self._lost - come, 0))
        return self._late < late

    def missing(self, sent: int, come: int) -> bool:
        """Tell whether something is to be waited for; both are counted from the beginning."""
        return sent > come + self._late + self._lost

    def give_up(self, sent: int, come: int) -> None:
        """Do without what is missing now."""
        if not self.missing(sent, come):
            return
        self._sent, self._late = sent, sent - come - self._lost
        self._in_vain += 1
        if self._in_vain >= LOST_AFTER:
            self._lost, self._late, self._in_vain = self._lost + self._late, 0, 0

    def acted(self, sent: int) -> None:
        """Remember what had been sent when the bench acted."""
        self._sent = sent
        if not self._late:
            self._in_vain = 0
