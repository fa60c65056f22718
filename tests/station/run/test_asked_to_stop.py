"""Ctrl-C, a service manager and a closed terminal are heard alike, and nobody else's handlers are lost."""

from __future__ import annotations

import os
import signal

import pytest

from definitions.image import Command
from station.run.asked_to_stop import ASKS, Stopping, listening


@pytest.mark.parametrize("number", ASKS)
def test_everyone_who_asks_is_heard(number: signal.Signals) -> None:
    heard: list[int] = []
    outside = signal.signal(number, signal.default_int_handler)  # the tests themselves may run under nohup
    try:
        with listening(lambda got, _frame: heard.append(got)):
            os.kill(os.getpid(), number)
        assert heard == [number]
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, outside)


def test_a_run_under_nohup_outlives_its_terminal() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with listening(lambda *_: pytest.fail("heard")):
            os.kill(os.getpid(), signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_the_first_asking_is_a_stop_and_every_further_one_a_quick_stop() -> None:
    stopping = Stopping()
    assert stopping.take_command() is Command.NONE
    with listening(stopping.hear):
        os.kill(os.getpid(), signal.SIGINT)
    taken = [stopping.take_command() for _ in range(3)]
    assert taken == [Command.STOP, Command.NONE, Command.NONE]
    with listening(stopping.hear):
        os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGINT)
    taken = [stopping.take_command() for _ in range(3)]
    assert taken == [Command.QUICK_STOP, Command.QUICK_STOP, Command.NONE]


def test_two_askings_between_two_looks_are_a_stop_and_then_a_quick_stop() -> None:
    stopping = Stopping()
    stopping.hear(signal.SIGINT, None)
    stopping.hear(signal.SIGINT, None)
    assert [stopping.take_command() for _ in range(3)] == [Command.STOP, Command.QUICK_STOP, Command.NONE]
    assert stopping.asked == 2
