"""`lostmotion recipes` and `lostmotion users`: actions of the pages, for a bench without a screen."""

# ruff: noqa: PLC0415, FBT002 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from station.cli.options import DEFAULT_DATA, DataOption, JsonOption
from station.cli.web.done_as import WhoOption, done_as
from station.errors import StationError

if TYPE_CHECKING:
    from pydantic import JsonValue

    from station.records.revisions.revision import Revision

recipes_app = typer.Typer(help="Recipes with their revisions: drafts, and their release by a second person.",
                          no_args_is_help=True)  # fmt: skip
users_app = typer.Typer(help="Accounts, passwords and badges of the station.", no_args_is_help=True)

NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Name of the account.")]
RecipeName = Annotated[str, typer.Argument(metavar="RECIPE", help="Name of the recipe.")]
RevisionArgument = Annotated[int, typer.Argument(metavar="REVISION", min=1, help="Revision of the recipe.")]


@recipes_app.command("list")
def recipes_list(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """List every revision of every recipe with its state."""
    from station.records.revisions.history import History

    history = History(data)
    rows = [
        (one.name, one.revision, one.state.value, one.released_by, one.sent_back_by, one.reason)
        for one in history.all()
    ]
    if as_json:
        names = ("name", "revision", "state", "released_by", "sent_back_by", "reason")
        sys.stdout.write(json.dumps([dict(zip(names, row, strict=True)) for row in rows], ensure_ascii=False) + "\n")
    else:
        told = (
            f"{name:32} r{number:<4} {state:15} {f'sent back by {back}: {why}' if back else by}"
            for name, number, state, by, back, why in rows
        )
        lines = [*history.problems, *told]
        sys.stdout.write("".join(f"{line}\n" for line in lines))


@recipes_app.command("show")
def recipes_show(
    name: RecipeName,
    revision: Annotated[
        int | None,
        typer.Argument(
            metavar="[REVISION]",
            min=1,
            show_default=False,
            help="Revision of the recipe. Default: the newest released one.",
        ),
    ] = None,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Print the text of a recipe as it was saved, to be copied and changed."""
    from station.records.revisions.history import History

    history = History(data)
    found = history.newest_released(name) if revision is None else history.find(name, revision)
    if found is None:
        raise StationError(_no_recipe(name, revision, history.all()))
    for problem in history.problems:
        sys.stderr.write(f"{problem}\n")
    by = f" by {found.released_by}" if found.released_by else ""
    sys.stderr.write(f"# {found.title}, {found.state.value}{by}\n")
    sys.stdout.buffer.write(found.text())


@recipes_app.command("save")
def recipes_save(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recipe file.")],
    who: WhoOption,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Save a recipe file as the draft of its revision."""
    from recipes.text.yaml_source import read_bytes

    done_as(data, who, "save_recipe", {"text": read_bytes(file).decode(errors="replace")})


@recipes_app.command("ask")
def recipes_ask(name: RecipeName, revision: RevisionArgument, who: WhoOption, data: DataOption = DEFAULT_DATA) -> None:
    """Ask for the release of a draft."""
    done_as(data, who, "ask_release", _as_read(data, name, revision))


@recipes_app.command("send-back")
def recipes_send_back(
    name: RecipeName,
    revision: RevisionArgument,
    who: WhoOption,
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="What the authors shall change.")],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Send a recipe back to its authors, whose release they have asked for."""
    done_as(data, who, "send_recipe_back", {**_as_read(data, name, revision), "reason": reason})


@recipes_app.command("release")
def recipes_release(
    name: RecipeName, revision: RevisionArgument, who: WhoOption, data: DataOption = DEFAULT_DATA
) -> None:
    """Release a recipe that another person has written. From then on, units are measured with it."""
    done_as(data, who, "release_recipe", _as_read(data, name, revision))


@users_app.command("first")
def users_first(data: DataOption = DEFAULT_DATA) -> None:
    """Make the first account of a station, and print its password. 'serve' does the same."""
    from station.web.people.accounts import FIRST_ACCOUNT, first_password
    from station.web.people.database import StationDatabase

    database = StationDatabase(data)
    with database.writing() as connection:
        password = first_password(connection)
    database.close()
    if password is None:
        raise StationError(f"{data}: has accounts already. An admin adds others with 'lostmotion users add'")
    sys.stdout.write(f"{FIRST_ACCOUNT}, password {password} (replace it first: lostmotion users password)\n")


@users_app.command("add")
def users_add(
    name: NameArgument,
    role: Annotated[str, typer.Option("--role", metavar="ROLE", help="Role of the account.")],
    who: WhoOption,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Add an account. Asks for a first password, which its owner replaces at the first log-in."""
    done_as(data, who, "add_person", {"name": name, "role": role}, password=f"first password of {name}")


@users_app.command("reset")
def users_reset(name: NameArgument, who: WhoOption, data: DataOption = DEFAULT_DATA) -> None:
    """Reopen a closed or locked account with a new first password."""
    done_as(data, who, "reset_person", {"name": name}, password=f"first password of {name}")


@users_app.command("disable")
def users_disable(name: NameArgument, who: WhoOption, data: DataOption = DEFAULT_DATA) -> None:
    """Close an account."""
    done_as(data, who, "disable_person", {"name": name})


@users_app.command("badge")
def users_badge(name: NameArgument, who: WhoOption, data: DataOption = DEFAULT_DATA) -> None:
    """Give a person a badge: its number is scanned or typed. It also needs a PIN of 4 to 12 digits."""
    done_as(data, who, "assign_badge", {"name": name}, badge="badge", pin="PIN")


@users_app.command("withdraw-badge")
def users_withdraw(name: NameArgument, who: WhoOption, data: DataOption = DEFAULT_DATA) -> None:
    """Take a person's badge away."""
    done_as(data, who, "withdraw_badge", {"name": name})


@users_app.command("password")
def users_password(who: WhoOption, data: DataOption = DEFAULT_DATA) -> None:
    """Change your own password."""
    done_as(data, who, "change_password", {}, old_password="", new_password="new password")  # noqa: S106 - questions


def _no_recipe(name: str, revision: int | None, there: list[Revision]) -> str:
    """Return why there is nothing to show, with the revisions or the name that may have been meant."""
    from recipes.text.problems import nearest, one_of

    own = [one for one in there if one.name == name]
    if own:
        found = "no released revision" if revision is None else f"no revision {revision}"
        has = ", ".join(f"r{one.revision} ({one.state.value})" for one in own)
        return (
            f"recipe {name} has {found}; its revisions are {has}. Name one of these: lostmotion recipes show {name} "
            f"{own[0].revision}"
        )
    names = list(dict.fromkeys(one.name for one in there))
    meant = nearest(name, names)
    hint = f"Did you mean '{meant}'?" if meant else "'lostmotion recipes list' shows all"
    return f"{name}: no recipe of this name; allowed: {one_of(names)}. {hint}"


def _as_read(data: Path, name: str, revision: int) -> dict[str, JsonValue]:
    """Return a revision as an action asks for it: with the hash of the text as it is now."""
    from station.records.revisions.history import History

    found = History(data).find(name, revision)
    if found is None:
        raise StationError(f"recipe {name} has no revision {revision}. 'lostmotion recipes list' shows all")
    return {"name": name, "revision": revision, "sha256": found.sha256}
