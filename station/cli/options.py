"""Arguments and options that several commands of the command line share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from definitions.number_formats import LARGEST
from station.errors import StationError
from station.records import to_paste

DEFAULT_DATA = to_paste.DEFAULT_DATA


def data_folder(text: str | Path) -> Path:
    """Return the folder that `--data` names.

    Raises:
        StationError: nothing is named, as by a shell variable that is not set: as a path that is the working folder.

    """
    if not str(text).strip():
        raise StationError(
            "--data is empty, which would be the folder that you are in; name a folder, or '.' for this one"
        )
    return Path(text)


RecipeArgument = Annotated[str, typer.Argument(metavar="RECIPE", help="Recipe file, or the name of a shipped recipe.")]
RunArgument = Annotated[
    str, typer.Argument(metavar="RUN", help="Run id or part of it, serial number, folder, or 'last'.")
]
TraceArgument = Annotated[str, typer.Argument(metavar="TRACE", help="Stored run, or a CSV, Parquet or TDMS file.")]
FileArgument = Annotated[Path | None, typer.Argument(metavar="[FILE]", help="CSV file. Default: the stored runs.")]
TableArgument = Annotated[
    Path | None,
    typer.Argument(metavar="[FILE]", help="CSV file. Default: a published table that comes with the program."),
]

DataOption = Annotated[
    Path, typer.Option("--data", metavar="DIR", parser=data_folder, help="Folder that holds the runs.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else.")]
BenchOption = Annotated[
    str | None,
    typer.Option("--bench", metavar="FILE", help="Bench file or shipped bench. Default: the embedded virtual bench."),
]
UnitOption = Annotated[
    str | None,
    typer.Option(
        "--unit", metavar="NAME[:SEED]", help="Simulated unit on the virtual bench: P1, worn, soft, tight, cracked ..."
    ),
]
SeedOption = Annotated[
    int | None,
    typer.Option(
        "--seed", metavar="N", min=0, max=LARGEST, help="Seed of the noise on the virtual bench. Default: a new one."
    ),
]
ScenarioOption = Annotated[
    Path | None,
    typer.Option("--scenario", metavar="FILE", help="Scenario file: faults to inject into the virtual bench."),
]
WallClockOption = Annotated[
    bool,
    typer.Option(
        "--wall-clock",
        help="Let the virtual bench run in real time, as real hardware does; it does not wait for the controller.",
    ),
]
PresetOption = Annotated[
    str | None,
    typer.Option(
        "--preset",
        metavar="NAME",
        help="Set of metric definitions: static, inverse, measurement, output, nabtesco, spinea or harmonic.",
    ),
]
ChosenMetricOption = Annotated[
    list[str] | None,
    typer.Option(
        "--metric",
        metavar="TEXT",
        help='Single metric with its options, "stiffness_at torque=50% branch=load"; may be repeated.',
    ),
]
MetricOption = Annotated[
    str | None, typer.Option("--metric", metavar="ID", help="Metric of the stored runs, as 'metrics' lists it.")
]
RecipeFilter = Annotated[
    str | None, typer.Option("--recipe", metavar="NAME", help="Only runs by the recipe of this name.")
]
SerialFilter = Annotated[str | None, typer.Option("--serial", metavar="SN", help="Only runs of this serial number.")]
SideOption = Annotated[
    str | None,
    typer.Option(
        "--side",
        metavar="+|-",
        help="Side of the metric, such as + or - (direction of torque). Default: the worse one.",
    ),
]
BranchOption = Annotated[
    str | None,
    typer.Option(
        "--branch",
        metavar="NAME",
        help="Branch of the loop (such as load), if a run has the metric on several branches.",
    ),
]
ColumnOption = Annotated[str, typer.Option("--column", metavar="NAME", help="Column of FILE that holds the values.")]
LevelOption = Annotated[
    float, typer.Option("--level", metavar="P", min=0.5, max=0.9999, help="Level of confidence of the intervals.")
]
