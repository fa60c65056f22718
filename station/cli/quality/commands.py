"""`lostmotion quality ...` on the command line."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from typing import Annotated

import typer

from station.cli.options import (
    DEFAULT_DATA,
    BranchOption,
    DataOption,
    JsonOption,
    LevelOption,
    RecipeFilter,
    SideOption,
)
from station.cli.quality.document_commands import documents_app
from station.cli.quality.lot_options import (
    NEWEST,
    BenchFilter,
    ByOption,
    ModelFilter,
    NewestOption,
    SinceOption,
    UntilOption,
    VirtualOption,
    WantedMetric,
    lot_of,
)
from station.cli.quality.study_commands import guided_app

quality_app = typer.Typer(
    help="Quality of a production: yield, causes, capability, control charts, trends, type 1 study.",
    no_args_is_help=True,
)
quality_app.add_typer(documents_app)
quality_app.add_typer(guided_app, name="study")

SubgroupOption = Annotated[
    int,
    typer.Option(
        "--subgroup", metavar="N", min=1, help="Subgroup size. 1: single values, with the moving range as their spread."
    ),
]


@quality_app.command("yield")
def yield_(
    by: ByOption = None,
    recipe: RecipeFilter = None,
    model: ModelFilter = None,
    bench: BenchFilter = None,
    since: SinceOption = None,
    until: UntilOption = None,
    virtual: VirtualOption = False,
    level: LevelOption = 0.95,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """First-pass yield and final yield, with their confidence intervals."""
    from station.cli.quality import quality

    raise typer.Exit(
        quality.print_yield(data, lot_of(recipe, model, bench, since, until, virtual), by, level, as_json=as_json)
    )


@quality_app.command()
def pareto(
    recipe: RecipeFilter = None,
    model: ModelFilter = None,
    bench: BenchFilter = None,
    since: SinceOption = None,
    until: UntilOption = None,
    virtual: VirtualOption = False,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Causes of lost yield in a lot, most frequent first: failed metrics by side, alarms, reasons of NOT DECIDABLE."""
    from station.cli.quality import quality

    raise typer.Exit(quality.print_causes(data, lot_of(recipe, model, bench, since, until, virtual), as_json=as_json))


@quality_app.command()
def capability(
    metric: Annotated[
        list[str] | None,
        typer.Option("--metric", metavar="ID", help="Metric, may be repeated. Default: all that have a limit."),
    ] = None,
    recipe: RecipeFilter = None,
    model: ModelFilter = None,
    bench: BenchFilter = None,
    since: SinceOption = None,
    until: UntilOption = None,
    virtual: VirtualOption = False,
    newest: NewestOption = NEWEST,
    subgroup: SubgroupOption = 1,
    level: LevelOption = 0.95,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Cp, Cpk, Pp and Ppk of every metric with a limit, for its worse side, with confidence intervals."""
    from station.cli.quality import quality

    lot = lot_of(recipe, model, bench, since, until, virtual, newest)
    raise typer.Exit(quality.print_capability(data, lot, metric or [], subgroup, level, as_json=as_json))


@quality_app.command()
def chart(
    metric: WantedMetric,
    rules: Annotated[
        list[str] | None,
        typer.Option(
            "--rules",
            metavar="NAME",
            help="Rules of the control chart: shewhart (default), western-electric, nelson, or single ones.",
        ),
    ] = None,
    subgroup: SubgroupOption = 5,
    baseline: Annotated[
        int | None,
        typer.Option(
            "--baseline",
            metavar="N",
            min=2,
            help="Number of first subgroups for the control limits. All by default.",
        ),
    ] = None,
    units_per_hour: Annotated[
        float,
        typer.Option(
            "--units-per-hour",
            metavar="X",
            min=0.01,
            help="Units measured in an hour, for the false-alarm rate.",
        ),
    ] = 60.0,
    side: SideOption = None,
    branch: BranchOption = None,
    recipe: RecipeFilter = None,
    model: ModelFilter = None,
    bench: BenchFilter = None,
    since: SinceOption = None,
    until: UntilOption = None,
    virtual: VirtualOption = False,
    newest: NewestOption = NEWEST,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Control chart of a metric, and the average run length of its rules. Exit code: 0 in control, 1 not."""
    from station.cli.quality import quality

    lot = lot_of(recipe, model, bench, since, until, virtual, newest)
    asked = quality.ChartAsked(metric, tuple(rules or ("shewhart",)), subgroup, baseline, side, branch, units_per_hour)
    raise typer.Exit(quality.print_chart(data, lot, asked, as_json=as_json))


@quality_app.command()
def trend(
    metric: WantedMetric,
    by: Annotated[
        str,
        typer.Option(
            "--by",
            metavar="WHAT",
            help="Group by bench, fixture, lock-angle, operator, revision, model, shift, day or month.",
        ),
    ] = "bench",
    side: SideOption = None,
    branch: BranchOption = None,
    recipe: RecipeFilter = None,
    model: ModelFilter = None,
    bench: BenchFilter = None,
    since: SinceOption = None,
    until: UntilOption = None,
    virtual: VirtualOption = False,
    level: LevelOption = 0.95,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """A metric by groups of runs: which bench, fixture, lock angle, shift, operator or day differs from the others."""
    from station.cli.quality import quality

    lot = lot_of(recipe, model, bench, since, until, virtual)
    raise typer.Exit(quality.print_trend(data, lot, metric, by, (side, branch), level, as_json=as_json))


@quality_app.command("type1")
def type1(
    serial: Annotated[
        str,
        typer.Option(
            "--serial", metavar="SN", help="Serial number of a part with a known value, such as a master part."
        ),
    ],
    metric: WantedMetric,
    reference: Annotated[
        float, typer.Option("--reference", metavar="X", help="Known value of the part, in the unit of the metric.")
    ],
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance", metavar="X", help="Tolerance: upper minus lower limit. Default: that of the recipe."
        ),
    ] = None,
    share: Annotated[
        float,
        typer.Option(
            "--share",
            metavar="P",
            min=1.0,
            max=100.0,
            help="Share of the tolerance that the spread is compared with [%].",
        ),
    ] = 20.0,
    side: SideOption = None,
    branch: BranchOption = None,
    bench: BenchFilter = None,
    virtual: VirtualOption = False,
    level: LevelOption = 0.95,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Type 1 study: Cg and Cgk of a bench on one part of known value. Exit code: 0 capable, 1 not, 2 bad input."""
    from station.cli.quality import quality
    from station.quality.bench_ability import Part

    part = Part(serial, metric, side, branch, bench, virtual)
    raise typer.Exit(quality.print_type_one(data, part, reference, tolerance, share, level, as_json=as_json))


@quality_app.command()
def trial(
    metric: WantedMetric,
    lower: Annotated[
        float | None, typer.Option("--min", metavar="X", help="Lower limit to try; nan: no limit.")
    ] = None,
    upper: Annotated[
        float | None, typer.Option("--max", metavar="X", help="Upper limit to try; nan: no limit.")
    ] = None,
    guard_factor: Annotated[
        float | None,
        typer.Option(
            "--guard-factor",
            metavar="R",
            min=0.0,
            max=3.0,
            help="Guard band to try, as a multiple of the uncertainty U. 0: no guard band.",
        ),
    ] = None,
    definition: Annotated[
        str | None,
        typer.Option(
            "--definition",
            metavar="TEXT",
            help='Other definition to try, as in "fit=six_segment_20pct" or "backlash_width_zero". Every run is '
            "evaluated again, about 0.4 s of a processor each.",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers",
            metavar="N",
            min=1,
            help="Number of parallel processes for --definition. Default: one for each core.",
        ),
    ] = None,
    branch: BranchOption = None,
    recipe: RecipeFilter = None,
    model: ModelFilter = None,
    bench: BenchFilter = None,
    since: SinceOption = None,
    until: UntilOption = None,
    virtual: VirtualOption = False,
    newest: NewestOption = NEWEST,
    draft: Annotated[
        str | None,
        typer.Option(
            "--save-draft", metavar="PERSON", help="Save the recipe with these limits as a draft written by PERSON."
        ),
    ] = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Try other limits or another definition: which verdicts of a lot would change, and the risk of wrong decisions.

    Exit code: 0, 1 where a run could not be evaluated by another definition, 2 bad input.
    """
    from station.cli.quality import trial as command_trial
    from station.quality.limits_trial import Tried

    lot = lot_of(recipe, model, bench, since, until, virtual, newest)
    tried = Tried(metric, branch, lower, upper, guard_factor, definition or "")
    raise typer.Exit(command_trial.print_trial(data, lot, tried, workers, draft, as_json=as_json))
