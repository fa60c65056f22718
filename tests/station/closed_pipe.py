"""A pipe whose reader has gone, as behind `| head`."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import TextIO


@contextlib.contextmanager
def read_by_nobody() -> Iterator[TextIO]:
    """Yield a stream that refuses each line that is written to it: BrokenPipeError."""
    reads, writes = os.pipe()
    os.close(reads)
    stream = os.fdopen(writes, "w")
    try:
        yield stream
    finally:
        with contextlib.suppress(BrokenPipeError):
            stream.close()
