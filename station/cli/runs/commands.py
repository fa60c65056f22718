"""Commands that look at what was measured."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import (
    DEFAULT_DATA,
    ChosenMetricOption,
    DataOption,
    JsonOption,
    PresetOption,
    RecipeFilter,
    RunArgument,
    SerialFilter,
    TraceArgument,
)


def list_runs(
    limit: Annotated[int, typer.Option("--limit", metavar="N", min=1, help="Number of newest runs to list.")] = 50,
    everything: Annotated[bool, typer.Option("--all", help="List all runs.")] = False,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """List the stored runs, newest last, and name what is missing or altered."""
    from station.cli.runs import list_runs as command_list

    raise typer.Exit(command_list.list_runs(data, None if everything else limit, as_json=as_json))


def runs(
    serial: SerialFilter = None,
    recipe: RecipeFilter = None,
    verdict: Annotated[
        str | None, typer.Option("--verdict", metavar="V", help="Only PASS, FAIL or 'NOT DECIDABLE'.")
    ] = None,
    since: Annotated[
        str | None,
        typer.Option("--since", metavar="DATE", help="Only runs from this time on: 2026-01-31 or 2026-01-31T08:00."),
    ] = None,
    as_csv: Annotated[bool, typer.Option("--csv", help="All columns, as CSV on standard output.")] = False,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Write the CSV to a file.")] = None,
    locale: Annotated[
        str,
        typer.Option("--locale", metavar="L", help="Spreadsheet for the CSV: en or de (semicolons, decimal commas)."),
    ] = "en",
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Show all concluded runs with their metrics, a row for each: on the screen, or as CSV for a spreadsheet."""
    from station.cli.runs import run_table as command_runs
    from station.store.stored_runs import Wanted

    wanted = Wanted(serial=serial, recipe=recipe, verdict=verdict, since=since)
    raise typer.Exit(command_runs.runs(data, wanted, out, locale, as_csv=as_csv, as_json=as_json))


def show(
    name: RunArgument,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Show a stored run."""
    from station.cli.runs import show as command_show

    raise typer.Exit(command_show.show(name, data, as_json=as_json))


def report(
    name: RunArgument,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder to write to. Default: that of the run.")
    ] = None,
    open_it: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Write the report of a stored run, as HTML that stands alone and as PDF."""
    from station.cli.runs import report as command_report

    raise typer.Exit(command_report.report(name, data, out, open_it=open_it, as_json=as_json))


def analyze(
    trace: TraceArgument,
    recipe: Annotated[
        str | None,
        typer.Option(
            "--recipe", metavar="RECIPE", help="Recipe for the evaluation. Default for a stored run: its own recipe."
        ),
    ] = None,
    bench: Annotated[
        str | None,
        typer.Option(
            "--bench",
            metavar="FILE",
            help="Bench file of the bench on which the file was recorded; it gives fixture and calibrations.",
        ),
    ] = None,
    preset: PresetOption = None,
    metric: ChosenMetricOption = None,
    monte_carlo: Annotated[
        int,
        typer.Option(
            "--monte-carlo",
            metavar="N",
            min=0,
            max=100_000,
            help="Number of Monte Carlo draws for the uncertainty, 50 or more.",
        ),
    ] = 0,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Compute metrics and verdict of a trace. Exit code as run."""
    from recipes import Selection
    from station.cli.runs import analyze as command_analyze

    selection = Selection(preset, tuple(metric or ()))
    raise typer.Exit(
        command_analyze.analyze(trace, recipe, bench, data, as_json=as_json, selection=selection, draws=monte_carlo)
    )


def reevaluate(
    where: Annotated[
        list[str] | None,
        typer.Option(
            "--where",
            metavar="NAME=VALUE",
            help="Only runs of this recipe, model, bench, serial, operator, verdict, since or until; may be repeated.",
        ),
    ] = None,
    recipe: Annotated[
        str | None,
        typer.Option("--recipe", metavar="NEW", help="Evaluate with another recipe. Reads the whole records."),
    ] = None,
    preset: PresetOption = None,
    metric: ChosenMetricOption = None,
    limits: Annotated[
        str | None,
        typer.Option(
            "--limits",
            metavar="TEXT",
            help='Evaluate with other limits of one metric, as in "lost_motion max=0.9" or "stiffness_at branch=mean '
            'min=10 guard=0.5"; min and max are in the unit of the metric. guard is the guard band as a multiple of '
            "the uncertainty U, and no width; 0: no guard band.",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option("--workers", metavar="N", min=1, help="Number of parallel processes. Default: one for each core."),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            "--cluster", metavar="ADDRESS", help="Ray cluster, HOST:PORT, or 'local'; RAY_AUTH_TOKEN must be set."
        ),
    ] = None,
    archive: Annotated[
        bool,
        typer.Option("--archive", help="Read all runs from the archive, even those that are in the data folder too."),
    ] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="A row for each run, as CSV on standard output.")] = False,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Evaluate many stored runs by another recipe, metric definition or limit; no stored verdict is changed.

    What was evaluated is not evaluated again: the command may be ended and started anew.
    Exit code: 0, 1 some runs could not be evaluated, 2 bad input.
    """
    from station.cli.runs import reevaluate as command_reevaluate

    asked = command_reevaluate.Asked(
        recipe, preset, tuple(metric or ()), limits, tuple(where or ()), cluster, workers, archive
    )
    raise typer.Exit(command_reevaluate.reevaluate_runs(data, asked, as_csv=as_csv, as_json=as_json))


def metrics(preset: PresetOption = None, as_json: JsonOption = False) -> None:
    """List the definitions of all metrics and the presets, or of one preset. Exit code: 0, or 2 for no such preset."""
    from station.cli.runs import metrics as command_metrics

    raise typer.Exit(command_metrics.metrics(preset, as_json=as_json))


def export(
    name: RunArgument,
    file_format: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="FORMAT",
            help="File format: parquet, csv, mat or tdms for all samples; dfq for the measured values (AQDEF).",
        ),
    ] = "parquet",
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="File or folder to write. Default: RUN.FORMAT in this folder."),
    ] = None,
    locale: Annotated[
        str,
        typer.Option("--locale", metavar="LOCALE", help="CSV for spreadsheets in this language: en, or de (0,5; 1,5)."),
    ] = "en",
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Write every scan of a run as Parquet, CSV, MATLAB or TDMS, with units and metadata."""
    from station.cli.runs import export as command_export

    raise typer.Exit(command_export.export(name, data, file_format, out, locale=locale, as_json=as_json))


def replay(
    name: RunArgument,
    recipe: Annotated[
        str | None,
        typer.Option(
            "--recipe",
            metavar="OTHER",
            help="What if: replay and evaluate the run with another recipe, up to the first difference.",
        ),
    ] = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Step the controller through a record and compare every order, byte for byte.

    Exit code: 0 identical, 1 not (the first differing scan is printed), 2 bad input or a damaged record, 3 identical,
    but the record was altered after the run. With --recipe: 0 nothing would have changed, 1 something would have, 2 as
    above, 3 nothing can be said, because the replay differs or the record was altered.
    """
    from station.cli.runs import replay as command_replay

    raise typer.Exit(command_replay.replay_run(name, data, recipe, as_json=as_json))


def verify(
    data: DataOption = DEFAULT_DATA,
    key: Annotated[
        list[str] | None,
        typer.Option("--key", metavar="KEY", help="Accept only signatures by this public key; may be repeated."),
    ] = None,
    bench: Annotated[
        str | None, typer.Option("--bench", metavar="FILE", help="Bench file that contains the public key.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Faster: compare only the size of the sample files, not their content.")
    ] = False,
    code: Annotated[
        str | None, typer.Option("--code", metavar="TEXT", help="Check a certificate by its code, instead of runs.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check that no run is missing or altered: the chain, its signatures and every file.

    With --code: is a certificate genuine, altered or unknown?
    Exit code: 0 passed, 1 not, 2 bad input.
    """
    from station.cli.runs import verify as command_verify

    if code is not None:
        raise typer.Exit(command_verify.verify_code(data, code, key or [], bench, as_json=as_json))
    raise typer.Exit(command_verify.verify(data, key or [], bench, samples=not quick, as_json=as_json))


def key(
    trust: Annotated[
        str | None, typer.Option("--trust", metavar="KEY", help="Trust the public key of another bench.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the public key by which this computer signs runs."""
    from station.cli.runs import verify as command_verify

    raise typer.Exit(command_verify.key(trust, as_json=as_json))
