"""Records of a virtual-time run: packed into one preallocated block, written whenever it is full."""

from __future__ import annotations

import zlib

from controller.image import Image, Orders
from station.durable import Appender
from station.record.scan_record import BODY_BYTES, BODY_STRUCT, CHECK_STRUCT, RECORD_BYTES

BLOCK_RECORDS = 2048


class VirtualRecorder:
    """Appends records to a file; `append` has the signature that the scan loop wants."""

    def __init__(self, file: Appender) -> None:
        self._file = file
        self._block = bytearray(BLOCK_RECORDS * RECORD_BYTES)
        self._view = memoryview(self._block)
        self._at = 0
        self.sequence = 0

    def append(self, scan: int, lateness_ns: int, work_ns: int, image: Image, orders: Orders) -> bool:
        """Append one record; raises RecordError when the disk is full."""
        at = self._at
        end = at + BODY_BYTES
        view = self._view
        BODY_STRUCT.pack_into(view, at, self.sequence, scan, lateness_ns, work_ns, *image, *orders)
        CHECK_STRUCT.pack_into(view, end, zlib.crc32(view[at:end]))
        self.sequence += 1
        self._at = at + RECORD_BYTES
        if self._at == len(view):
            self.flush()
        return True

    def last(self) -> memoryview:
        """Return the newest record, still in the block or just written from it; empty before the first."""
        end = self._at or (len(self._view) if self.sequence else 0)
        return self._view[max(end - RECORD_BYTES, 0) : end]

    def flush(self) -> None:
        """Write what is in the block."""
        self._file.write(self._view[: self._at])
        self._at = 0
