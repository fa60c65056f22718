"""A bench that shows the controller something else than it is."""

from __future__ import annotations

from typing import Any

from definitions.image import Image, Orders
from virtual_bench.in_process import VirtualTimeBench


class Shown:
    """Stands between controller and bench: shows what it is told to, and may keep the orders to itself."""

    def __init__(self, bench: VirtualTimeBench, shown: dict[str, float], *, deaf: bool = False) -> None:
        self._bench, self._shown, self._deaf = bench, shown, deaf

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bench, name)

    def read(self, scan: int, missed_periods: int, command: int) -> Image:
        """Return the bench's image with what is shown instead."""
        return self._bench.read(scan, missed_periods, command)._replace(**self._shown)

    def write(self, orders: Orders, scan: int) -> None:
        """Pass the orders on, unless the bench is deaf."""
        if not self._deaf:
            self._bench.write(orders, scan)
