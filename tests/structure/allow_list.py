"""Contracts of import-linter that say what a package or a process may import; everything else is refused.

A list of what is forbidden grows with every new package and is forgotten; a list of what is allowed is not.
"""

from __future__ import annotations

import sys
from typing import Any

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


class AllowList(Contract):
    """The modules of `package` import each other and `allowed`: packages, ours and others', by whole name or room.

    `future` and `typing` are no exception: the list is complete. With `ours` true it is of our packages only. Rooms in
    `apart` have a list of their own.
    """

    type_name = "allow_list"

    package = fields.StringField()
    allowed = fields.SetField(subfield=fields.StringField())
    apart = fields.SetField(subfield=fields.StringField(), required=False, default=set())
    ours = fields.BooleanField(required=False, default=False)

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:  # noqa: ARG002, FBT001 - import-linter's signature
        """Find every import of the package that no allowed one covers."""
        package: Any = self.package
        allowed: Any = self.allowed
        apart: Any = self.apart
        refused = refused_imports(graph, package, {package, *allowed}, apart)
        if self.ours:
            refused = [one for one in refused if not graph.is_module_squashed(one[1])]
        return ContractCheck(kept=not refused, metadata={"refused": refused})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Name each refused import with its place."""
        for importer, imported, line in check.metadata["refused"]:
            output.print_error(f"{importer} imports {imported} (line {line})", bold=False)
        output.print_error(f"allowed: {', '.join(sorted(self.allowed))}", bold=False)  # type: ignore[call-overload]


class ReachList(Contract):
    """What a process brings into its memory: each of `modules`, and all that they import, directly or through others.

    Every import among them is of an `allowed` package or of the standard library.
    """

    type_name = "reach_list"

    modules = fields.SetField(subfield=fields.StringField())
    allowed = fields.SetField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:  # noqa: ARG002, FBT001 - import-linter's signature
        """Find every import on the way from the modules that no allowed package covers."""
        modules: Any = self.modules
        allowed: Any = self.allowed
        refused = refused_reach(graph, modules, {*modules, *allowed, *sys.stdlib_module_names})
        return ContractCheck(kept=not refused, metadata={"refused": refused})

    render_broken_contract = AllowList.render_broken_contract


def refused_reach(graph: ImportGraph, modules: set[str], allowed: set[str]) -> list[tuple[str, str, int]]:
    """Return importer, imported module and line of each import that comes with `modules` and is on no allowed one."""
    found, seen, waiting = [], set(), sorted(modules)
    while waiting:
        importer = waiting.pop()
        if importer in seen or importer not in graph.modules or graph.is_module_squashed(importer):
            continue
        seen.add(importer)
        waiting += [importer.rpartition(".")[0]]  # its package is imported before it
        for imported in sorted(graph.find_modules_directly_imported_by(importer)):
            if _within(imported, allowed):
                waiting.append(imported)
            else:
                details = graph.get_import_details(importer=importer, imported=imported)
                found.append((importer, imported, int(details[0]["line_number"])))
    return sorted(found)


def refused_imports(
    graph: ImportGraph, package: str, allowed: set[str], apart: set[str] | frozenset[str] = frozenset()
) -> list[tuple[str, str, int]]:
    """Return importer, imported module and line of each import of a package that is on no allowed package."""
    found = []
    for importer in sorted({package, *graph.find_descendants(package)}):
        if _within(importer, apart):
            continue
        for imported in sorted(graph.find_modules_directly_imported_by(importer)):
            if not _within(imported, allowed):
                details = graph.get_import_details(importer=importer, imported=imported)
                found.append((importer, imported, int(details[0]["line_number"])))
    return found


def _within(module: str, packages: set[str] | frozenset[str]) -> bool:
    return any(module == name or module.startswith(f"{name}.") for name in packages)
