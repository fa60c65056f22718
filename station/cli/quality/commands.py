"""`lostmotion quality ...` on the command line."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from station.cli.quality.study_commands import guided_app

if TYPE_CHECKING:
    from station.store.quality.lot import Lot

quality_app = typer.Typer(
    help="Quality of a production: yield, causes, capability, control charts, trends, type 1 study.",
    no_args_is_help=True,
)
quality_app.add_typer(guided_app, name="study")

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
SubgroupOption = Annotated[
    int,
    typer.Option(
        "--subgroup", metavar="N", min=1, help="Subgroup size. 1: single values, with the moving range as their spread."
    ),
]
ByOption = Annotated[
    str | None,
    typer.Option(
        "--by", metavar="WHAT", help="Group by bench, operator, recipe, revision, model, shift, day or month."
    ),
]
NEWEST = 2000


def _lot(
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
        quality.print_yield(data, _lot(recipe, model, bench, since, until, virtual), by, level, as_json=as_json)
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

    raise typer.Exit(quality.print_causes(data, _lot(recipe, model, bench, since, until, virtual), as_json=as_json))


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

    lot = _lot(recipe, model, bench, since, until, virtual, newest)
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

    lot = _lot(recipe, model, bench, since, until, virtual, newest)
    asked = quality.ChartAsked(metric, tuple(rules or ("shewhart",)), subgroup, baseline, side, branch, units_per_hour)
    raise typer.Exit(quality.print_chart(data, lot, asked, as_json=as_json))


@quality_app.command()
def trend(
    metric: WantedMetric,
    by: Annotated[
        str,
        typer.Option("--by", metavar="WHAT", help="Group by bench, operator, revision, model, shift, day or month."),
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
    """A metric by groups of runs: which bench, shift, operator or day differs from the others."""
    from station.cli.quality import quality

    lot = _lot(recipe, model, bench, since, until, virtual)
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
    """Try other limits: which verdicts of a lot would change, and the risk of wrong decisions before and after."""
    from station.cli.quality import quality
    from station.quality.limits_trial import Tried

    lot = _lot(recipe, model, bench, since, until, virtual, newest)
    tried = Tried(metric, branch, lower, upper, guard_factor)
    raise typer.Exit(quality.print_trial(data, lot, tried, draft, as_json=as_json))


@quality_app.command("dfq")
def dfq(
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="File to write, such as lot.dfq.")] = None,
    outbox: Annotated[
        bool,
        typer.Option(
            "--outbox", help="Write now all complete files that aqdef.yaml asks for; 'serve' does this continuously."
        ),
    ] = False,
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
    """Write the values of a lot as AQDEF, first attempts and retests; 'export --format dfq' does that for one run."""
    from station.errors import StationError

    if outbox == (out is not None):
        raise StationError(
            "--out FILE writes one lot; --outbox writes the files that aqdef.yaml asks for. Give exactly one of them"
        )
    if out is None:
        from station.cli.quality.aqdef import write_outbox

        chosen = (recipe, model, bench, since, until)
        if any(one is not None for one in chosen) or virtual or newest != NEWEST:
            raise StationError("--outbox: aqdef.yaml says which runs are written. Leave out the other options")
        raise typer.Exit(write_outbox(data, as_json=as_json))
    from station.cli.out_file import refuse_records
    from station.cli.runs.export import program_name, write_dfq
    from station.quality.dfq.write import dfq_of_lot
    from station.store.quality.lot import production

    refuse_records(out)
    with production(data) as look:
        found = dfq_of_lot(look, _lot(recipe, model, bench, since, until, virtual, newest), program_name())
    raise typer.Exit(write_dfq(out, found, as_json=as_json))


@quality_app.command("report")
def report(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write to.")],
    loops: Annotated[
        int,
        typer.Option(
            "--loops",
            metavar="N",
            min=0,
            max=1000,
            help="Number of newest torque-angle loops to draw; each is evaluated again.",
        ),
    ] = 30,
    locale: Annotated[
        str,
        typer.Option("--locale", metavar="L", help="Spreadsheet for the CSV: en or de (semicolons, decimal commas)."),
    ] = "en",
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
    """Write the report of a batch: page, PDF, and every table and the loops as CSV."""
    from station.cli.quality import batch

    lot = _lot(recipe, model, bench, since, until, virtual, newest)
    raise typer.Exit(batch.write_report(data, lot, out, loops, locale, as_json=as_json))


@quality_app.command()
def validation(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="New folder to write the pack to.", show_default=False)
    ] = None,
    bench: Annotated[
        str | None, typer.Option("--bench", metavar="FILE", help="Bench file of the bench, or a shipped bench.")
    ] = None,
    tests: Annotated[
        list[Path] | None,
        typer.Option("--tests", metavar="XML", help="Report of the tests, by 'pytest --junitxml'; repeatable."),
    ] = None,
    self_test: Annotated[
        bool,
        typer.Option("--self-test", help="Measure virtual units of known verdict, and replay them: some minutes."),
    ] = False,
    type1: Annotated[
        list[str] | None,
        typer.Option("--type1", metavar="SN:ID:X", help="Part, metric and known value of a type 1 study; repeatable."),
    ] = None,
    gage: Annotated[
        list[str] | None,
        typer.Option("--gage", metavar="ID", help="Metric of a gage study of the stored runs; repeatable."),
    ] = None,
    by: Annotated[
        str, typer.Option("--by", metavar="WHAT", help="Field that identifies the operator: day, bench or operator.")
    ] = "operator",
    evidence: Annotated[
        list[Path] | None,
        typer.Option(
            "--evidence", metavar="FILE", help="File that is copied into the pack for the auditor; repeatable."
        ),
    ] = None,
    recipe: RecipeFilter = None,
    since: SinceOption = None,
    until: UntilOption = None,
    virtual: VirtualOption = False,
    check: Annotated[
        Path | None,
        typer.Option("--check", metavar="DIR", help="Check that an existing pack is unchanged, instead of making one."),
    ] = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Write a validation pack for a customer's auditor: installation, operation and performance of this bench.

    Exit code: 0 when everything is met, 1 when something is not met or open, 2 bad input.
    """
    from station.cli.quality import validation as command
    from station.errors import StationError
    from station.quality.validation.performance import known_part

    if check is not None:
        raise typer.Exit(command.check(check, as_json=as_json))
    if out is None:
        raise StationError("quality validation: --out is missing. Name a new folder for the validation pack")
    parts = tuple(known_part(one) for one in type1 or ())
    lot = _lot(recipe, None, None, since, until, virtual)
    files = tuple(tests or ()), tuple(evidence or ())
    wanted = command.Wanted(bench, *files, parts, tuple(gage or ()), by, lot, self_test)
    raise typer.Exit(command.make(data, out, wanted, as_json=as_json))
