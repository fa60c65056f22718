"""The heap of a process that serves for weeks: what is freed goes back to the system, and its threads share one."""

from __future__ import annotations

import ctypes

M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8
"""Of glibc's `malloc.h`: see mallopt(3)."""

OWN_MAPPING_BYTES = 256 << 10


def keep_heap_small() -> bool:
    """Have the C library keep one heap for all threads, and large blocks apart from it; False where it has no such say.

    By itself glibc gives each thread a heap of its own, and raises the size above which a block is apart to that of the
    largest one freed so far. A heap then keeps the largest list or table that each thread ever held: a server of one
    bench grew by some 6 % in 5 000 units. Call it before the first thread starts.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    return bool(mallopt(M_ARENA_MAX, 1)) and bool(mallopt(M_MMAP_THRESHOLD, OWN_MAPPING_BYTES))
