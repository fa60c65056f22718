"""A device profile that a bench file names and that is nowhere: where it is named, and which ones fit there."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from recipes.text.problems import OptionPath, RecipeError, Source, did_you_mean, excerpt, one_of
from recipes.text.yaml_source import read_source

KIND_OF_SECTION = {"drive": "cia402-drive", "can_devices": "can"}
"""Kind of a profile by the section of the bench file that names it; every other device is on Modbus."""

MODBUS = "modbus"


def missing_profile(name: str, bench_path: Path, shipped: Iterable[Path]) -> RecipeError:
    """Return the refusal of a profile that is nowhere, at every place of the bench file that names it.

    shipped: files of the profiles that come with the program.
    """
    bench = read_source(bench_path)
    kinds = {path.stem: _kind(path) for path in sorted(shipped)}
    own = [path.stem for path in (bench_path.parent / "profiles").glob("*.*")]
    problems = []
    for option in _naming(bench, name):
        wanted = KIND_OF_SECTION.get(str(option[0]), MODBUS)
        fitting = [one for one, kind in kinds.items() if kind == wanted]
        allowed = f"one in 'profiles' beside the bench file, or a shipped one: {one_of(fitting)}"
        hint = did_you_mean(name, [*own, *fitting])
        problems.append(bench.problem(option, f"the unknown profile {excerpt(name)}", allowed, hint))
    return RecipeError(problems)


def _kind(path: Path) -> str:
    """Return the kind that a profile says; one that is not YAML is the DBC file of a CAN sensor."""
    return str(read_source(path).data["profile"]["kind"]) if path.suffix == ".yaml" else "can"


def _naming(bench: Source, name: str) -> list[OptionPath]:
    """Return the options of a bench file that name this profile."""
    found = []
    for option in bench.marks:
        value = bench.data
        for part in option:
            value = value[part]
        if option[-1:] == ("profile",) and value == name:
            found.append(option)
    return found or [("drive", "profile")]
