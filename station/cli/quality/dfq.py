"""`lostmotion quality dfq --out`: a lot as AQDEF, one file or as many as its runs need."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from station.atomic_file import write_atomic
from station.cli.out_file import refuse_records, writing
from station.cli.runs.export import DFQ
from station.counted import counted
from station.errors import StationError
from station.quality.dfq.write import WrittenLot


def write_lot(out: Path, found: WrittenLot, notes: Sequence[str], *, as_json: bool) -> int:
    """Write a lot and tell each file, what is in it and of what, and the notes; return 0.

    One file has the name that was asked for; of several each has its number behind it, and a file of the name itself,
    which is of something else, is refused: a program that reads it would take it for the whole lot.

    Raises:
        StationError: such a file is there, or one cannot be written.

    """
    many = len(found.files) > 1
    if many and out.exists():
        raise StationError(
            f"--out {out}: this lot needs {len(found.files)} files, {_path(out, 1).name} and so on, as its runs differ "
            "in bench, model, recipe revision, limits or definitions. A file of this name is there from before: move "
            "it away or choose another name"
        )
    paths = [_path(out, number) if many else out for number in range(1, len(found.files) + 1)]
    for path in paths:
        refuse_records(path)
    for path, one in zip(paths, found.files, strict=True):
        with writing(path):
            write_atomic(path, one.content)
    told = list(zip(paths, found.files, strict=True))
    if as_json:
        files = [
            {"file": str(path), "of": one.what, "runs": one.runs, "characteristics": one.characteristics}
            for path, one in told
        ]
        document = {"format": DFQ, "files": files, "runs": sum(one.runs for one in found.files)}
        document |= {} if many else {name: files[0][name] for name in ("file", "characteristics")}
        sys.stdout.write(json.dumps({**document, "left_out": found.left_out}, ensure_ascii=False) + "\n")
        sys.stderr.writelines(f"{note}\n" for note in notes)
        return 0
    lines = [
        f"{path}: {counted(one.runs, 'run')}, {counted(one.characteristics, 'characteristic')}; {one.what}"
        for path, one in told
    ]
    lines += [f"left out: {counted(found.left_out, 'run')} without a metric"] if found.left_out else []
    lines += [
        "Runs that differ in bench, model, recipe revision, limits or definitions are in files of their own"
    ] * many
    lines += notes
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    return 0


def _path(out: Path, number: int) -> Path:
    return out.with_name(f"{out.stem}-{number}{out.suffix}")
