"""A stored run as a file of another program: Parquet, CSV, MATLAB and TDMS, every scan, with units and metadata.

First come the columns of the trace, by which `lostmotion analyze` evaluates the file as it does the run: torques tared,
angles from their zero, and what each row is for. Then those of the record, with values as recorded: the image under its
own names, or with `image_` before a name that the trace has; the orders with `order_` before theirs; scan number,
lateness and work. SI units stand in the names and in the file's own metadata.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from analysis import UNUSED, segment_name
from analysis.trace import CHANNELS
from controller.image import IMAGE_FIELDS, ORDERS_FIELDS
from recipes import Bench
from station.record.check import Table
from station.record.scan_record import HEADER_FIELDS
from station.results.evaluation import AS_RECORDED, ZEROES, evaluated, measured_channels, segment_table

IMAGE_PREFIX = "image_"
ORDER_PREFIX = "order_"
GROUPS = ("trace", "record", "image", "orders")

RUN_KEY = "lostmotion"
"""Under which name Parquet and TDMS hold what is said of the run; beside a CSV file it is `run`."""


class Column(NamedTuple):
    """One column: name, group of the record it comes from, unit ('' for numbers and bits), meaning, values."""

    name: str
    group: str
    unit: str
    meaning: str
    values: npt.NDArray[Any]


def columns_of(table: Table, period_ns: int, measured: Sequence[Column] = ()) -> list[Column]:
    """Return all columns of a run, the time first, then those of its trace (`trace_columns`)."""
    time_s = table["scan"] * (period_ns * 1e-9)
    found = [Column("t_s", "trace", "s", "time of the scan since the first period: scan * period", time_s), *measured]
    sources = (
        ("record", "", HEADER_FIELDS, table),
        ("image", "", IMAGE_FIELDS, table["image"]),
        ("orders", ORDER_PREFIX, ORDERS_FIELDS, table["orders"]),
    )
    for group, prefix, fields, part in sources:
        for field in fields:
            # A reader of traces must not take a torque before tare for the torque.
            before = IMAGE_PREFIX if group == "image" and field.name in CHANNELS else prefix
            values = np.ascontiguousarray(part[field.name])
            found.append(Column(before + field.name, group, field.unit, field.meaning, values))
    return found


def trace_columns(table: Table, segments: list[dict[str, Any]], bench: Bench) -> list[Column]:
    """Return the trace of a run on every row, but for its time: the channels that the bench has, and the segments.

    segments: the program's segment table, as in program.json.
    """
    units = {field.name: field.unit for field in IMAGE_FIELDS}
    less = {name: f", less {ORDER_PREFIX}{zero}" for name, zero in ZEROES.items()}
    found = [
        Column(name, "trace", units[AS_RECORDED.get(name, name)], CHANNELS[name] + less.get(name, ""), values)
        for name, values in measured_channels(table, bench).items()
    ]
    names = {key: segment_name(info) for key, info in segment_table(segments).items()}
    # A row without a name cannot be evaluated: its segment is not in the program.
    there, rows = np.unique(table["orders"]["segment"], return_inverse=True)
    texts = np.array([names.get(int(key), UNUSED) for key in there], dtype=np.str_)[rows]
    meaning = f"role, direction of torque and cycle; {UNUSED}: not measuring, or a scan without a new sample"
    return [*found, Column("segment", "trace", "", meaning, np.where(evaluated(table), texts, UNUSED))]


def write_parquet(path: Path, columns: list[Column], run: Mapping[str, Any]) -> None:
    """Write Parquet: unit, meaning and group in each field's metadata, the run as JSON in the schema's."""
    import pyarrow as pa  # noqa: PLC0415 - each format loads its own library, and only when it is asked for
    import pyarrow.parquet as pq  # noqa: PLC0415

    arrays = [pa.array(one.values) for one in columns]
    fields = [
        pa.field(
            one.name,
            array.type,
            nullable=False,
            metadata={"unit": one.unit, "meaning": one.meaning, "group": one.group},
        )
        for one, array in zip(columns, arrays, strict=True)
    ]
    schema = pa.schema(fields, metadata={RUN_KEY: json.dumps(run, ensure_ascii=False)})
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), path, compression="zstd")


def write_csv(path: Path, columns: list[Column], run: Mapping[str, Any]) -> None:
    """Write CSV with one header row; units, meanings and the run go to a JSON file beside it.

    Numbers are written so that they read back exactly. `lostmotion analyze` reads the file as it is.
    """
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.csv as pa_csv  # noqa: PLC0415

    table = pa.Table.from_arrays([pa.array(one.values) for one in columns], names=[one.name for one in columns])
    options = pa_csv.WriteOptions(quoting_style="none", quoting_header="none")
    pa_csv.write_csv(table, path, options)
    described = [{"name": one.name, "group": one.group, "unit": one.unit, "meaning": one.meaning} for one in columns]
    beside = sidecar(path)
    beside.write_text(
        json.dumps({"run": run, "columns": described}, ensure_ascii=False, indent=1) + "\n",
        encoding="utf-8",
    )


def sidecar(path: Path) -> Path:
    """Return the JSON file that belongs to a CSV file."""
    return path.with_name(path.name + ".json")


def write_mat(path: Path, columns: list[Column], run: Mapping[str, Any]) -> None:
    """Write MATLAB 5 .mat: structs `data`, `unit` and `meaning` with a field per column, and `run` as JSON text."""
    from scipy.io import savemat  # noqa: PLC0415

    content = {
        # Text is a matrix of characters with a row per scan.
        "data": {one.name: one.values if _is_text(one) else one.values.reshape(-1, 1) for one in columns},
        "unit": {one.name: one.unit for one in columns},
        "meaning": {one.name: one.meaning for one in columns},
        "run": json.dumps(run, ensure_ascii=False),
    }
    # Struct fields may have 63 characters, variables only 31.
    savemat(path, content, long_field_names=True, do_compression=True)


def write_tdms(path: Path, columns: list[Column], run: Mapping[str, Any]) -> None:
    """Write TDMS: groups trace, record, image and orders; unit and meaning as properties."""
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter  # noqa: PLC0415

    properties = {key: value for key, value in run.items() if isinstance(value, str | int | float)}
    root = RootObject(properties={**properties, RUN_KEY: json.dumps(run, ensure_ascii=False)})
    channels = [
        ChannelObject(
            one.group,
            one.name,
            one.values.tolist() if _is_text(one) else one.values,
            {"unit_string": one.unit, "description": one.meaning},
        )
        for one in columns
    ]
    with TdmsWriter(path) as writer:
        writer.write_segment([root, *(GroupObject(group) for group in GROUPS), *channels])


def _is_text(column: Column) -> bool:
    return column.values.dtype.kind == "U"


Writer = Callable[[Path, list[Column], Mapping[str, Any]], None]

FORMATS: dict[str, Writer] = {"parquet": write_parquet, "csv": write_csv, "mat": write_mat, "tdms": write_tdms}
"""Format, which is also the suffix of its file, and what writes it."""
