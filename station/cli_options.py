"""Options that several commands of the command line share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

DEFAULT_DATA = Path("runs")

DataOption = Annotated[Path, typer.Option("--data", metavar="DIR", help="Folder that holds the runs.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else.")]
RunArgument = Annotated[
    str, typer.Argument(metavar="RUN", help="Run id or part of it, serial number, folder, or 'last'.")
]
FileArgument = Annotated[
    Path | None, typer.Argument(metavar="[FILE]", help="CSV file. Without it, the stored runs are taken.")
]
MetricOption = Annotated[
    str | None, typer.Option("--metric", metavar="ID", help="Metric of the stored runs, as 'metrics' lists it.")
]
RecipeFilter = Annotated[
    str | None, typer.Option("--recipe", metavar="NAME", help="Only runs by the recipe of this name.")
]
SerialFilter = Annotated[str | None, typer.Option("--serial", metavar="SN", help="Only runs of this serial number.")]
SideOption = Annotated[
    str | None, typer.Option("--side", metavar="+|-", help="Side of the metric. Default: the one that stands first.")
]
BranchOption = Annotated[
    str | None, typer.Option("--branch", metavar="NAME", help="Branch, where a run has the metric on several.")
]
ColumnOption = Annotated[str, typer.Option("--column", metavar="NAME", help="Column of FILE that holds the values.")]
LevelOption = Annotated[
    float, typer.Option("--level", metavar="P", min=0.5, max=0.9999, help="Level of confidence of the intervals.")
]
