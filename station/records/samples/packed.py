"""Samples of a concluded run as Parquet: a column for each channel, a row for each scan, bit for bit what was recorded.

Any program that reads Parquet reads the file. Columns are named as the channels, the orders with `order_` before their
names; unit, meaning and place in the record are in each field's metadata. The CRC of each record is not kept: it is
computed again, and the file is used only where that gave back exactly the bytes that were recorded.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from station.atomic_file import open_file
from station.documents.reading import NEXT_STEP
from station.errors import RecordError
from station.records.samples.check import checksums
from station.records.samples.layout import Channel, Layout
from station.records.samples.scan_record import CHECK_FIELD
from station.records.samples.table import Table

ORDER_PREFIX = "order_"
RECORD_KEY = "lostmotion_record"
"""Under which name the file's metadata has the size of a record and the channel that is computed."""

ZSTD_LEVEL = 3
"""A higher level takes more of the operator's time and saves 2 %: 12.4 MB become 2.6 in 0.03 s."""

GROUP_ROWS = 1 << 16
"""Records that are packed together, a minute at 1 ms: so much of a run is in memory a second time."""


def column_name(channel: Channel) -> str:
    """Return the name of a channel's column."""
    return f"{ORDER_PREFIX}{channel.name}" if channel.group == "orders" else channel.name


def _kept(layout: Layout) -> list[Channel]:
    return [one for one in layout.channels if (one.group, one.name) != ("record", CHECK_FIELD.name)]


def _encoding(channel: Channel) -> str | None:
    """Return how a column is laid out before it is compressed; None for a dictionary, which suits a few small numbers.

    All three are read by every reader of Parquet 2.
    """
    if channel.format == "d":
        return "BYTE_STREAM_SPLIT"
    return "DELTA_BINARY_PACKED" if channel.format in "iIqQ" else None


def packed(table: Table) -> bytes:
    """Return the records as a Parquet file."""
    import pyarrow as pa  # noqa: PLC0415 - loaded when a run is over, and not by those who record
    import pyarrow.parquet as pq  # noqa: PLC0415

    channels = _kept(table.layout)
    types = [pa.from_numpy_dtype(np.dtype(one.dtype)) for one in channels]
    fields = [
        pa.field(column_name(one), kind, nullable=False, metadata=_metadata(one))
        for one, kind in zip(channels, types, strict=True)
    ]
    size = json.dumps({"record_bytes": table.layout.record_bytes, "computed": CHECK_FIELD.name})
    schema = pa.schema(fields, metadata={RECORD_KEY: size})
    encodings = {column_name(one): _encoding(one) for one in channels}
    stream = io.BytesIO()
    options = {
        "compression": "zstd",
        "compression_level": ZSTD_LEVEL,
        "use_dictionary": [name for name, encoding in encodings.items() if encoding is None],
        "column_encoding": {name: encoding for name, encoding in encodings.items() if encoding is not None},
        "write_statistics": False,
    }
    with pq.ParquetWriter(stream, schema, **options) as writer:
        for start in range(0, max(len(table), 1), GROUP_ROWS):
            rows = table.rows[start : start + GROUP_ROWS]
            arrays = [pa.array(np.ascontiguousarray(_values(rows, one))) for one in channels]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
    return stream.getvalue()


def _metadata(channel: Channel) -> dict[str, str]:
    plain = channel.as_json()
    return {key: value if isinstance(value, str) else json.dumps(value) for key, value in plain.items()}


def _values(rows: npt.NDArray[Any], channel: Channel) -> npt.NDArray[Any]:
    part = rows if channel.group == "record" else rows[channel.group]
    return np.asarray(part[channel.name])


def unpacked(content: bytes, layout: Layout, place: Path) -> bytes:
    """Return the records of a Parquet file as the bytes that were recorded, CRCs computed again.

    Raises:
        RecordError: it is no such file, or not of this layout.

    """
    return b"".join(unpacked_parts(content, layout, place))


def unpacked_parts(content: bytes, layout: Layout, place: Path) -> Iterator[bytes]:
    """Yield what `unpacked` returns a part at a time: a run of an hour need not fit into memory several times."""
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.parquet as pq  # noqa: PLC0415

    channels = _kept(layout)
    names = [column_name(one) for one in channels]
    try:
        file = pq.ParquetFile(io.BytesIO(content))
        for number in range(file.num_row_groups):
            columns = _checked(file.read_row_group(number, columns=names, use_threads=False), channels, place)
            rows = np.zeros(len(columns[0]), dtype=layout.dtype)
            for channel, values in zip(channels, columns, strict=True):
                _values(rows, channel)[:] = values
            rows[CHECK_FIELD.name] = checksums(memoryview(rows.view(np.uint8).data), layout)
            yield rows.tobytes()
    except (OSError, KeyError, ValueError, pa.ArrowException) as error:
        raise _damaged(place, error) from error


def read_columns(path: Path, channels: Sequence[Channel]) -> list[npt.NDArray[Any]]:
    """Return some channels of a file, without reading the others; RecordError as `unpacked`."""
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.parquet as pq  # noqa: PLC0415

    try:
        with open_file(path) as file:
            found = pq.read_table(file, columns=[column_name(one) for one in channels], use_threads=False)
        return _checked(found, channels, path)
    except (OSError, KeyError, ValueError, pa.ArrowException) as error:
        raise _damaged(path, error) from error


def _damaged(place: Path, error: Exception) -> RecordError:
    return RecordError(f"{place}: is damaged: {' '.join(str(error).split())}")


def _checked(found: Any, channels: Sequence[Channel], place: Path) -> list[npt.NDArray[Any]]:
    """Return the columns of the channels as arrays; RecordError for one that is not of its channel's format."""
    arrays = []
    for channel in channels:
        column = found[column_name(channel)]
        array = column.to_numpy()
        if column.null_count or array.dtype != np.dtype(channel.dtype):
            raise RecordError(
                f"{place}: is damaged: column {column_name(channel)} is {column.type}; expected "
                f"{channel.format}, as in the description. {NEXT_STEP}"
            )
        arrays.append(array)
    return arrays
