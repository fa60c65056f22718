"""The records of a run as a table, by the run's own layout: the one place where channels are asked for by name.

    table["image"]["torque_in_nm"]     a channel of all records; AbsentChannelError where the record has none
    table["image"].get("torque_in_nm") the same, or None
    table["scan"], table[mask], table[-1]["orders"]["state"]

A channel that the record does not have is absent. It never reads as zero.
"""

from __future__ import annotations

from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from station.errors import RecordError
from station.records.samples.layout import CURRENT, Layout


class AbsentChannelError(RecordError):
    """A channel is needed that the record does not have, because the version that made it had no such channel."""

    def __init__(self, group: str, name: str) -> None:
        super().__init__(
            f"the record has no channel {group}.{name}: the version of lostmotion that made it did not record it. "
            "Evaluate the run with that version (see software in run.json)"
        )


class Group:
    """Inputs or orders of all records, or of one of them, by name."""

    __slots__ = ("_name", "_values")

    def __init__(self, name: str, values: Any) -> None:
        self._name, self._values = name, values

    def __contains__(self, name: str) -> bool:
        return name in self._values.dtype.names

    def __getitem__(self, name: str) -> Any:
        if name not in self._values.dtype.names:
            raise AbsentChannelError(self._name, name)
        return self._values[name]

    def get(self, name: str) -> Any:
        """Return a channel, or None where the record has none."""
        return self._values[name] if name in self._values.dtype.names else None


class Row:
    """One record."""

    __slots__ = ("_values",)

    def __init__(self, values: np.void) -> None:
        self._values = values

    def __getitem__(self, group: Literal["image", "orders"]) -> Group:
        return Group(group, self._values[group])


class Table:
    """All records of a run, or some of them; `rows` is the structured array beneath, of the layout's own type."""

    __slots__ = ("layout", "rows")

    def __init__(self, rows: npt.NDArray[np.void], layout: Layout = CURRENT) -> None:
        self.rows, self.layout = rows, layout

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, key: Literal["image", "orders"]) -> Group: ...
    @overload
    def __getitem__(self, key: Literal["sequence", "scan", "lateness_ns", "work_ns"]) -> npt.NDArray[Any]: ...
    @overload
    def __getitem__(self, key: int) -> Row: ...
    @overload
    def __getitem__(self, key: slice | npt.NDArray[Any]) -> Table: ...

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            if key in ("image", "orders"):
                return Group(key, self.rows[key])
            if key not in (self.rows.dtype.names or ()):
                raise AbsentChannelError("record", key)
            return self.rows[key]
        if isinstance(key, int | np.integer):
            return Row(self.rows[key])
        return Table(self.rows[key], self.layout)


def table_of(content: bytes | memoryview, layout: Layout = CURRENT) -> Table:
    """Return all complete records in `content`; a last one that was cut off is left out."""
    count = len(content) // layout.record_bytes
    return Table(np.frombuffer(content, dtype=layout.dtype, count=count), layout)
