"""Options by which the quality commands say which runs they look at."""

# ruff: noqa: PLC0415, PLR0917 - imports inside the function keep --help fast; the options come one by one

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from station.store.quality.lot import Lot

ModelFilter = Annotated[str | None, typer.Option("--model", metavar="NAME", help="Only units of this model.")]
BenchFilter = Annotated[
    str | None, typer.Option("--bench", metavar="NAME", help="Only runs on the bench of this name.")
]
SinceOption = Annotated[
    str | None,
    typer.Option("--since", metavar="DATE", help="Only runs from this time on: 2026-01-31 or 2026-01-31T08:00."),
]
UntilOption = Annotated[
    str | None, typer.Option("--until", metavar="DATE", help="Only runs before this time, written as for --since.")
]
VirtualOption = Annotated[bool, typer.Option("--virtual", help="Units of the virtual bench instead of real units.")]
NewestOption = Annotated[
    int,
    typer.Option(
        "--newest", metavar="N", min=3, help="Number of newest first attempts (first measurement of a unit) to use."
    ),
]
WantedMetric = Annotated[str, typer.Option("--metric", metavar="ID", help="Metric of the runs, as 'metrics' lists it.")]
ByOption = Annotated[
    str | None,
    typer.Option(
        "--by",
        metavar="WHAT",
        help="Group by bench, fixture, lock-angle, operator, recipe, revision, model, shift, day or month.",
    ),
]
NEWEST = 2000


def lot_of(
    recipe: str | None,
    model: str | None,
    bench: str | None,
    since: str | None,
    until: str | None,
    virtual: bool,  # noqa: FBT001 - as the options come
    newest: int = NEWEST,
) -> Lot:
    """Return the runs that a command line means."""
    from station.cli.runs.run_table import moment_of
    from station.store.quality.lot import Lot

    begin = None if since is None else moment_of(since)
    end = None if until is None else moment_of(until, "--until")
    return Lot(recipe, model, bench, begin, end, virtual, newest)
