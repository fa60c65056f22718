"""`lostmotion labels`: what the printer does, how a label comes out, one more of it, and a template to begin with."""

# ruff: noqa: PLC0415, FBT002 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Annotated

import typer

from station.cli.options import DEFAULT_DATA, DataOption, JsonOption
from station.cli.web.done_as import WhoOption, done_as

if TYPE_CHECKING:
    from pathlib import Path

    from station.web.labels.outbox import Awaited
    from station.web.labels.settings import Labels

RunOfLabel = Annotated[
    str, typer.Argument(metavar="RUN", help="Id of a stored run, or a serial number: its newest run.")
]
labels_app = typer.Typer(help="Labels for units; a label is printed when a run is concluded.", no_args_is_help=True)


def _labels(data: Path) -> Labels:
    from station.errors import StationError
    from station.web.labels.settings import FILE, load_labels

    found = load_labels(data)
    if found is None:
        raise StationError(f"{data / FILE}: is missing, so no labels are printed. Write this file: see docs/labels.md")
    return found


@labels_app.command("status")
def labels_status(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """Show whether the printer is ready, and which label is not on its unit yet. Prints nothing."""
    from station.web.labels.printer import PrinterError, connected

    labels = _labels(data)
    printer = labels.settings.printer
    try:
        with connected(printer.host, printer.port, printer.timeout_s) as line:
            status = line.status()
        trouble, waiting = status.trouble, status.waiting
    except PrinterError as error:
        trouble, waiting = str(error), 0
    found = _awaited(data, labels)
    if as_json:
        label = None if found is None else found._asdict()
        told = {"printer": {"trouble": trouble, "waiting": waiting}, "label": label}
        sys.stdout.write(json.dumps(told, ensure_ascii=False) + "\n")
    else:
        sys.stdout.write(
            f"printer  {trouble or 'ready'}\nwaiting  {waiting} in the printer\nlabel    {found or 'none is awaited'}\n"
        )
    raise typer.Exit(1 if trouble else 0)


def _awaited(data: Path, labels: Labels) -> Awaited | None:
    from station.web.labels.outbox import awaited
    from station.web.people.database import FILE, StationDatabase

    if not (data / FILE).is_file():
        return None  # no station was served here
    database = StationDatabase(data)
    try:
        with database.reading() as connection:
            return awaited(connection, labels)
    finally:
        database.close()


@labels_app.command("preview")
def labels_preview(
    run: RunOfLabel,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Write the ZPL of a run's label to standard output. Nothing is printed."""
    from station.errors import StationError
    from station.records.data_folder import Store
    from station.results.sealed_runs import result_of
    from station.web.labels.of_run import label_of

    labels = _labels(data)
    record = Store(data).find(run)
    altered, result = result_of(data, record.id)
    if result is None:
        raise StationError(
            f"run {run} has no usable result ({altered[0] if altered else 'it was not concluded'}), so no label is made"
        )
    label, reads_as = label_of(data, record.manifest(), result, labels, 1)
    sys.stdout.write(label + ("" if label.endswith("\n") else "\n"))
    if reads_as:
        sys.stderr.write(f"reads as  {reads_as}\n")


@labels_app.command("template")
def labels_template() -> None:
    """Write the shipped template to standard output: copy and edit it for your own."""
    from station.web.labels.settings import SHIPPED

    sys.stdout.write(SHIPPED.read_text(encoding="utf-8"))


@labels_app.command("again")
def labels_again(
    run: RunOfLabel,
    who: WhoOption,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Print the label of a run once more, by whatever prints labels: 'serve' or 'line'."""
    done_as(data, who, "print_label", {"run": _run_of(data, run)})


@labels_app.command("aside")
def labels_aside(
    run: RunOfLabel,
    who: WhoOption,
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why the unit goes without a label.")],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Release a unit whose label was not scanned, with a reason."""
    done_as(data, who, "set_label_aside", {"run": _run_of(data, run), "reason": reason})


def _run_of(data: Path, run: str) -> str:
    from station.records.data_folder import Store

    return Store(data).find(run).id
