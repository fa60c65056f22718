"""What the station knows the entries of is a class; a dictionary of anything has a name, and a reason beside it."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
MAPPINGS = {"dict", "Mapping", "MutableMapping"}
ANYTHING = {"Any", "object"}

NAMED = {
    "station/archive/full_rows.py": {"Row"},
    "station/archive/place.py": {"Options"},
    "station/commissioning/trial_run.py": {"Sections"},
    "station/documents/entries.py": {"Plain"},
    "station/log.py": {"Event"},
    "station/records/chain/entries.py": {"Fields"},
    "station/results/evaluation.py": {"Channels"},
    "station/store/tables.py": {"Row"},
    "station/web/pages/loop_figure.py": {"Figure"},
    "station/web/pages/quality_figures.py": {"Options"},
    "station/web/rest/answers.py": {"Documented"},
}
"""Every name for a dictionary of anything, where it stands. What JSON, YAML or a library is spoken to with has one."""


def _of_anything(node: ast.AST) -> bool:
    """Say whether an expression is a mapping of text to anything."""
    if not (isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Tuple)):
        return False
    named = [one.id if isinstance(one, ast.Name) else "" for one in (node.value, *node.slice.elts)]
    return named[0] in MAPPINGS and named[1] == "str" and named[2] in ANYTHING


def names_and_places(text: str) -> tuple[dict[str, bool], list[int]]:
    """Return the names for such a dictionary, with whether a reason stands below each, and lines of all others."""
    tree = ast.parse(text)
    names = {}
    for one, following in zip(tree.body, [*tree.body[1:], None], strict=True):
        if isinstance(one, ast.Assign) and _of_anything(one.value) and isinstance(one.targets[0], ast.Name):
            reason = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            names[one.targets[0].id] = reason
    of_names = {id(one.value) for one in tree.body if isinstance(one, ast.Assign)}
    places = [one.lineno for one in ast.walk(tree) if _of_anything(one) and id(one) not in of_names]
    return names, sorted(places)


def test_no_dictionary_of_anything_travels_without_a_name_and_a_reason() -> None:
    found, without = {}, []
    for path in sorted((ROOT / "station").rglob("*.py")):
        place = path.relative_to(ROOT).as_posix()
        names, lines = names_and_places(path.read_text("utf-8"))
        if names:
            found[place] = set(names)
        without += [f"{place}:{line}" for line in lines]
        without += [f"{place}: {name} has no reason" for name, reason in names.items() if not reason]
    assert without == []
    assert found == NAMED


def test_a_dictionary_of_anything_is_seen_wherever_it_stands() -> None:
    text = "def f(a: Mapping[str, object]) -> list[dict[str, Any]]:\n    b: dict[str, Any] = {}\n"
    assert names_and_places(text) == ({}, [1, 1, 2])
    assert names_and_places('Name = dict[str, Any]\n"""Why."""\n') == ({"Name": True}, [])
    assert names_and_places("Name = dict[str, Any]\nb = 1\n") == ({"Name": False}, [])
    assert names_and_places("a: dict[str, int]\n") == ({}, [])
