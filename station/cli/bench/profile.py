"""`lostmotion profile from-eds`: profiles drafted from the EDS files of drives, and what each drive lacks."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import typer

from recipes import RecipeError
from station.atomic_file import write_atomic
from station.bench.eds_profile import ENDINGS, Draft, draft, eds_files
from station.cli.out_file import refuse_records
from station.errors import StationError

EXIT_UNUSABLE = 1


def from_eds(place: Path, out: Path | None, *, as_json: bool) -> int:
    """Draft a profile for each EDS or DCF file; 1 when a drive cannot be used, or a file of a folder not be read.

    Raises:
        RecipeError: the one file that was named cannot be read.
        StationError: there is no such file, no EDS in the folder, or a draft cannot be written.

    """
    if out is not None:
        refuse_records(out / "profile.yaml")
    if not place.exists():
        raise StationError(f"{place}: there is no such file or folder")
    files = eds_files(place)
    if not files:
        raise StationError(f"{place}: no file in it ends with {' or '.join(ENDINGS)}")
    drafts, unreadable = _drafts(files, place)
    _write(drafts, out)
    if as_json:
        rows = [asdict(one) | {"source": str(one.source)} for one in drafts]
        typer.echo(json.dumps({"drafts": rows, "unreadable": unreadable}, ensure_ascii=False))
    else:
        for one in drafts:
            _say(one, out)
        for text in unreadable:
            typer.echo(text)
        if len(files) > 1:
            typer.echo(f"{len(drafts)} of {len(files)} files drafted")
    return EXIT_UNUSABLE if unreadable or any(one.refused for one in drafts) else 0


def _drafts(files: list[Path], place: Path) -> tuple[list[Draft], list[str]]:
    """Draft a profile of each file that can be read; why the others cannot, unless the one was named itself."""
    drafts: list[Draft] = []
    unreadable: list[str] = []
    for file in files:
        try:
            drafts.append(draft(file))
        except RecipeError as error:
            if file == place:
                raise
            unreadable.append(str(error))
    return drafts, unreadable


def _write(drafts: list[Draft], out: Path | None) -> None:
    if out is None:
        return
    taken: dict[str, Path] = {}
    for one in drafts:
        other = taken.setdefault(one.name, one.source)
        path = out / f"{one.name}.yaml"
        if other != one.source:
            raise StationError(f"{path}: {other} and {one.source} would both be written there. Rename one of them")
        if path.exists():
            raise StationError(f"{path}: this file is there already, and is not overwritten")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StationError(f"{out}: {error.strerror or error}") from error
    for one in drafts:
        write_atomic(out / f"{one.name}.yaml", one.text.encode())


def _say(one: Draft, out: Path | None) -> None:
    if out is None:
        typer.echo(one.text)
    else:
        typer.echo(f"{one.source}: drafted {out / one.name}.yaml")
    for heading, texts in (
        ("cannot be used", one.refused),
        ("this drive lacks", one.lacks),
        ("the file does not tell", one.open_places),
    ):
        for text in texts:
            typer.echo(f"# {heading}: {text}")
