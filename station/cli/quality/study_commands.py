"""`lostmotion quality study ...` on the command line."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from typing import Annotated

import typer

from station.cli.measure.commands import Pace
from station.cli.options import (
    DEFAULT_DATA,
    BenchOption,
    DataOption,
    JsonOption,
    LevelOption,
)

guided_app = typer.Typer(
    help="Guided gage and type 1 studies: plan, next measurement, status, evaluation.", no_args_is_help=True
)

NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Name of the study.")]
PersonOption = Annotated[
    str | None,
    typer.Option("--by", metavar="PERSON", help="Name of the person. Default: the user of this computer."),
]


@guided_app.command()
def begin(
    name: NameArgument,
    kind: Annotated[
        str,
        typer.Option(
            "--kind",
            metavar="KIND",
            help="Kind of study: type1 (one unit of known value) or gage (several units and operators).",
        ),
    ],
    recipe: Annotated[
        str, typer.Option("--recipe", metavar="RECIPE", help="Recipe file, or the name of a shipped recipe.")
    ],
    part: Annotated[
        list[str],
        typer.Option(
            "--part", metavar="SN", help="Serial number of a unit; repeatable. On the virtual bench also SN=UNIT."
        ),
    ],
    metric: Annotated[
        list[str], typer.Option("--metric", metavar="ID", help="Metric of the recipe to evaluate; repeatable.")
    ],
    reference: Annotated[
        list[float] | None,
        typer.Option("--reference", metavar="X", help="Known value of the unit; one for each metric. Type 1 only."),
    ] = None,
    tolerance: Annotated[
        list[float] | None,
        typer.Option(
            "--tolerance",
            metavar="X",
            help="Tolerance: upper minus lower limit; one for each metric. Default: that of the recipe.",
        ),
    ] = None,
    operator: Annotated[
        list[str] | None, typer.Option("--operator", metavar="NAME", help="Name of an operator; repeatable.")
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(
            "--trials",
            metavar="N",
            min=1,
            help="Number of measurements of each unit by each operator. Default: 50 for type1, 3 for gage.",
        ),
    ] = None,
    share: Annotated[
        float,
        typer.Option(
            "--share",
            metavar="P",
            min=1.0,
            max=100.0,
            help="Share of the tolerance that the spread is compared with, for a type 1 study [%].",
        ),
    ] = 20.0,
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed",
            metavar="N",
            min=0,
            help="Seed of the random order of the measurements. Default: a random one, which the study keeps.",
        ),
    ] = None,
    bench: BenchOption = None,
    by: PersonOption = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Begin a study: check and keep its plan, with the order of its measurements."""
    from station.cli.quality import study
    from station.quality.guided.plan import Asked

    asked = Asked(
        kind=kind,
        recipe=recipe,
        bench=bench,
        parts=part,
        operators=operator or (),
        metrics=metric,
        references=reference or (),
        tolerances=tolerance or (),
        trials=trials,
        share=share,
        seed=seed,
    )
    raise typer.Exit(study.begin_and_tell(data, name, asked, by, as_json=as_json))


@guided_app.command("next")
def next_(
    name: NameArgument, by: PersonOption = None, data: DataOption = DEFAULT_DATA, as_json: JsonOption = False
) -> None:
    """Add the runs measured so far to a study, and print which unit is measured next, and by whom."""
    from station.cli.quality import study

    raise typer.Exit(study.tell_next(data, name, by, as_json=as_json))


@guided_app.command()
def measure(
    name: NameArgument,
    serial: Annotated[
        str | None,
        typer.Option(
            "--serial", metavar="SN", help="Scanned label of the unit on the bench. Required on a real bench."
        ),
    ] = None,
    operator: Annotated[
        str | None,
        typer.Option(
            "--operator",
            metavar="NAME",
            help="Name of the operator who measures, if the plan of the study names operators.",
        ),
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="On the virtual bench: measure every step that is left.")
    ] = False,
    virtual_time: Annotated[
        bool, typer.Option("--virtual-time", help="Simulate the virtual bench in this process.")
    ] = False,
    pace: Annotated[
        Pace, typer.Option("--pace", help="On the virtual bench: run in real time, or as fast as possible.")
    ] = Pace.deadlines,
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed",
            metavar="N",
            min=0,
            help="On the virtual bench: seed of the noise. Each step uses N plus its own number.",
        ),
    ] = None,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Measure the next step, as 'run' does with the recipe and bench of the study.

    Exit code as run; with --all 0 when every step is measured, else that of the run that does not count.
    """
    from station.cli.quality import study

    how = study.How(serial, operator, virtual_time, fast=pace is Pace.fast, seed=seed)
    raise typer.Exit(study.measure(data, name, how, every=every))


@guided_app.command()
def status(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Name of the study. Default: list all.")] = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Show how far a study is: what is measured, what is missing, which runs do not count and why.

    Exit code: 0 every step is measured, or all studies are listed; 1 steps are missing; 2 bad input.
    """
    from station.cli.quality import study

    raise typer.Exit(study.tell_status(data, name, as_json=as_json))


@guided_app.command()
def evaluate(
    name: NameArgument,
    by: PersonOption = None,
    level: LevelOption = 0.95,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Evaluate a study whose every step is measured.

    Exit code: 0 evaluated (type 1: capable), 1 a type 1 study is not capable, 2 steps are missing or bad input.
    """
    from station.cli.quality import study

    raise typer.Exit(study.evaluate_and_tell(data, name, by, level, as_json=as_json))
