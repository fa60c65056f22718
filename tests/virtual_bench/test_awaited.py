"""What a virtual bench waits for before it acts on the end of a scan."""

from __future__ import annotations

from virtual_bench.awaited import LOST_AFTER, Awaited


def test_what_was_given_up_and_comes_late_is_not_taken_for_the_next_one() -> None:
    """It was once: from then on every scan of the run had its answers one scan late, which ended it."""
    requests = Awaited()
    assert requests.missing(1, 0), "the host holds the request up"
    requests.give_up(1, 0)
    assert not requests.missing(1, 0)
    requests.acted(1)
    assert not requests.take_back(0)
    assert requests.missing(2, 0), "what is sent later is waited for"
    assert requests.take_back(1)
    assert requests.missing(2, 1), "the one that has come is the late one"
    assert not requests.take_back(2)
    assert not requests.missing(2, 2)


def test_what_is_late_again_and_again_is_still_waited_for() -> None:
    requests, come = Awaited(), 0
    for scan in range(1, 5 * LOST_AFTER):
        requests.take_back(come)
        assert requests.missing(scan, come)
        if scan % 3:
            requests.give_up(scan, come)
        else:
            come = scan
            requests.take_back(come)
        assert not requests.missing(scan, come)
        requests.acted(scan)


def test_what_never_comes_is_not_waited_for_for_ever() -> None:
    requests, waits = Awaited(), 0
    for scan in range(10 * LOST_AFTER):
        come = scan  # of each scan, the first had one that was lost
        requests.take_back(come)
        if requests.missing(scan + 1, come):
            requests.give_up(scan + 1, come)
            waits += 1
        assert not requests.missing(scan + 1, come)
        requests.acted(scan + 1)
    assert waits == LOST_AFTER
