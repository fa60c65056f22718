"""CPU time that the virtual bench takes at 1 kHz, and the cost of the same bench in process.

A client process sends one RPDO and one SYNC and reads the amplifier once per millisecond; the server's own CPU time
over the run is its share of one core. Run: python benchmarks/virtual_bench_load.py [SECONDS]
"""

from __future__ import annotations

import asyncio
import multiprocessing as mp
import os
import socket
import struct
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "virtual_bench"))

from virtual_bench_example import example_server_config

from definitions.image import Orders
from virtual_bench.in_process import VirtualTimeBench
from virtual_bench.physics.plant import warm_up
from virtual_bench.server import run

PERIOD_S = 0.001
READ_AMPLIFIER = struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 0, 14)
ANSWER_BYTES = 37


def serve(pipe: Any) -> None:
    """Run the server and tell where it listens and what CPU time it took."""

    async def main() -> None:
        stop = asyncio.Event()
        asyncio.get_running_loop().add_reader(pipe.fileno(), stop.set)
        await run(example_server_config(), announce=pipe.send, stop=stop, log=lambda *_args, **_more: None)

    asyncio.run(main())
    pipe.send(time.process_time())


def drive_for(seconds: float, ready: dict[str, Any], pid: int) -> None:
    """Load the server for a while and print what it took."""
    can = socket.create_connection((ready["can"]["host"], ready["can"]["port"]))
    can.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for command in (b"", b"< open vcan0 >", b"< rawmode >"):
        can.sendall(command)
        can.recv(100)
    amplifier = socket.create_connection((ready["amplifier"]["host"], ready["amplifier"]["port"]))
    amplifier.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    can.sendall(b"< send 0 2 1 5 >")
    frames = b"< send 205 5 f 0 a 0 0 >< send 80 0  >"
    scans, received, answers, latencies = round(seconds / PERIOD_S), 0, 0, []
    before, start = cpu_seconds(pid), time.monotonic()
    for scan in range(scans):
        time.sleep(max(start + scan * PERIOD_S - time.monotonic(), 0.0))
        sent = time.monotonic()
        can.sendall(frames)
        amplifier.sendall(READ_AMPLIFIER)
        answers += len(amplifier.recv(ANSWER_BYTES)) == ANSWER_BYTES
        latencies.append(time.monotonic() - sent)
        received += can.recv(4096).count(b"frame")
    elapsed = time.monotonic() - start
    share = (cpu_seconds(pid) - before) / elapsed
    latencies.sort()
    print(f"{scans} scans in {elapsed:.2f} s, {received} frames and {answers} samples received")
    print(f"answer to the sample request: p50 {latencies[scans // 2] * 1e6:.0f} us, ", end="")
    print(f"p99 {latencies[scans * 99 // 100] * 1e6:.0f} us")
    print(f"CPU of the virtual bench: {share * 100:.1f} % of one core, {share * elapsed / scans * 1e6:.0f} us per scan")


def cpu_seconds(pid: int) -> float:
    """Return user and system time of a process (Linux)."""
    words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def in_process(scans: int = 20_000) -> None:
    """Print the cost of one read and write of the bench in process."""
    config = replace(example_server_config().bench)
    warm_up(config)
    bench = VirtualTimeBench(config, round(PERIOD_S * 1e9))
    orders = Orders(3, 10, 0.0, 0.0, 1, 6.0, 0, 0, 0, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    start = time.perf_counter()
    for scan in range(scans):
        bench.read(scan, 0, 0)
        bench.write(orders, scan)
    print(f"in process: {(time.perf_counter() - start) / scans * 1e6:.1f} us per read and write")


if __name__ == "__main__":
    in_process()
    context = mp.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs,))
    process.start()
    drive_for(float(sys.argv[1]) if len(sys.argv) > 1 else 5.0, ours.recv(), int(process.pid or 0))
    ours.send("stop")
    process.join(10)
