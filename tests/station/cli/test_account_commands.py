"""`lostmotion recipes` and `lostmotion users`: the same actions, roles and audit lines as on the pages."""

from __future__ import annotations

import io
from contextlib import closing
from pathlib import Path

import pytest
from lostmotion_command import Ran, here
from station_support import GOLDEN, PASSWORD, open_database, write_models

from recipes import find_recipe
from station.records.revisions.history import History
from station.web.people import audit
from station.web.people.accounts import enter
from station.web.people.badges import enter_by_badge
from station.web.people.database import StationDatabase


@pytest.fixture
def data(tmp_path: Path) -> Path:
    found = tmp_path / "runs"
    write_models(found)
    open_database(found).close()
    return found


def load_text(name: str) -> str:
    return find_recipe(name).read_text("utf-8")


class Terminal:
    """What a person types and gets."""

    def __init__(self, data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.data, self.monkeypatch = data, monkeypatch

    def run(self, *words: str, role: str = "", typed: tuple[str, ...] = (PASSWORD,)) -> Ran:
        self.monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in typed)))
        who = ("--as", f"the {role}") if role else ()
        return here(*words, *who, "--data", str(self.data))

    def lines(self) -> list[tuple[str, str, str]]:
        with closing(StationDatabase(self.data)) as database, database.reading() as connection:
            found = audit.lines_of(connection, 50)
            return [(one["name"], one["action"], one["outcome"]) if isinstance(one, dict) else
                    (one.name, one.action, one.outcome) for one in found][::-1]  # fmt: skip


@pytest.fixture
def terminal(data: Path, monkeypatch: pytest.MonkeyPatch) -> Terminal:
    return Terminal(data, monkeypatch)


def test_a_recipe_is_released_by_a_second_person_without_a_screen(terminal: Terminal, tmp_path: Path) -> None:
    file = tmp_path / "new.yaml"
    file.write_text(GOLDEN.read_text("utf-8").replace("name: golden", "name: lathe-7"), encoding="utf-8")
    assert terminal.run("recipes", "save", str(file), role="engineer").exit_code == 0
    assert terminal.run("recipes", "ask", "lathe-7", "1", role="engineer").exit_code == 0
    own = terminal.run("recipes", "release", "lathe-7", "1", role="engineer")
    assert own.exit_code == 2, "nobody releases what they wrote"
    assert terminal.run("recipes", "release", "lathe-7", "1", role="operator").exit_code == 2
    assert terminal.run("recipes", "release", "lathe-7", "1", role="quality", typed=("wrong one",)).exit_code == 2
    assert "released" not in [one.state.value for one in History(terminal.data).all() if one.name == "lathe-7"]
    why = ("--reason", "the limit is too wide")
    assert terminal.run("recipes", "send-back", "lathe-7", "1", *why, role="quality").exit_code == 0
    assert "sent back by the quality: the limit is too wide" in terminal.run("recipes", "list").out
    assert terminal.run("recipes", "ask", "lathe-7", "1", role="engineer").exit_code == 0
    assert terminal.run("recipes", "release", "lathe-7", "1", role="quality").exit_code == 0
    (shown,) = (one for one in terminal.run("recipes", "list", "--json").json if one["name"] == "lathe-7")
    assert (shown["state"], shown["released_by"]) == ("released", "the quality")
    told = [line for line in terminal.lines() if line[1] == "release_recipe"]
    assert told == [
        ("the engineer", "release_recipe", "refused"),
        ("the operator", "release_recipe", "refused"),
        ("the quality", "release_recipe", "done"),
    ]
    assert ("the quality", "enter", "refused") in terminal.lines()
    assert terminal.run("recipes", "release", "none", "1", role="quality").exit_code == 2
    assert here("audit", "verify", "--data", str(terminal.data)).exit_code == 0


def test_the_text_of_a_recipe_is_shown_as_it_was_saved(terminal: Terminal, tmp_path: Path) -> None:
    shipped = terminal.run("recipes", "show", "rv-40e-121-quick")
    assert shipped.exit_code == 0
    assert shipped.out == load_text("rv-40e-121-quick"), "of the program, where nothing was saved"
    assert "rv-40e-121-quick revision 2, released by lostmotion" in shipped.err

    file = tmp_path / "new.yaml"
    file.write_text(GOLDEN.read_text("utf-8").replace("name: golden", "name: lathe-7"), encoding="utf-8")
    assert terminal.run("recipes", "save", str(file), role="engineer").exit_code == 0
    draft = terminal.run("recipes", "show", "lathe-7", "1")
    assert (draft.exit_code, draft.out) == (0, file.read_text("utf-8"))
    assert "lathe-7 revision 1, draft" in draft.err
    none_released = terminal.run("recipes", "show", "lathe-7")
    assert none_released.exit_code == 2
    assert "recipe lathe-7 has no released revision; its revisions are r1 (draft)" in none_released.err
    assert "has no revision 9; its revisions are r1 (draft)" in terminal.run("recipes", "show", "lathe-7", "9").err
    unknown = terminal.run("recipes", "show", "rv-40e-121-quik")
    assert unknown.exit_code == 2
    assert "Did you mean 'rv-40e-121-quick'?" in unknown.err


def test_accounts_and_badges_are_looked_after_without_a_screen(terminal: Terminal) -> None:
    first = ("users", "add", "Ada", "--role", "operator")
    assert terminal.run(*first, role="technician", typed=(PASSWORD, "the first one")).exit_code == 2
    assert terminal.run(*first, role="admin", typed=(PASSWORD, "the first one")).exit_code == 0
    changed = terminal.run("users", "password", "--as", "Ada", typed=("the first one", "of her own 1"))
    assert changed.exit_code == 0
    assert terminal.run("users", "badge", "Ada", role="admin", typed=(PASSWORD, "B-100042", "8305")).exit_code == 0
    with closing(StationDatabase(terminal.data)) as database:
        assert enter_by_badge(database, "B-100042", "8305", operator_alone=False).person.name == "Ada"
        assert enter(database, "Ada", "of her own 1").person.role == "operator"
    assert terminal.run("users", "withdraw-badge", "Ada", role="admin").exit_code == 0
    assert terminal.run("users", "disable", "Ada", role="admin").exit_code == 0
    assert terminal.run("users", "first").exit_code == 2


def test_a_station_without_accounts_gets_its_first_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal(tmp_path / "new", monkeypatch)
    assert terminal.run("users", "disable", "Ada", role="admin").exit_code == 2
    made = terminal.run("users", "first")
    password = made.out.split("password ")[1].split()[0]
    changed = terminal.run("users", "password", "--as", "admin", typed=(password, "good enough 9"))
    assert changed.exit_code == 0, changed.err


def test_a_start_condition_is_bypassed_without_a_screen(terminal: Terminal) -> None:
    add = ("bypass", "add", "master_parts", "--reason", "the part is at the calibration laboratory", "--hours", "4")
    refused = terminal.run(*add, role="operator")
    assert (refused.exit_code, "operator may not do this" in refused.err) == (2, True)
    assert terminal.run(*add, role="technician").exit_code == 0
    assert "bypassed by the technician" in terminal.run("bypass", "list").out
    rows = {one["condition"]: one["bypass"] for one in terminal.run("bypass", "list", "--json").json}
    assert [name for name, bypass in rows.items() if bypass] == ["master_parts"]
    assert "recipe_released" not in rows, "of those that nobody may set aside"
    assert terminal.run("bypass", "end", "master_parts", role="technician").exit_code == 0
    assert "bypassed" not in terminal.run("bypass", "list").out
    told = [line for line in terminal.lines() if "bypass" in line[1]]
    assert told == [
        ("the operator", "add_bypass", "refused"),
        ("the technician", "add_bypass", "done"),
        ("the technician", "end_bypass", "done"),
    ]


def test_a_station_that_only_a_line_has_used_says_that_it_has_no_accounts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = Terminal(tmp_path / "new", monkeypatch)
    StationDatabase(tmp_path / "new").close()
    assert "lostmotion users first" in terminal.run("users", "disable", "Ada", role="admin").err
    assert here("bypass", "list", "--data", str(tmp_path)).exit_code == 2
