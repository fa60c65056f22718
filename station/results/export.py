"""A stored run as a file of another program: Parquet, CSV, MATLAB and TDMS, every scan, with units and metadata.

First come the columns of the trace, by which `lostmotion analyze` evaluates the file as it does the run: torques tared,
angles from their zero, and what each row is for. Then those of the record, with values as recorded: the image under its
own names, or with `image_` before a name that the trace has; the orders with `order_` before theirs; scan number,
wake-up latency and work. SI units stand in the names and in the file's own metadata.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from analysis.trace.segment_names import UNUSED, segment_names
from analysis.trace.trace import CHANNELS
from definitions.image import IMAGE_FIELDS
from definitions.program import Segment
from recipes import Bench
from station.documents.entries import plain
from station.documents.exported import ExportedRun
from station.records.program_file import SegmentRow
from station.records.samples.packed import ORDER_PREFIX
from station.records.samples.scan_record import CHECK_FIELD
from station.records.samples.table import Table
from station.records.samples.value_names import CODED, Coded, Names
from station.records.samples.zeroes import ZEROES
from station.results.evaluation import AS_RECORDED, evaluated, measured_channels, segment_table

IMAGE_PREFIX = "image_"
GROUPS = ("trace", "record", "image", "orders")

RUN_KEY = "lostmotion"
"""Under which name Parquet and TDMS hold what is said of the run; beside a CSV file it is `run`."""


class Column(NamedTuple):
    """One column: name, group of the record it comes from, unit ('' for numbers and bits), meaning, values, names."""

    name: str
    group: str
    unit: str
    meaning: str
    values: npt.NDArray[Any]
    coded: Coded = Coded()

    def names(self) -> dict[str, dict[str, str]]:
        """Return what the numbers stand for as JSON has it: `values` or `bits`, number and name; empty for others."""
        return self.coded.as_json()


def columns_of(table: Table, period_ns: int, measured: Sequence[Column] = ()) -> list[Column]:
    """Return all columns of a run, the time first, then those of its trace (`trace_columns`)."""
    time_s = table["scan"] * (period_ns * 1e-9)
    found = [Column("t_s", "trace", "s", "time of the scan since the first period: scan * period", time_s), *measured]
    sources = (("record", "", table.rows), ("image", "", table["image"]), ("orders", ORDER_PREFIX, table["orders"]))
    for group, prefix, part in sources:
        # By the record's own layout: what today's version does not know leaves with the rest.
        for one in table.layout.group(group):
            if (group, one.name) == ("record", CHECK_FIELD.name):
                continue
            # A reader of traces must not take a torque before tare for the torque.
            before = IMAGE_PREFIX if group == "image" and one.name in CHANNELS else prefix
            coded = one.coded if any(one.coded) else CODED.get((group, one.name), Coded())
            values = np.ascontiguousarray(part[one.name])
            found.append(Column(before + one.name, group, one.unit, one.meaning, values, coded))
    return found


def trace_columns(table: Table, segments: Sequence[SegmentRow | Segment], bench: Bench) -> list[Column]:
    """Return the trace of a run on every row, but for its time: the channels that the bench has, and the segments.

    segments: the program's segment table.
    """
    units = {field.name: field.unit for field in IMAGE_FIELDS}
    less = {name: f", less {ORDER_PREFIX}{zero}" for name, zero in ZEROES.items()}
    found = [
        Column(name, "trace", units[AS_RECORDED.get(name, name)], CHANNELS[name] + less.get(name, ""), values)
        for name, values in measured_channels(table, bench).items()
    ]
    there, rows = np.unique(table["orders"]["segment"], return_inverse=True)
    known, used = segment_table(segments), evaluated(table)
    # Segments of a program follow each other by their number; one without a sample does not part its neighbours.
    seen = np.unique(rows[used])
    names = segment_names([int(key) for key in there[seen] if int(key) in known], known)
    # A row without a name cannot be evaluated: its segment is not in the program.
    texts = np.array([names.get(int(key), UNUSED) for key in there], dtype=np.str_)[rows]
    meaning = (
        "role, direction of torque and cycle, and what counts the ramps and holds of a branch in steps; "
        f"{UNUSED}: not measuring, or a scan without a new sample"
    )
    return [*found, Column("segment", "trace", "", meaning, np.where(used, texts, UNUSED))]


def write_parquet(path: Path, columns: list[Column], run: ExportedRun) -> None:
    """Write Parquet: unit, meaning, group and names in each field's metadata, the run as JSON in the schema's."""
    import pyarrow as pa  # noqa: PLC0415 - each format loads its own library, and only when it is asked for
    import pyarrow.parquet as pq  # noqa: PLC0415

    arrays = [pa.array(one.values) for one in columns]
    fields = [
        pa.field(
            one.name,
            array.type,
            nullable=False,
            metadata={"unit": one.unit, "meaning": one.meaning, "group": one.group} | _names_as_text(one),
        )
        for one, array in zip(columns, arrays, strict=True)
    ]
    schema = pa.schema(fields, metadata={RUN_KEY: run_json(run)})
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), path, compression="zstd")


class CsvStyle(NamedTuple):
    """What stands between the columns, and the decimal sign."""

    separator: str
    decimal: str


LOCALES: dict[str, CsvStyle] = {"en": CsvStyle(",", "."), "de": CsvStyle(";", ",")}
"""How a spreadsheet of a language takes a CSV file by a double click; most of the others do as one of these."""


def write_csv(path: Path, columns: list[Column], run: ExportedRun, style: CsvStyle = LOCALES["en"]) -> None:
    """Write CSV with one header row; units, meanings, names and the run go to a JSON file beside it.

    Numbers are written so that they read back exactly. `lostmotion analyze` reads the file as it is.
    """
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.compute as pc  # noqa: PLC0415
    import pyarrow.csv as pa_csv  # noqa: PLC0415

    def written(values: Any) -> Any:
        array = pa.array(values)
        if style.decimal == "." or not pa.types.is_floating(array.type):
            return array
        return pc.replace_substring(array.cast(pa.string()), ".", style.decimal)

    table = pa.Table.from_arrays([written(one.values) for one in columns], names=[one.name for one in columns])
    options = pa_csv.WriteOptions(quoting_style="none", quoting_header="none", delimiter=style.separator)
    pa_csv.write_csv(table, path, options)
    described = [
        {"name": one.name, "group": one.group, "unit": one.unit, "meaning": one.meaning} | one.names()
        for one in columns
    ]
    beside = sidecar(path)
    beside.write_text(
        json.dumps({"run": plain(run), "columns": described}, ensure_ascii=False, indent=1) + "\n",
        encoding="utf-8",
    )


def sidecar(path: Path) -> Path:
    """Return the JSON file that belongs to a CSV file."""
    return path.with_name(path.name + ".json")


def write_mat(path: Path, columns: list[Column], run: ExportedRun) -> None:
    """Write MATLAB 5 .mat: structs `data`, `unit` and `meaning` with a field per column, and `run` as JSON text.

    `values` and `bits` have a field per column whose numbers have names: `number`, a vector, and `name`, a cell array,
    as `categorical(data.order_state, values.order_state.number, values.order_state.name)` wants them.
    """
    from scipy.io import savemat  # noqa: PLC0415

    content = {
        # Text is a matrix of characters with a row per scan.
        "data": {one.name: one.values if _is_text(one) else one.values.reshape(-1, 1) for one in columns},
        "unit": {one.name: one.unit for one in columns},
        "meaning": {one.name: one.meaning for one in columns},
        "values": {one.name: _vectors(one.coded.values) for one in columns if one.coded.values},
        "bits": {one.name: _vectors(one.coded.bits) for one in columns if one.coded.bits},
        "run": run_json(run),
    }
    # Struct fields may have 63 characters, variables only 31.
    savemat(path, content, long_field_names=True, do_compression=True)


def run_json(run: ExportedRun) -> str:
    """Return what a file says of its run, as JSON."""
    return json.dumps(plain(run), ensure_ascii=False)


def _names_as_text(column: Column) -> dict[str, str]:
    return {kind: json.dumps(names) for kind, names in column.names().items()}


def _vectors(names: Names) -> dict[str, npt.NDArray[np.generic]]:
    return {"number": np.array(list(names), dtype=float), "name": np.array(list(names.values()), dtype=object)}


def time_step_s(columns: list[Column]) -> float | None:
    """Return the time from row to row [s]; None where periods were missed, so that there is no single one."""
    time_s = columns[0].values
    scans = next(one.values for one in columns if one.name == "scan").astype(np.int64)
    if len(scans) < 2 or np.any(np.diff(scans) != 1):
        return None
    return round(float(time_s[-1] - time_s[0]) / (len(scans) - 1), 12)


def write_tdms(path: Path, columns: list[Column], run: ExportedRun) -> None:
    """Write TDMS: groups trace, record, image and orders; unit, meaning and names as properties.

    Where no period was missed every channel is a waveform with its time step; otherwise `t_s` alone has the time.
    """
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter  # noqa: PLC0415

    properties = {key: value for key, value in plain(run).items() if isinstance(value, str | int | float)}
    root = RootObject(properties={**properties, RUN_KEY: run_json(run)})
    step_s = time_step_s(columns)
    waveform: dict[str, float] = {}
    if step_s is not None:
        start_s = float(columns[0].values[0])
        waveform = {"wf_increment": step_s, "wf_start_offset": start_s, "wf_samples": len(columns[0].values)}
    channels = [
        ChannelObject(
            one.group,
            one.name,
            one.values.tolist() if _is_text(one) else one.values,
            {"unit_string": one.unit, "description": one.meaning} | _names_as_text(one) | waveform,
        )
        for one in columns
    ]
    with TdmsWriter(path) as writer:
        writer.write_segment([root, *(GroupObject(group) for group in GROUPS), *channels])


def _is_text(column: Column) -> bool:
    return column.values.dtype.kind == "U"


Writer = Callable[[Path, list[Column], ExportedRun], None]

FORMATS: dict[str, Writer] = {"parquet": write_parquet, "csv": write_csv, "mat": write_mat, "tdms": write_tdms}
"""Format, which is also the suffix of its file, and what writes it."""
