"""The two processes of a real-time run: started in sessions of their own, watched, and never left behind."""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from station.bench.bench_spec import Ports
from station.errors import BenchFaultError
from station.own_program import own_module
from station.run.ahead import Ahead
from station.scan.scan_spec import SpecFile

READY_TIMEOUT_S = 120.0
"""The first start of the virtual bench compiles its physics."""

TERMINATE_TIMEOUT_S = 3.0
LONGEST_READY_LINE = 65536
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""A second thread in a process costs its scan milliseconds, even one that only waits for work."""


VIRTUAL_BENCH = "station.bench.virtual_bench_process"
GATEWAY = "station.bench.gateway_process"
SCAN = "station.scan.scan_process"


class LifeLine:
    """A pipe to the virtual bench, which ends when everyone who holds its other end is gone.

    The supervisor may write lines into it: what state its controller is in, for faults that wait for a state.
    """

    def __init__(self) -> None:
        self.reader, self.writer = os.pipe()
        os.set_blocking(self.writer, False)  # a bench that does not read must not hold the supervisor

    def tell(self, line: bytes) -> None:
        """Write a line for the bench; one that is gone or does not read misses it."""
        with contextlib.suppress(OSError):
            os.write(self.writer, line)

    def close(self) -> None:
        """Let go of both ends."""
        for handle in (self.reader, self.writer):
            with contextlib.suppress(OSError):
                os.close(handle)


def nothing() -> None:
    """Do nothing while a process starts."""


def run_module(module: str, *words: str | Path, **options: Any) -> subprocess.Popen[bytes]:
    """Start a module of this program as a process of its own, with what it reads on its command line."""
    # A session of its own: Ctrl-C in the terminal is for the supervisor, which unloads the torque first.
    command = own_module(module, *words)
    return subprocess.Popen(command, start_new_session=True, env=os.environ | ONE_THREAD, **options)  # noqa: S603


def start_ahead(module: str, *words: str) -> Ahead:
    """Start a module of this program before it is needed; it waits for what it reads on its command line."""
    return Ahead(module, *words, env=os.environ | ONE_THREAD)


def start_virtual_bench(
    spec: Path,
    log: Path,
    life_line: LifeLine,
    meanwhile: Callable[[], None] = nothing,
    ahead: Ahead | None = None,
) -> tuple[subprocess.Popen[bytes], Ports]:
    """Start the embedded virtual bench; return its process and where it listens. `meanwhile` is done until that comes.

    ahead: one that was started before, and waits.

    Raises:
        BenchFaultError: it did not come up; the text holds what it said.

    """
    return _start_serving(VIRTUAL_BENCH, "virtual bench", spec, log, life_line, meanwhile, ahead)


def start_gateway(
    spec: Path, log: Path, life_line: LifeLine, meanwhile: Callable[[], None] = nothing
) -> tuple[subprocess.Popen[bytes], Ports]:
    """Start the gateway before a bench on a cable; as `start_virtual_bench`."""
    return _start_serving(GATEWAY, "gateway", spec, log, life_line, meanwhile, None)


def _start_serving(  # noqa: PLR0917 - a process, and what is done while it starts
    module: str,
    name: str,
    spec: Path,
    log: Path,
    life_line: LifeLine,
    meanwhile: Callable[[], None],
    ahead: Ahead | None,
) -> tuple[subprocess.Popen[bytes], Ports]:
    reader, writer = os.pipe()
    said = os.fdopen(reader, "rb")
    try:
        with log.open("wb") as errors:
            process = _begun(module, (spec,), ahead, stdin=life_line.reader, stdout=writer, stderr=errors.fileno())
    except BaseException:
        said.close()
        raise
    finally:
        os.close(writer)
    process.stdout = said  # closed by `stop`, as the one that Popen makes
    try:
        meanwhile()
    except BaseException:
        stop(process)
        raise
    line = _first_line(process, READY_TIMEOUT_S)
    try:
        ports = Ports.of_ready_line(line)
    except ValueError:
        stop(process)
        last = log.read_text(errors="replace").strip().splitlines()[-3:]
        raise BenchFaultError(f"process {name} did not start: {' '.join(last) or 'no message'}. Run again") from None
    return process, ports


def _first_line(process: subprocess.Popen[bytes], timeout_s: float) -> bytes:
    stream = process.stdout
    if stream is None:
        return b""
    deadline = time.monotonic() + timeout_s
    line = b""
    with selectors.DefaultSelector() as selector:
        selector.register(stream, selectors.EVENT_READ)
        while not line.endswith(b"\n") and len(line) < LONGEST_READY_LINE:
            if not selector.select(max(deadline - time.monotonic(), 0.0)):
                break
            chunk = os.read(stream.fileno(), 4096)
            if not chunk:
                break
            line += chunk
    return line


def start_scanning(
    module: str, spec: SpecFile, log: Path, life_line: LifeLine | None, ahead: Ahead | None = None
) -> subprocess.Popen[bytes]:
    """Start a module that scans; its standard error goes to `log`. It holds the virtual bench's life line too.

    ahead: one that was started before, and waits.
    """
    handles = () if life_line is None else (life_line.writer,)
    with log.open("wb") as errors, Path(os.devnull).open("rb") as nobody:
        words, said = (spec.sha256, spec.path), errors.fileno()
        return _begun(module, words, ahead, stdin=nobody.fileno(), stdout=said, stderr=said, keep=handles)


def _begun(
    module: str,
    words: Sequence[str | Path],
    ahead: Ahead | None,
    *,
    stdin: int,
    stdout: int,
    stderr: int,
    keep: Sequence[int] = (),
) -> subprocess.Popen[bytes]:
    """Have a process do what a module does: one that waits for it, else a new one."""
    if ahead is not None:
        process = ahead.begin(words, stdin=stdin, stdout=stdout, stderr=stderr, keep=keep)
        if process is not None:
            return process
    return run_module(module, *words, stdin=stdin, stdout=stdout, stderr=stderr, pass_fds=keep)


def stop(process: subprocess.Popen[bytes], timeout_s: float = TERMINATE_TIMEOUT_S) -> None:
    """End a process that was started here, politely first, and collect it.

    The scan process needs its time: it brings the torque to zero before it ends.
    """
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    if process.stdout is not None:
        process.stdout.close()


def why_it_ended(process: subprocess.Popen[bytes]) -> str:
    """Return how a process ended, in words."""
    code = process.returncode
    if code is not None and code < 0:
        return f"killed by {signal.Signals(-code).name}"
    return f"ended with code {code}"
