"""A server keeps what it uses: one heap for all its threads, and large blocks that go back to the system."""

import ctypes
import json
import os
import subprocess
import sys

import pytest

HEAPS_AND_BLOCKS = """
import ctypes, json, sys, threading
from pathlib import Path
from station.heap import keep_heap_small

class Mallinfo2(ctypes.Structure):  # mallinfo(3)
    _fields_ = [(name, ctypes.c_size_t) for name in (
        "arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost")]

libc = ctypes.CDLL(None)
libc.malloc.restype = libc.fopen.restype = ctypes.c_void_p
libc.malloc.argtypes, libc.free.argtypes = [ctypes.c_size_t], [ctypes.c_void_p]
libc.malloc_info.argtypes, libc.fclose.argtypes = [ctypes.c_int, ctypes.c_void_p], [ctypes.c_void_p]
libc.mallinfo2.restype = Mallinfo2

said = sys.argv[1] == "kept" and keep_heap_small()
all_here, kept = threading.Barrier(8), []

def use():
    all_here.wait()
    kept.append(bytes(2000))
    all_here.wait()

threads = [threading.Thread(target=use) for _ in range(8)]
for one in threads: one.start()
for one in threads: one.join()
libc.free(libc.malloc(8 << 20))  # the largest so far
apart = libc.mallinfo2().hblks
block = libc.malloc(4 << 20)
apart = libc.mallinfo2().hblks - apart
told = libc.fopen(sys.argv[2].encode(), b"w")
libc.malloc_info(0, told)
libc.fclose(told)
heaps = Path(sys.argv[2]).read_text().count("<heap nr=")
print(json.dumps([said, heaps, apart]))
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="the C library is not glibc 2.33 or later")
@pytest.mark.parametrize("how", ["kept", "as it comes"])
def test_threads_share_a_heap_and_large_blocks_are_apart_from_it(tmp_path, how):
    plain = {name: value for name, value in os.environ.items() if not name.startswith(("MALLOC_", "GLIBC_"))}
    command = [sys.executable, "-c", HEAPS_AND_BLOCKS, how, str(tmp_path / "heaps.xml")]
    said, heaps, apart = json.loads(
        subprocess.run(command, check=True, capture_output=True, text=True, env=plain).stdout
    )
    if how == "kept":
        assert (said, heaps, apart) == (True, 1, 1)
    else:
        assert heaps > 1, "the test would not notice"
        assert apart == 0
