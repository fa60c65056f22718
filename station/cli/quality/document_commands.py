"""`lostmotion quality dfq`, `report` and `validation`: what is written for others, as files."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import (
    DEFAULT_DATA,
    DataOption,
    JsonOption,
    RecipeFilter,
)
from station.cli.quality.lot_options import (
    NEWEST,
    BenchFilter,
    ModelFilter,
    NewestOption,
    SinceOption,
    UntilOption,
    VirtualOption,
    lot_of,
)

documents_app = typer.Typer()


@documents_app.command("dfq")
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
    """Write the values of a lot as AQDEF, first attempts and retests; 'export --format dfq' does that for one run.

    Runs on another bench or by another recipe revision, limit or definition get a file of their own: lot-1.dfq, ...
    """
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
    from station.cli.quality.dfq import write_lot
    from station.cli.runs.export import program_name
    from station.quality.dfq.write import dfq_of_lot
    from station.quality.figures import left_out_of
    from station.store.quality.lot import production

    refuse_records(out)
    lot = lot_of(recipe, model, bench, since, until, virtual, newest)
    with production(data) as look:
        found = dfq_of_lot(look, lot, program_name())
        notes = left_out_of(look, lot)
    raise typer.Exit(write_lot(out, found, notes, as_json=as_json))


@documents_app.command("report")
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

    lot = lot_of(recipe, model, bench, since, until, virtual, newest)
    raise typer.Exit(batch.write_report(data, lot, out, loops, locale, as_json=as_json))


@documents_app.command()
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
    lot = lot_of(recipe, None, None, since, until, virtual)
    files = tuple(tests or ()), tuple(evidence or ())
    wanted = command.Wanted(bench, *files, parts, tuple(gage or ()), by, lot, self_test)
    raise typer.Exit(command.make(data, out, wanted, as_json=as_json))
