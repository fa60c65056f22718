"""Processes that evaluate stored runs, each a fork of one that has loaded what evaluating takes.

Who has threads must not fork itself: what they hold, a fork would hold for ever. So the first process asked for starts
a server of forks, which has one thread and loads everything once; every further one is there at once.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Mapping
from multiprocessing.context import ForkServerContext
from threading import Thread

LOADED = "station.reevaluation.forked"


def forks(*also: str) -> ForkServerContext:
    """Return the context that makes them; also: further modules that the first process asked for has loaded ahead."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([LOADED, *also])
    return context


def begin(environment: Mapping[str, str], nice: int) -> None:
    """Begin in such a process: with its parent's environment as it is now, after those who come first.

    nice: steps of priority below the parent. Ctrl-C is for the parent, and not for it.
    """
    os.environ.clear()
    os.environ.update(environment)
    os.nice(nice)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def end_with_parent() -> None:
    """End this process with the one that asked for it, also where that was killed."""

    def wait() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
        os._exit(0)

    Thread(target=wait, daemon=True).start()
