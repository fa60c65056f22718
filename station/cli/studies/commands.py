"""`lostmotion study ...` on the command line."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import (
    DEFAULT_DATA,
    BranchOption,
    ColumnOption,
    DataOption,
    FileArgument,
    JsonOption,
    LevelOption,
    MetricOption,
    RecipeFilter,
    SerialFilter,
    SideOption,
    TableArgument,
)

study_app = typer.Typer(
    help="Studies: lock angle, temperature, frequency response, eccentricity.", no_args_is_help=True
)


@study_app.command("lock-angle")
def lock_angle(
    file: FileArgument = None,
    metric: Annotated[
        list[str] | None,
        typer.Option("--metric", metavar="ID", help="Metric of the stored runs, or column of FILE; may be repeated."),
    ] = None,
    serial: SerialFilter = None,
    recipe: RecipeFilter = None,
    side: SideOption = None,
    branch: BranchOption = None,
    level: LevelOption = 0.95,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Spread of metrics over lock positions, and their correlation.

    FILE has one row per position and one column per metric. Stored runs: those of one unit (--serial).
    """
    from station.cli.line.stored_metric import Ask
    from station.cli.studies import studies as command_studies

    asks = [Ask(name, side, branch, recipe, serial) for name in metric or []]
    raise typer.Exit(command_studies.lock_angle(file, asks, data, level, as_json=as_json))


@study_app.command("temperature")
def temperature(
    file: FileArgument = None,
    metric: MetricOption = None,
    serial: SerialFilter = None,
    recipe: RecipeFilter = None,
    side: SideOption = None,
    branch: BranchOption = None,
    column: ColumnOption = "value",
    reference: Annotated[
        float,
        typer.Option("--reference", metavar="C", help="Reference temperature to which values are converted [°C]."),
    ] = 20.0,
    level: LevelOption = 0.95,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Effect of the housing temperature on a metric: slope per °C, and the value at the reference temperature.

    FILE has the columns temperature_c and one with the values. Stored runs: the mean housing temperature
    while measuring.
    """
    from station.cli.line.stored_metric import asked_of
    from station.cli.studies import studies as command_studies

    ask = asked_of(metric, side, branch, recipe, serial)
    raise typer.Exit(command_studies.temperature(file, column, ask, data, (reference, level), as_json=as_json))


@study_app.command("frequency")
def frequency(
    trace: Annotated[str, typer.Argument(metavar="TRACE", help="Stored run, or a CSV, Parquet or TDMS file.")],
    band: Annotated[
        str | None,
        typer.Option(
            "--band",
            metavar="LOW:HIGH",
            help="Frequency band of the torque sweep (chirp), LOW:HIGH [Hz]. Default: that of the run.",
        ),
    ] = None,
    period: Annotated[
        float | None, typer.Option("--period", metavar="S", help="Period of a torque sweep (chirp) that repeats [s].")
    ] = None,
    coherence: Annotated[
        float,
        typer.Option(
            "--coherence",
            metavar="C",
            min=0.0,
            max=1.0,
            help="Smallest coherence of the spectral lines to use (0 to 1).",
        ),
    ] = 0.9,
    recipe: Annotated[
        str | None,
        typer.Option("--recipe", metavar="RECIPE", help="Recipe to evaluate a file. A stored run uses its own recipe."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Write the spectral lines as CSV.")] = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Dynamic stiffness, natural frequency and damping from a torque sweep: H1 estimate with a limit on coherence."""
    from station.cli.studies import frequency as command_frequency

    asked = command_frequency.Asked(trace, band, period, coherence, recipe, data, out)
    raise typer.Exit(command_frequency.frequency(asked, as_json=as_json))


@study_app.command("eccentricity")
def eccentricity(
    file: TableArgument = None,
    exponent: Annotated[
        float | None,
        typer.Option(
            "--exponent", metavar="P", help="Exponent P in K = k·a^P (stiffness K, eccentricity a). Default: 2."
        ),
    ] = None,
    free: Annotated[
        bool, typer.Option("--free", help="Estimate the exponent from the table, instead of giving it.")
    ] = False,
    at: Annotated[
        list[float] | None,
        typer.Option("--at", metavar="MM", help="Print the stiffness at this eccentricity [mm]; may be repeated."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Stiffness over the eccentricity of the cycloidal disc.

    FILE has the columns eccentricity_mm, torque_nm and deflection_rad.
    """
    from station.cli.studies import studies as command_studies

    raise typer.Exit(command_studies.eccentricity(file, exponent, at or [], free=free, as_json=as_json))
