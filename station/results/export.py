"""A stored run as a file of another program: Parquet, CSV, MATLAB and TDMS, every scan, with units and metadata.

The columns are those of the record: the image under its own names, the orders with `order_` before theirs, scan number,
time, lateness and work. Values are as recorded: torques before tare, angles before their zero; the tares and zeroes
are columns as well. SI units stand in the names and in the file's own metadata.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from controller.image import IMAGE_FIELDS, ORDERS_FIELDS
from station.record.check import Table
from station.record.scan_record import HEADER_FIELDS

ORDER_PREFIX = "order_"
GROUPS = ("record", "image", "orders")


class Column(NamedTuple):
    """One column: name, group of the record it comes from, unit ('' for numbers and bits), meaning, values."""

    name: str
    group: str
    unit: str
    meaning: str
    values: npt.NDArray[Any]


def columns_of(table: Table, period_ns: int) -> list[Column]:
    """Return all columns of a run, the time first."""
    time_s = table["scan"] * (period_ns * 1e-9)
    found = [Column("t_s", "record", "s", "time of the scan since the first period: scan * period", time_s)]
    sources = (
        ("record", "", HEADER_FIELDS, table),
        ("image", "", IMAGE_FIELDS, table["image"]),
        ("orders", ORDER_PREFIX, ORDERS_FIELDS, table["orders"]),
    )
    for group, prefix, fields, part in sources:
        found += [
            Column(prefix + field.name, group, field.unit, field.meaning, np.ascontiguousarray(part[field.name]))
            for field in fields
        ]
    return found


def write_parquet(path: Path, columns: list[Column], run: Mapping[str, Any]) -> None:
    """Write Parquet: unit, meaning and group in each field's metadata, the run as JSON in the schema's."""
    import pyarrow as pa  # noqa: PLC0415 - each format loads its own library, and only when it is asked for
    import pyarrow.parquet as pq  # noqa: PLC0415

    fields = [
        pa.field(
            one.name,
            pa.from_numpy_dtype(one.values.dtype),
            nullable=False,
            metadata={"unit": one.unit, "meaning": one.meaning, "group": one.group},
        )
        for one in columns
    ]
    schema = pa.schema(fields, metadata={"lostmotion": json.dumps(run, ensure_ascii=False)})
    arrays = [pa.array(one.values) for one in columns]
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
        "data": {one.name: one.values.reshape(-1, 1) for one in columns},
        "unit": {one.name: one.unit for one in columns},
        "meaning": {one.name: one.meaning for one in columns},
        "run": json.dumps(run, ensure_ascii=False),
    }
    # Struct fields may have 63 characters, variables only 31.
    savemat(path, content, long_field_names=True, do_compression=True)


def write_tdms(path: Path, columns: list[Column], run: Mapping[str, Any]) -> None:
    """Write TDMS: groups record, image and orders; unit and meaning as properties, with the waveform's time step."""
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter  # noqa: PLC0415

    properties = {key: value for key, value in run.items() if isinstance(value, str | int | float)}
    root = RootObject(properties={**properties, "lostmotion": json.dumps(run, ensure_ascii=False)})
    channels = [
        ChannelObject(one.group, one.name, one.values, {"unit_string": one.unit, "description": one.meaning})
        for one in columns
    ]
    with TdmsWriter(path) as writer:
        writer.write_segment([root, *(GroupObject(group) for group in GROUPS), *channels])


Writer = Callable[[Path, list[Column], Mapping[str, Any]], None]

FORMATS: dict[str, Writer] = {"parquet": write_parquet, "csv": write_csv, "mat": write_mat, "tdms": write_tdms}
"""Format, which is also the suffix of its file, and what writes it."""
