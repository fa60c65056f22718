"""Runs that earlier code made, unpacked; and the same as versions with other channels would have recorded them."""

from __future__ import annotations

import shutil
import tarfile
from pathlib import Path

import numpy as np

from station.atomic_file import as_json
from station.records.run_record import RunRecord
from station.records.samples.check import checksums
from station.records.samples.layout import Channel, Layout, layout_in
from station.records.samples.samples import read_samples
from station.records.seal import fingerprint

FORMAT_1 = Path(__file__).parents[1] / "data" / "runs_format_1"
NAMES = tuple(sorted(path.name.partition(".")[0] for path in FORMAT_1.glob("*.tar.xz")))
CONCLUDED = tuple(name for name in NAMES if name != "deserted")


def unpack(data: Path) -> Path:
    """Unpack all runs of format 1 into a data folder, with its index."""
    data.mkdir(parents=True)
    for name in NAMES:
        with tarfile.open(FORMAT_1 / f"{name}.tar.xz") as archive:
            archive.extractall(data, filter="data")
    shutil.copy(FORMAT_1 / "index.jsonl", data)
    return data


def run_of(data: Path, name: str) -> RunRecord:
    (folder,) = data.glob(f"*-{name.upper()}")
    return RunRecord(folder)


def with_channels(run: RunRecord, *, more: tuple[Channel, ...] = (), less: frozenset[str] = frozenset()) -> None:
    """Rewrite a sealed raw run as a version would have recorded it that had some channels more, others less.

    The run is as if it had been concluded by that version. New channels stand before the others of their group and
    count the records; index and other files know nothing of it, so the index is to be removed.
    """
    before = read_samples(run)
    kept = [one for one in run.layout().channels if one.name not in less]
    rows = [*kept[:4], *more, *kept[4:]]
    at, placed = 0, []
    for one in rows:
        placed.append(one._replace(offset=at))
        at = placed[-1].end
    layout = Layout(tuple(placed), at)
    table = np.zeros(len(before), layout.dtype)
    for one in layout.channels:
        part = table if one.group == "record" else table[one.group]
        source = before.rows if one.group == "record" else before.rows[one.group]
        part[one.name] = source[one.name] if one not in [*placed[4 : 4 + len(more)]] else np.arange(len(before)) + 7
    table["crc32"] = checksums(memoryview(table.view(np.uint8).data), layout)
    run.samples.write_bytes(table.tobytes())
    said = layout.as_json() | {"format": 1}
    del said["format"]
    run.write_bytes("samples.json", as_json(said))
    assert layout_in(run.read_json("samples.json"), run.folder).record_bytes == at
    rewritten = {name: fingerprint(run.folder / name) for name in ("samples.bin", "samples.json")}
    run.update(files={**run.manifest().files, **rewritten})
    (run.folder.parent / "index.jsonl").unlink(missing_ok=True)
