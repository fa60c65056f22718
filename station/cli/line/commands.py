"""Commands on many runs: the line, the gage, the master part, the rule of decision."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from typing import Annotated

import typer

from station.cli.options import (
    DEFAULT_DATA,
    BranchOption,
    ChosenMetricOption,
    ColumnOption,
    DataOption,
    FileArgument,
    JsonOption,
    LevelOption,
    MetricOption,
    PresetOption,
    RecipeFilter,
    SerialFilter,
    SideOption,
)

AttemptsOption = Annotated[
    str, typer.Option("--attempts", metavar="WHICH", help="Runs to use of each unit: first, last or all.")
]


def repeatability(
    runs: Annotated[
        list[str],
        typer.Argument(metavar="RUN...", help="Stored runs or recorded files of one unit, or its serial number."),
    ],
    recipe: Annotated[
        str | None,
        typer.Option(
            "--recipe", metavar="RECIPE", help="Evaluate all runs with this recipe. Default: each run's own recipe."
        ),
    ] = None,
    preset: PresetOption = None,
    metric: ChosenMetricOption = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Show mean and standard deviation of each metric over cycles and over runs of a unit. Exit code: 0, or 2."""
    from recipes import Selection
    from station.cli.line import repeatability as command_repeatability

    raise typer.Exit(
        command_repeatability.repeat(runs, recipe, Selection(preset, tuple(metric or ())), data, as_json=as_json)
    )


def capability(
    file: FileArgument = None,
    metric: MetricOption = None,
    recipe: RecipeFilter = None,
    side: SideOption = None,
    branch: BranchOption = None,
    attempts: AttemptsOption = "first",
    column: ColumnOption = "value",
    lower: Annotated[
        float | None, typer.Option("--min", metavar="X", help="Lower limit. Default: that of the recipe.")
    ] = None,
    upper: Annotated[
        float | None, typer.Option("--max", metavar="X", help="Upper limit. Default: that of the recipe.")
    ] = None,
    subgroup: Annotated[
        int,
        typer.Option(
            "--subgroup",
            metavar="N",
            min=1,
            help="Subgroup size. 1: single values, with the moving range as their spread.",
        ),
    ] = 1,
    level: LevelOption = 0.95,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Capability of the line for one metric: Cp, Cpk, Pp and Ppk against its limits."""
    from station.cli.line import line_statistics as line
    from station.cli.line.stored_metric import asked_of

    asked = line.Asked(file, column, data, asked_of(metric, side, branch, recipe, attempts=attempts, said=()))
    raise typer.Exit(line.capability_of(asked, (lower, upper), subgroup, level, as_json=as_json))


def units(
    file: FileArgument = None,
    metric: MetricOption = None,
    recipe: RecipeFilter = None,
    side: SideOption = None,
    branch: BranchOption = None,
    column: ColumnOption = "value",
    level: LevelOption = 0.95,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """How one metric differs from unit to unit, apart from how it repeats, and which units are unusual."""
    from station.cli.line import line_statistics as line
    from station.cli.line.stored_metric import asked_of

    asked = line.Asked(file, column, data, asked_of(metric, side, branch, recipe, said=()))
    raise typer.Exit(line.units_of(asked, level, as_json=as_json))


def gage(
    file: FileArgument = None,
    metric: MetricOption = None,
    recipe: RecipeFilter = None,
    side: SideOption = None,
    branch: BranchOption = None,
    by: Annotated[
        str,
        typer.Option(
            "--by",
            metavar="WHAT",
            help="Field of the stored runs that identifies the operator: day, bench or operator.",
        ),
    ] = "day",
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance", metavar="X", help="Tolerance: upper minus lower limit. Default: that of the recipe."
        ),
    ] = None,
    level: LevelOption = 0.95,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Gage study: how much of the spread comes from the measuring, by variance and by average and range.

    FILE has the columns operator, part and value; or operator, part and run, and the values of --metric are taken
    from these stored runs.
    """
    from station.cli.line import gage as command_gage
    from station.cli.line.stored_metric import asked_of

    ask = asked_of(metric, side, branch, recipe)
    raise typer.Exit(command_gage.gage(file, ask, data, by, (tolerance, level), as_json=as_json))


def master_part(
    file: FileArgument = None,
    metric: MetricOption = None,
    serial: SerialFilter = None,
    recipe: RecipeFilter = None,
    side: SideOption = None,
    branch: BranchOption = None,
    column: ColumnOption = "value",
    baseline: Annotated[
        int, typer.Option("--baseline", metavar="N", min=1, help="Number of first runs used for the control limits.")
    ] = 10,
    reference: Annotated[
        float | None,
        typer.Option("--reference", metavar="X", help="Certified value of the master part (a part of known value)."),
    ] = None,
    u_reference: Annotated[
        float, typer.Option("--u-reference", metavar="U", min=0, help="Standard uncertainty of the certified value.")
    ] = 0.0,
    level: LevelOption = 0.99,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Trend of a master part: does the bench change? Control chart, drift, distance from the certified value.

    Exit code: 0 in control, 1 a rule is broken, 2 bad input.
    """
    from station.cli.line import line_statistics as line
    from station.cli.line.stored_metric import asked_of

    ask = asked_of(metric, side, branch, recipe, serial)
    certified = None if reference is None else (reference, u_reference)
    raise typer.Exit(
        line.master_part_of(line.Asked(file, column, data, ask), baseline, certified, level, as_json=as_json)
    )


def decision(
    u: Annotated[
        float,
        typer.Option(
            "--u", metavar="U", help="Standard uncertainty of the measurement: U divided by its k, half of U for k = 2."
        ),
    ],
    mean: Annotated[
        float | None,
        typer.Option("--process-mean", metavar="X", help="Mean of the production process (normal distribution)."),
    ] = None,
    sd: Annotated[
        float | None,
        typer.Option(
            "--process-sd", metavar="S", help="Standard deviation of the process, without measurement uncertainty."
        ),
    ] = None,
    gamma: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--process-gamma",
            metavar="A B",
            help="Gamma distribution of the process: shape and scale, instead of mean and standard deviation.",
        ),
    ] = None,
    low: Annotated[float | None, typer.Option("--min", metavar="X", help="Lower limit, in the metric's unit.")] = None,
    high: Annotated[float | None, typer.Option("--max", metavar="X", help="Upper limit, in the metric's unit.")] = None,
    guard: Annotated[
        float | None,
        typer.Option(
            "--guard", metavar="W", help="Width of the guard band between tolerance limit and acceptance limit."
        ),
    ] = None,
    factor: Annotated[
        float | None,
        typer.Option(
            "--factor",
            metavar="R",
            help="Guard band as a multiple of the uncertainty: w = R·U (decision.guard_factor).",
        ),
    ] = None,
    pfa: Annotated[
        float | None,
        typer.Option(
            "--pfa", metavar="P", help="Calculate the guard band that gives this share of wrongly accepted parts."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Risks of a decision rule: bad parts accepted, good parts rejected, and the guard band that keeps them."""
    from station.cli.line import decision as command_decision

    asked = command_decision.Asked(mean, sd, gamma, low, high, u, guard, factor, pfa)
    raise typer.Exit(command_decision.decision(asked, as_json=as_json))
