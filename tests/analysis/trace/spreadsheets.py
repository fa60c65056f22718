"""Files as spreadsheets and recorders of many countries write them, with what they say or what is wrong with them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

ROWS = 60
TIME = np.round(np.arange(ROWS) * 0.01, 3)
TORQUE = np.round(1250.0 * np.sin(np.linspace(0.0, 6.2, ROWS)), 2)
ANGLE = np.round(9.25 * np.sin(np.linspace(-0.3, 5.9, ROWS)), 4)
COLUMNS = {"t_s": TIME, "torque_out_nm": TORQUE, "angle_in_arcmin": ANGLE}
UNITS = {"t_s": "s", "torque_out_nm": "N·m", "angle_in_arcmin": "arcmin"}

Numbers = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Style:
    """How a program writes a table."""

    separator: str = ","
    decimal: str = "."
    thousands: str = ""
    encoding: str = "utf-8"
    end: str = "\n"
    declared: bool = False
    units: bool = False
    before: tuple[str, ...] = ()
    comments: tuple[str, ...] = ()
    quoted: bool = False
    minus: str = "-"
    trailing: int = 0
    emptied: int = 0
    numbers: Callable[[str, float], str] | None = None
    columns: dict[str, Numbers] = field(default_factory=lambda: dict(COLUMNS))

    def number(self, name: str, value: float) -> str:
        """Return a number as this style writes it."""
        if self.numbers is not None:
            return self.numbers(name, value)
        text = f"{abs(value):,.{4 if name.startswith('angle') else 3}f}".replace(",", "T").replace(".", self.decimal)
        return (self.minus if value < 0 else "") + text.replace("T", self.thousands)

    def content(self) -> bytes:
        """Return the file."""
        lines = [f"sep={self.separator}"] if self.declared else []
        lines += [*self.before, self._row(list(self.columns))]
        lines += [self._row([UNITS[name] for name in self.columns])] if self.units else []
        rows = zip(*self.columns.values(), strict=True)
        written = [self._row([self.number(*one) for one in zip(self.columns, row, strict=True)]) for row in rows]
        middle = len(written) // 2
        lines += [*written[:middle], *self.comments, *written[middle:]]
        lines += [self.separator * (len(self.columns) - 1)] * self.emptied
        return (self.end.join(lines) + self.end).encode(self.encoding)

    def _row(self, cells: list[str]) -> str:
        shown = [f'"{one}"' for one in cells] if self.quoted else cells
        return self.separator.join(shown) + self.separator * self.trailing


def readable() -> Iterator[tuple[str, Style]]:
    """Yield files that say what they say in one way only, by name."""
    german = {"separator": ";", "decimal": ","}
    for encoding, end in itertools.product(("utf-8", "utf-8-sig", "cp1252", "utf-16"), ("\n", "\r\n")):
        yield f"german {encoding} {end!r}", Style(**german, encoding=encoding, end=end)
        yield f"english {encoding} {end!r}", Style(encoding=encoding, end=end)
    for separator, decimal in itertools.product(("\t", "|", ";"), (".", ",")):
        yield f"{separator!r} {decimal!r}", Style(separator=separator, decimal=decimal)
        yield f"units below {separator!r} {decimal!r}", Style(separator=separator, decimal=decimal, units=True)
        yield f"declared {separator!r} {decimal!r}", Style(separator=separator, decimal=decimal, declared=True)
    for thousands in (".", "\xa0", "\u202f", "'", "’"):
        yield f"german thousands {thousands!r}", Style(**german, thousands=thousands)
    for thousands in (",", "'", "’", "\xa0"):
        yield f"english thousands {thousands!r}", Style(thousands=thousands, quoted=True)
    yield "swiss", Style(separator=";", decimal=".", thousands="'", encoding="cp1252")
    yield "comma and comma, quoted", Style(decimal=",", quoted=True)
    yield "quoted", Style(quoted=True)
    yield "minus of typography", Style(**german, minus="−")
    yield "plus signs", Style(numbers=lambda _name, value: f"{value:+.4f}")
    yield "scientific", Style(numbers=lambda _name, value: f"{value:.6E}")
    yield "scientific with commas", Style(separator=";", numbers=lambda _name, value: f"{value:.6E}".replace(".", ","))
    yield "whole numbers among others", Style(numbers=lambda _name, value: f"{value:.12g}")
    yield "recorder's head", Style(before=("Recorder 9000", "Channel count: 3", "Date: 2026-03-01 08:00"))
    yield (
        "recorder's head, german",
        Style(**german, before=("Messung vom 01.03.2026", "Prüfer: M. Groß"), encoding="cp1252"),
    )
    yield "comments above", Style(before=("# measured by hand", "# bench 3"))
    yield "comments between", Style(comments=("# the guard was opened here", "", "// and closed"))
    yield "trailing separator", Style(trailing=1)
    yield "trailing separator, german", Style(**german, trailing=1)
    yield "rows that were emptied", Style(**german, emptied=3)
    yield "old ends of lines", Style(end="\r")
    yield "blanks around", Style(numbers=lambda _name, value: f"   {value:10.4f} ")
    yield "utf-16 without a mark", Style(encoding="utf-16-le")
    yield "utf-16, big end first", Style(encoding="utf-16-be", separator="\t")


REFUSED: dict[str, tuple[bytes, str, str]] = {
    "either sign": (b"t_s;torque_out_nm\n1,125;1,250\n1,250;2,500\n", "row 1", "1,125"),
    "both signs": (b"t_s;torque_out_nm\n0,5;1,5\n0.75;2,5\n", "row 2", "0.75"),
    "thousands or decimals": (b"t_s;torque_out_nm\n0,25;1.250\n0,5;1,25\n", "row 1", "1.250"),
    "decimal commas between commas": (
        b"t_s,torque_out_nm\n0,5,1,5\n0,6,2,5\n",
        "row 1",
        "4 cells, as if the numbers had decimal",
    ),
    "text in a cell": (b"t_s;torque_out_nm\n0,5;1,5\n0,6;#DIV/0!\n", "row 2", "#DIV/0!"),
    "an empty cell": (b"t_s;torque_out_nm\n0,5;1,5\n0,6;\n", "row 2", "''"),
    "not a number": (b"t_s;torque_out_nm\n0,5;1,5\n0,6;NaN\n", "row 2", "NaN"),
    "other units": ("t_s;torque_out_nm\ns;lbf·ft\n0,5;1,5\n".encode(), "line 2", "lbf·ft"),
    "milliseconds": (b"t_s;torque_out_nm\nms;Nm\n500;1,5\n", "line 2", "ms"),
    "two separators": (b"x;y,z\n1;2,3\n", "line 1", "commas and semicolons"),
    "names of another language": (b"Zeit;Drehmoment\n0,5;1,5\n", "trace.csv", "Zeit"),
    "a row that is too short": (b"t_s;torque_out_nm;angle_in_rad\n0,5;1,5;1\n0,6;2\n", "row 2", "2 cells"),
    "a name with the unit in brackets": (b"t_s;torque_out [Nm]\n0,5;1,5\n", "torque_out [Nm]", "would be left out"),
    "time of day": (b"t_s;torque_out_nm\n08:00:00,5;1,5\n", "row 1", "08:00:00,5"),
    "a date": (b"t_s;torque_out_nm\n01.03.2026;1,5\n", "row 1", "01.03.2026"),
    "arabic digits": ("t_s;torque_out_nm\n0,5;٣\n".encode(), "row 1", "٣"),
    "bytes of no encoding": (b"t_s;torque_out_nm\n0,5;1\x81\n", "line 2", "0x81"),
    "hexadecimal": (b"t_s;torque_out_nm\n0,5;0x1F\n", "row 1", "0x1F"),
    "an unclosed quote": (b't_s,torque_out_nm\n0.5,"1.5\n0.6,2\n', "row 1", "quote"),
}
"""Files that say nothing certain, with what the error must name: the place, and what was found there."""
