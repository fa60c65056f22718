"""Ctrl-C, a service manager and a closed terminal are heard alike, and nobody else's handlers are lost."""

from __future__ import annotations

import os
import signal

import pytest

from station.run.asked_to_stop import ASKS, listening


@pytest.mark.parametrize("number", ASKS)
def test_everyone_who_asks_is_heard(number: signal.Signals) -> None:
    heard: list[int] = []
    before = signal.getsignal(number)
    with listening(lambda got, _frame: heard.append(got)):
        os.kill(os.getpid(), number)
    assert heard == [number]
    assert signal.getsignal(number) is before


def test_a_run_under_nohup_outlives_its_terminal() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with listening(lambda *_: pytest.fail("heard")):
            os.kill(os.getpid(), signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
