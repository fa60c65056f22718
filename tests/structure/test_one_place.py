"""What is decided in one place is not decided in another one as well: looked for in the syntax of every module."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("definitions", "controller", "drivers", "recipes", "analysis", "virtual_bench", "station", "faultlab")


@cache
def _modules() -> tuple[tuple[str, list[ast.AST]], ...]:
    """Return every module by its place, as all nodes of its syntax."""
    paths = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    return tuple(
        (path.relative_to(ROOT).as_posix(), list(ast.walk(ast.parse(path.read_text("utf-8"))))) for path in paths
    )


def _names(node: ast.expr) -> set[str]:
    """Names in an expression: attributes, keys and variables."""
    found = {one.attr for one in ast.walk(node) if isinstance(one, ast.Attribute)}
    found |= {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
    return found | {one.value for one in ast.walk(node) if isinstance(one, ast.Constant) and isinstance(one.value, str)}


def _subtracts_a_zero(node: ast.AST) -> bool:
    if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub)):
        return False
    return any(name.endswith("_tare_nm") or name == "ZEROES" for name in _names(node.right))


def test_a_tare_is_subtracted_in_two_places_one_for_the_scan_and_one_for_the_record() -> None:
    found = {name for name, nodes in _modules() if any(map(_subtracts_a_zero, nodes))}
    assert found == {"controller/sample.py", "station/records/samples/zeroes.py"}


def test_a_subtraction_is_seen_however_it_is_written() -> None:
    for text in ("a - b.torque_in_tare_nm", "a['x'] - b['torque_out_tare_nm']", "a - (tare.torque_in_tare_nm + 1)"):
        assert _subtracts_a_zero(ast.parse(text, mode="eval").body), text


LISTED = 3
"""States side by side in one expression that make it a set of states, which has its place in their table."""


def _lists_states(node: ast.AST) -> bool:
    if not isinstance(node, ast.Tuple | ast.Set | ast.List):
        return False
    named = [one.value for one in node.elts if isinstance(one, ast.Attribute) and isinstance(one.value, ast.Name)]
    return len([name for name in named if name.id in ("S", "State")]) >= LISTED


def test_sets_of_states_are_read_off_their_table() -> None:
    found = {name for name, nodes in _modules() if any(map(_lists_states, nodes))}
    assert found <= {"definitions/states.py"}


def test_a_list_of_states_is_seen() -> None:
    assert _lists_states(ast.parse("(S.LOCK, State.RAMP_POS, S.UNLOAD)", mode="eval").body)
    assert not _lists_states(ast.parse("(S.LOCK, State.RAMP_POS)", mode="eval").body)


READS = ("read_bytes", "read_text")
ROOMS = ("archive", "bench", "cli/runs", "opcua", "records", "reevaluation", "reports", "results", "run", "store")
ROOMS_OF_RECORDS = tuple(f"station/{room}/" for room in ROOMS)
NO_RECORD = {
    "station/bench/eds_profile.py",  # a file that a person names, of a drive
    "station/records/process_birth.py",  # of the kernel
    "station/results/export_origin.py",  # a file that a person names
    "station/run/children.py",  # what a process of this one has just written
    "station/store/places.py",  # of the kernel
}


def _reads_whatever_is_there(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in READS


def test_a_file_of_a_record_is_opened_where_a_pipe_in_its_place_is_refused() -> None:
    found = {
        name
        for name, nodes in _modules()
        if name.startswith(ROOMS_OF_RECORDS) and any(map(_reads_whatever_is_there, nodes))
    }
    assert found == NO_RECORD


def test_a_reading_of_whatever_is_there_is_seen() -> None:
    assert _reads_whatever_is_there(ast.parse("(run.folder / name).read_bytes()", mode="eval").body)
    assert not _reads_whatever_is_there(ast.parse("read_file(run.folder / name)", mode="eval").body)
