"""Records of a virtual-time run: kept as they come, packed and written many at a time.

Packing one by one, between a step of the controller and one of the bench, costs more than twice as much: each pushes
the other out of the processor's caches. The values of the inputs are taken at once: the bench writes them anew.
"""

from __future__ import annotations

import zlib
from typing import Any

from definitions.image import Image, Orders, image_values
from station.atomic_file import Appender
from station.records.samples.scan_record import BODY_BYTES, BODY_STRUCT, CHECK_STRUCT, RECORD_BYTES

BLOCK_RECORDS = 256


class VirtualRecorder:
    """Appends records to a file; `append` has the signature that the scan loop wants."""

    def __init__(self, file: Appender) -> None:
        self._file = file
        self._waiting: list[tuple[int, int, int, int, tuple[Any, ...], Orders]] = []
        self._block = memoryview(bytearray(BLOCK_RECORDS * RECORD_BYTES))
        self._last = self._block[:0]
        self.sequence = 0

    def append(self, scan: int, lateness_ns: int, work_ns: int, image: Image, orders: Orders) -> bool:
        """Append one record; raises RecordError when the disk is full."""
        waiting = self._waiting
        waiting.append((self.sequence, scan, lateness_ns, work_ns, image_values(image), orders))
        self.sequence += 1
        if len(waiting) == BLOCK_RECORDS:
            self.flush()
        return True

    def last(self) -> memoryview:
        """Return the newest record, which is written with all before it; empty before the first."""
        self.flush()
        return self._last

    def flush(self) -> None:
        """Pack and write what waits; a record that cannot be packed raises after those before it have been written."""
        waiting, self._waiting = self._waiting, []
        block, at = self._block, 0
        try:
            for sequence, scan, lateness_ns, work_ns, inputs, orders in waiting:
                end = at + BODY_BYTES
                BODY_STRUCT.pack_into(block, at, sequence, scan, lateness_ns, work_ns, *inputs, *orders)
                CHECK_STRUCT.pack_into(block, end, zlib.crc32(block[at:end]))
                at += RECORD_BYTES
        finally:
            if at:
                self._last = block[at - RECORD_BYTES : at]
                self._file.write(block[:at])
