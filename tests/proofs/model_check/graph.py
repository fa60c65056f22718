"""The states that a walk has found, numbered, and which follow which."""

from __future__ import annotations

from collections.abc import Hashable

from safety_rules import require


class Graph:
    """States by number: whether a run goes on in each, how each was reached first, and what follows it."""

    def __init__(self) -> None:
        self._ids: dict[Hashable, int] = {}
        self._edges: list[tuple[int, ...]] = []
        self._running: list[bool] = []
        self._came_from: list[tuple[int, str]] = []

    def __len__(self) -> int:
        return len(self._edges)

    def number(self, key: Hashable) -> int | None:
        """Number of a state that is known."""
        return self._ids.get(key)

    def add(self, key: Hashable, came_from: tuple[int, str], *, running: bool) -> int:
        """Take in a new state, reached from the state of a number by a choice; return its number."""
        number = self._ids[key] = len(self._edges)
        self._edges.append(())
        self._came_from.append(came_from)
        self._running.append(running)
        return number

    def follow(self, number: int, following: tuple[int, ...]) -> None:
        """Set what follows a state."""
        self._edges[number] = following

    def way_to(self, number: int, last: str) -> list[str]:
        """Names of the choices that lead from the start to a breach."""
        names = [last]
        while number >= 0:
            number, name = self._came_from[number]
            names.append(name)
        return names[::-1]

    def longest_way(self) -> int:
        """Scans that a run can last at most; `BrokenRuleError` when it can go round for ever."""
        order: list[int] = []
        incoming = [0] * len(self._edges)
        for number, following in enumerate(self._edges):
            if self._running[number]:
                for after in set(following):
                    incoming[after] += self._running[after]
        ready = [n for n, running in enumerate(self._running) if running and not incoming[n]]
        length = [0] * len(self._edges)
        while ready:
            number = ready.pop()
            order.append(number)
            for after in set(self._edges[number]):
                if self._running[after]:
                    length[after] = max(length[after], length[number] + 1)
                    incoming[after] -= 1
                    if not incoming[after]:
                        ready.append(after)
        require(11, "a run can go round for ever", holds=len(order) == sum(self._running))
        return max(length)
