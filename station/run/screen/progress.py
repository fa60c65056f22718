"""Progress of a run: one big state on a terminal, one line per change of state elsewhere."""

from __future__ import annotations

import sys
from contextlib import suppress
from types import TracebackType
from typing import Self, TextIO

from rich.align import Align
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from definitions.image import State
from station.bench.request import Job
from station.run.screen.live import LiveReader, LiveView

STATE_COLOURS: dict[State, str] = {
    State.IDLE: "white",
    State.HOME: "cyan",
    State.LOCK: "cyan",
    State.CALIBRATE: "blue",
    State.RAMP_POS: "green",
    State.REVERSE: "green",
    State.RAMP_NEG: "green",
    State.UNLOAD: "yellow",
    State.RELEASE: "yellow",
    State.JOG: "yellow",
    State.COMPLETE: "bold green",
    State.STOPPED: "bold yellow",
    State.FAULT: "bold red",
}


def clock(seconds: float) -> str:
    """Return a duration as minutes and seconds."""
    whole = max(round(seconds), 0)
    return f"{whole // 60}:{whole % 60:02d}"


def signed(value: float | None, decimals: int) -> str:
    """Return a number with its sign, minus as it stands in all other texts; a dash for one that is not known."""
    return "–" if value is None else f"{value:+.{decimals}f}".replace("-", "−")


class Progress:
    """Shows records as they come; a context manager, so that the terminal is left as it was found.

    A run does not depend on who watches it: with a terminal or a pipe that is gone nothing is shown, and nothing ends.

    Args:
        reader: turns records into what is shown.
        title: serial number and recipe.
        stream: standard output, or standard error when standard output belongs to a program.
        say_alarms: print each alarm once as it comes; where a result is printed behind it, that one names them.

    """

    def __init__(
        self, reader: LiveReader, title: str, stream: TextIO | None = None, *, say_alarms: bool = False
    ) -> None:
        self._reader, self.title = reader, title
        self._stream = stream or sys.stdout
        self._console = Console(file=self._stream, markup=False, emoji=False)
        self._live: Live | None = None
        self._last: State | None = None
        self._say_alarms = say_alarms
        self._said: set[str] = set()

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False, transient=True)
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._live is not None:
            with suppress(OSError):
                self._live.stop()
            self._live = None

    def say(self, text: str) -> None:
        """Print one line."""
        with suppress(OSError):
            if self._live is not None:
                self._live.console.print(f"  {text}", style="dim", highlight=False)
            else:
                self._stream.write(text + "\n")
                self._stream.flush()

    def show(self, record: bytes | memoryview) -> None:
        """Show the newest record."""
        view = self._reader.read(record)
        if self._live is not None:
            with suppress(OSError):
                self._live.update(panel(view, self.title), refresh=True)
        elif view.state is not self._last:
            cycle = f", cycle {view.cycle} of {view.cycles}" if view.cycle else ""
            self.say(f"{clock(view.time_s):>6}  {view.words}{cycle}, {signed(view.torque_nm, 1)} N·m")
        self._last = view.state
        if self._say_alarms:
            for word, texts in (("ALARM", view.alarms), ("note", view.notes)):
                for text in texts:
                    if text not in self._said:
                        self._said.add(text)
                        self.say(f"{word}  {text}")


def progress_of(job: Job, serial: str, *, as_json: bool) -> Progress:
    """Return the progress of a run of this job: on standard error where standard output belongs to a program."""
    reader = LiveReader(job.program, angle_out=job.bench.sensors.angle_out is not None)
    stream = sys.stderr if as_json else sys.stdout
    return Progress(reader, f"{serial}  {job.recipe.recipe.name}", stream, say_alarms=as_json)


def panel(view: LiveView, title: str) -> Panel:
    """Return one moment of a run as a panel: what an operator reads from two metres away."""
    colour = STATE_COLOURS[view.state]
    word = Text(view.state.name.replace("_", " "), style=f"bold reverse {colour.removeprefix('bold ')}")
    word.pad(3)
    numbers = Table.grid(padding=(0, 4))
    for _ in range(4):
        numbers.add_column(justify="center")
    numbers.add_row(
        Text(f"{signed(view.torque_nm, 1):>8} N·m", style="bold"),
        Text(f"{signed(view.windup_arcmin, 3):>8} ′", style="bold"),
        Text(f"{view.cycle} of {view.cycles}" if view.cycle else "–", style="bold"),
        Text(clock(view.left_s), style="bold"),
    )
    numbers.add_row(*(Text(name, style="dim") for name in ("torque", "wind-up", "cycle", "left")))
    parts: list[RenderableType] = [
        Align.center(word),
        Align.center(Text(view.words, style=colour)),
        Text(""),
        Align.center(numbers),
        Text(""),
        ProgressBar(total=1.0, completed=view.fraction, complete_style=colour.removeprefix("bold ")),
    ]
    parts += [Text(f"▲ {alarm}", style="bold red") for alarm in view.alarms]
    parts += [Text(f"· {note}", style="cyan") for note in view.notes]
    border = colour.removeprefix("bold ")
    return Panel(Group(*parts), title=Text(title), border_style=border, padding=(1, 2), width=78)
