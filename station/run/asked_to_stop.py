"""Who asks a run to stop from outside: Ctrl-C, a service manager, and a terminal that is closed."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

ASKS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def listening(handler: Callable[..., None]) -> Iterator[None]:
    """Let `handler(number, frame)` hear them meanwhile; a hang-up that is ignored (nohup) stays ignored."""
    heard = [number for number in ASKS if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handler) for number in heard}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
