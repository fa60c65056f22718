"""`lostmotion bypass`: start conditions that are set aside for some hours, for a bench without a screen."""

# ruff: noqa: PLC0415, FBT002 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

import json
import sys
from typing import Annotated

import typer

from station.cli.options import DEFAULT_DATA, DataOption, JsonOption
from station.cli.web.done_as import WhoOption, done_as

bypass_app = typer.Typer(help="Bypasses of start conditions, for some hours and with a reason.", no_args_is_help=True)

ConditionArgument = Annotated[
    str, typer.Argument(metavar="CONDITION", help="Start condition, as 'lostmotion bypass list' names it.")
]


@bypass_app.command("list")
def bypass_list(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """List the start conditions that can be bypassed, and each bypass that counts now."""
    from station.errors import StationError
    from station.web.bypasses import ALLOWED, bypasses_now
    from station.web.people.database import FILE, StationDatabase
    from station.web.permission import CONDITIONS

    if not (data / FILE).is_file():
        raise StationError(
            f"folder {data} has no {FILE}, so no station was served from it. Name another folder with --data"
        )
    database = StationDatabase(data)
    with database.reading() as connection:
        now = {one.condition: one for one in bypasses_now(connection)}
    database.close()
    titles = {one.id: one.title for one in CONDITIONS if one.id in ALLOWED}
    if as_json:
        rows = [
            {"condition": name, "title": title, "bypass": now[name]._asdict() if name in now else None}
            for name, title in titles.items()
        ]
        sys.stdout.write(json.dumps(rows, ensure_ascii=False) + "\n")
        return
    for name, title in titles.items():
        sys.stdout.write(f"{name:22} {title}\n")
        sys.stdout.write(f"{'':22} {now[name]}\n" if name in now else "")


@bypass_app.command("add")
def bypass_add(
    condition: ConditionArgument,
    who: WhoOption,
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why the condition is bypassed.")],
    hours: Annotated[float, typer.Option("--hours", metavar="H", help="For how long, 24 h at most.")],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Bypass a start condition for some hours. Each run that was started only because of it says so."""
    done_as(data, who, "add_bypass", {"condition": condition, "reason": reason, "hours": hours})


@bypass_app.command("end")
def bypass_end(condition: ConditionArgument, who: WhoOption, data: DataOption = DEFAULT_DATA) -> None:
    """End the bypass of a start condition."""
    done_as(data, who, "end_bypass", {"condition": condition})
