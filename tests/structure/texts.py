"""Every text of the product that a person sees, with its place, found in the code without running it.

A text is a message of an error that is raised, a sentence of the command line's help, a row of a table of the
vocabulary, or a line of screen and report. Parts that only the run knows stand as `…`; what a function names before it
raises is read with the error, and what was found and what is allowed stand as on the screen. For readers: fifty of them
drawn at random show what a stranger understands, `python tests/structure/texts.py SEED`.
"""

from __future__ import annotations

import ast
import random
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
ROOMS = ("definitions", "recipes", "controller", "drivers", "virtual_bench", "analysis", "station", "faultlab")
DRAWN = 50
LEFT_OPEN = "…"
LEAST_WORDS = {"error": 2, "help": 1, "table": 3, "line": 4}
"""Shorter texts of tables and lines are names, units and keys."""

TABLES = {"Fault", "Check", "LeavesOpen", "Metric", "Bad", "Grade", "Fit", "DeviceProof", "Protection"}
"""Rows of the vocabulary: every argument with words is read by people."""

SCREEN = {"print", "append", "add_row", "Text", "assemble", "paragraph", "section", "heading", "say", "echo", "note"}
PAGES = {"label", "button", "input", "number", "select", "tab", "set_text", "html", "notify", "refusal", "Action"}
LINES = SCREEN | PAGES | {"Finding", "Condition", "Grid", "tell"}
"""Calls that put words on screen, onto a page or into a report."""

READ_BY_MACHINES = ("<", "[Unit]", "default-src", "body{", "(params", "bold ", "\nmicro-")
"""Beginnings of what no person reads: drawings, styles, units of systemd and policies."""

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
STATEMENTS = (ast.stmt, ast.excepthandler, ast.match_case)

WHERE_LINES = (
    "station/cli/", "station/reports/", "station/run/", "station/results/", "station/web/", "station/commissioning/",
    "faultlab/",
)  # fmt: skip

WHERE_ALL_IS_SAID = "analysis/validity/"
"""A check says what failed in words of its own, built of parts over several lines: each sentence there is one."""


class Seen(NamedTuple):
    """A text with its kind (error, help, table, line) and its place `file:line`."""

    kind: str
    place: str
    text: str


def texts() -> list[Seen]:
    """Return all texts, each once, ordered by file and line."""
    paths = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    trees = {
        path.relative_to(ROOT).as_posix(): ast.parse(path.read_text("utf-8"))
        for path in paths
        if "migrations" not in path.parts  # statements for the database
    }
    constants = {name: dict(_constants(tree)) for name, tree in trees.items()}
    modules = [_Module(name, tree, _imported(tree, constants) | constants[name]) for name, tree in trees.items()]
    shared = {key: one for module in modules for key, one in module.refusals.items()}
    found: dict[str, Seen] = {}
    for module in modules:
        name = module.name
        for kind, line, text in _in_file(module, shared | module.refusals):
            if not text.startswith(READ_BY_MACHINES):
                found.setdefault(text, Seen(kind, f"{name}:{line}", text))
    return list(found.values())


def drawn(seed: int, among: list[Seen]) -> list[Seen]:
    """Return fifty texts drawn by a seed, in the order of their places."""
    return sorted(random.Random(seed).sample(among, DRAWN), key=lambda one: one.place)  # noqa: S311 - a draw for readers


def _constants(tree: ast.Module) -> Iterator[tuple[str, ast.Constant]]:
    """Yield the sentences that a module has by name, such as a next step that several errors end with."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            text = _words(node.value)
            if len(text.split()) > 1 and LEFT_OPEN not in text:
                yield node.targets[0].id, ast.Constant(text)


def _imported(tree: ast.Module, constants: dict[str, dict[str, ast.Constant]]) -> dict[str, ast.Constant]:
    """Return the sentences that a module imports, by the names that it gives them."""
    return {
        one.asname or one.name: there[one.name]
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and (there := constants.get(f"{(node.module or '').replace('.', '/')}.py"))
        for one in node.names
        if one.name in there
    }


class _Filled(ast.NodeTransformer):
    """Puts sentences in the place of their names."""

    def __init__(self, constants: dict[str, ast.Constant]) -> None:
        self._constants = constants

    def visit_Name(self, node: ast.Name) -> ast.expr:
        there = self._constants.get(node.id) if isinstance(node.ctx, ast.Load) else None
        return node if there is None else ast.copy_location(ast.Constant(there.value), node)


class _Module:
    """Syntax of a file, with its sentences in the place of their names; its nodes are listed once for all that look."""

    def __init__(self, name: str, tree: ast.Module, constants: dict[str, ast.Constant]) -> None:
        self.name, self.tree, self.nodes = name, tree, list(ast.walk(tree))
        if any(node.id in constants for node in self.nodes if isinstance(node, ast.Name)):
            _Filled(constants).visit(tree)
            self.nodes = list(ast.walk(tree))
        self.refusals = _refusals(self.nodes)


def _refusals(nodes: Sequence[ast.AST]) -> dict[str, list[str]]:
    """Return the parameters of each function and class that is told what was found and what is allowed."""
    told: dict[str, list[str]] = {}
    for node in nodes:
        if not isinstance(node, ast.ClassDef | ast.FunctionDef):
            continue
        inside = node.body if isinstance(node, ast.ClassDef) else [node]
        for maker in (
            one for one in inside if isinstance(one, ast.FunctionDef) and one.name in {node.name, "__init__"}
        ):
            names = [one.arg for one in maker.args.args if one.arg not in {"self", "cls"}]
            if {"found", "allowed"} <= set(names):
                told[node.name] = names
    return told


def _in_file(module: _Module, refusals: dict[str, list[str]]) -> Iterator[tuple[str, int, str]]:
    for raised, named in _raises(module.tree, {}):
        yield from _raised(raised, named, refusals)
    for node in module.nodes:
        if isinstance(node, ast.FunctionDef) and any(_is_command(one) for one in node.decorator_list):
            told = ast.get_docstring(node)
            if told:
                yield "help", node.lineno, told
        elif isinstance(node, ast.Call):
            yield from _of_call(module.name, node)
        elif isinstance(node, ast.Return | ast.Yield) and node.value is not None:
            yield from _said("line", node.value, [node.value])
    if module.name.startswith(WHERE_ALL_IS_SAID):
        yield from _sentences(module.tree)
    for node in module.tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            rows = node.value.values if isinstance(node.value, ast.Dict) else [node.value]
            yield from _said("line", node.value, rows)


def _raises(tree: ast.AST, named: dict[str, str]) -> Iterator[tuple[ast.Call, dict[str, str]]]:
    """Yield each call that is raised, with the texts that its function has named by then."""
    for node in ast.iter_child_nodes(tree):
        if not isinstance(node, STATEMENTS):
            continue  # an expression raises nothing and names nothing
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            yield node.exc, named
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and (text := _words(node.value)):
            named[node.targets[0].id] = text
        yield from _raises(node, dict(named) if isinstance(node, FUNCTIONS) else named)


def _raised(call: ast.Call, named: dict[str, str], refusals: dict[str, list[str]]) -> Iterator[tuple[str, int, str]]:
    """An error is read as a whole: what was found, what is allowed, and what to do are parts of one text."""
    called = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    parts = [named.get(one.id, "") if isinstance(one, ast.Name) else _words(one) for one in call.args]
    if called in refusals:
        told = dict(zip(refusals[called], parts, strict=False))
        text = f"found {told.get('found') or LEFT_OPEN}; allowed: {told.get('allowed') or LEFT_OPEN}"
        hint = told.get("hint", "")
        text += f"{'. ' if hint[0].isupper() else '; '}{hint}" if hint else ""
        written = " ".join(parts)
    else:
        text = written = "; ".join(one for one in parts if any(map(str.isalpha, one)))
    if len(written.split()) >= LEAST_WORDS["error"] and any(map(str.isalpha, written)):
        yield "error", call.lineno, text


def _of_call(name: str, call: ast.Call) -> Iterator[tuple[str, int, str]]:
    called = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    options = [one.value for one in call.keywords if one.arg in {"help", "epilog"}]
    if options:
        yield from _said("help", call, options)
    elif name.startswith("definitions/") and called in TABLES:
        yield from _said("table", call, [*call.args, *(one.value for one in call.keywords)])
    elif name.startswith(WHERE_LINES) and called in LINES:
        yield from _said("line", call, [*call.args, *(one.value for one in call.keywords)])


def _sentences(node: ast.AST) -> Iterator[tuple[str, int, str]]:
    """Yield every sentence below a node, as a whole; docstrings are for readers of the code, errors are told apart."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Raise) or (isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant)):
            continue
        if isinstance(child, ast.expr) and _words(child):
            yield from _said("line", child, [child])
        else:
            yield from _sentences(child)


def _is_command(decorator: ast.expr) -> bool:
    target = decorator.func if isinstance(decorator, ast.Call) else decorator
    return isinstance(target, ast.Attribute) and target.attr in {"command", "callback"}


def _said(kind: str, at: ast.expr, parts: Sequence[ast.expr]) -> Iterator[tuple[str, int, str]]:
    for part in parts:
        text = _words(part)
        if text and len(text.split()) >= LEAST_WORDS[kind] and any(map(str.isalpha, text)):
            yield kind, getattr(part, "lineno", at.lineno), text


def _words(node: ast.expr) -> str:
    """Return the text of a literal, an f-string, or a sum of both; nothing for anything else."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.FormattedValue) and isinstance(node.value, ast.Constant):
        return _words(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(_words(part) or LEFT_OPEN for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        sides = [_words(side) for side in (node.left, node.right)]
        return "".join(side or LEFT_OPEN for side in sides) if any(sides) else ""
    return ""


if __name__ == "__main__":
    everything = texts()
    sys.stdout.write(f"{len(everything)} texts\n")
    for number, one in enumerate(drawn(int(sys.argv[1]), texts()), start=1):
        sys.stdout.write(f"{number:2}. {one.kind:5} {one.place}\n    {one.text}\n")
