"""One scan as one fixed-size binary record: its layout, derived from the field tables of the process image.

Little-endian without padding: sequence, scan, wake-up latency, work, the `Image`, the `Orders`, and a CRC-32 over all
of it. `sequence` counts records and has no gaps; `scan` counts periods and jumps over the missed ones.
"""

from __future__ import annotations

import struct
import zlib

from definitions.image import (
    IMAGE_FIELDS,
    IMAGE_STRUCT,
    ORDERS_FIELDS,
    ORDERS_STRUCT,
    Field,
    Image,
    Orders,
    image_values,
)

HEADER_FIELDS: tuple[Field, ...] = (
    Field("sequence", "Q", "", "number of the record, without gaps from 0"),
    Field("scan", "Q", "scans", "number of the period; time is scan * period"),
    Field("lateness_ns", "q", "ns", "time of waking after the deadline; 0 in virtual time"),
    Field("work_ns", "I", "ns", "time from waking until the orders were written; 0 in virtual time"),
)
CHECK_FIELD = Field("crc32", "I", "", "CRC-32 (zlib) of the bytes before it")

HEADER_FORMAT = "".join(field.format for field in HEADER_FIELDS)
BODY_STRUCT = struct.Struct("<" + HEADER_FORMAT + IMAGE_STRUCT.format[1:] + ORDERS_STRUCT.format[1:])
CHECK_STRUCT = struct.Struct("<" + CHECK_FIELD.format)
RECORD_STRUCT = struct.Struct(BODY_STRUCT.format + CHECK_FIELD.format)

FIELDS_IN_ORDER: tuple[tuple[str, tuple[Field, ...]], ...] = (
    ("record", HEADER_FIELDS),
    ("image", IMAGE_FIELDS),
    ("orders", ORDERS_FIELDS),
    ("record", (CHECK_FIELD,)),
)
"""The fields of a record, each with the group that it belongs to."""

BODY_BYTES = BODY_STRUCT.size
RECORD_BYTES = BODY_BYTES + CHECK_STRUCT.size

IMAGE_FIRST = len(HEADER_FIELDS)
ORDERS_FIRST = IMAGE_FIRST + len(IMAGE_FIELDS)

MAX_WORK_NS = 0xFFFF_FFFF


def unpack(record: bytes | memoryview) -> tuple[int, Image, Orders]:
    """Return scan, image and orders of one record (not checked here: see `record_check`)."""
    values = BODY_STRUCT.unpack_from(record)
    return values[1], Image(*values[IMAGE_FIRST:ORDERS_FIRST]), Orders(*values[ORDERS_FIRST:])


def pack(header: tuple[int, int, int, int], image: Image, orders: Orders) -> bytes:
    """Return one record as bytes; `header` is sequence, scan, wake-up latency [ns], work [ns]."""
    sequence, scan, lateness_ns, work_ns = header
    body = BODY_STRUCT.pack(sequence, scan, lateness_ns, min(work_ns, MAX_WORK_NS), *image_values(image), *orders)
    return body + CHECK_STRUCT.pack(zlib.crc32(body))
