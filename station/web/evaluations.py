"""Stored runs evaluated in a process of their own: reports, loops and files are made there, beside the server.

A report keeps a processor busy for a second or two. In the server's own process it would hold up every open page; so
one further process makes them, one after another, and gives way to a run that is on. What draws and evaluates is loaded
there and not in the server: the functions that do it load it.
"""

# ruff: noqa: PLC0415 - imports inside the functions that are called in the other process

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, TypeVar

from station.errors import StationError
from station.own_program import loading
from station.records.certificate_code import CERTIFICATE
from station.records.chain.chain_file import Chain
from station.records.run_record import MANIFEST, RunRecord
from station.records.samples.layout import CURRENT
from station.records.samples.samples import samples_bytes
from station.records.samples.scan_record import RECORD_BYTES
from station.store.rows.projection import seen, seen_files
from station.store.view import keep_up

if TYPE_CHECKING:
    from station.reports.loop_curves import LoopCurves

LONGEST_S = 180.0
"""Longest time that a page or a request waits, those before it included."""

GIVES_WAY_BY = 5
"""Steps of priority below the server."""

KEEP_UP_S = 2.0
KEEP_UP_EVERY_S = 5.0
"""For how long runs are put into the store at a time, and how often it is looked whether there are any."""

MOST_KEPT = 32
"""Reports and loops that are kept while the files of their runs are as they were."""

LOOK_FOR_SERVER_S = 1.0

Made = TypeVar("Made")


class Evaluations:
    """The process: a fork of the server, or started when it is first needed; and again where it was killed."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._one_at_a_time, self._over = Lock(), Event()
        self._kept: OrderedDict[tuple[str, ...], object] = OrderedDict()

    def fork(self) -> None:
        """Start the process as a fork of this one, so that what both need is loaded once.

        Only while this one has no thread and nothing open: a lock that it holds, the fork would hold for good.
        """
        with self._one_at_a_time, suppress(OSError):  # where the system refuses it, it is started when it is needed
            pool = _pool("fork")
            pool.submit(os.getpid)  # it starts with its first job
            self._pool = pool

    def report(self, run: RunRecord) -> tuple[bytes, bytes]:
        """Return the report of a run as HTML and as PDF; StationError as `report_of`."""
        return self._once(_report_of, run)

    def loop_csv(self, run: RunRecord) -> bytes:
        """Return the loop of a run as CSV; StationError as `loop_of`."""
        return self._made(_loop_of, run.folder)

    def parquet(self, run: RunRecord) -> bytes:
        """Return all samples of a run as Parquet; StationError as `export_run`, or where its record is doubtful."""
        return self._made(_parquet_of, run.folder)

    def loop(self, run: RunRecord) -> LoopCurves:
        """Return what is drawn of a run, StationError as `loop_curves`."""
        return self._once(_curves_of, run)

    def last_record(self, run: RunRecord) -> bytes:
        """Return the last record of a run; see the function of that name."""
        return self._once(last_record, run)

    def figure(self, make: Callable[..., Made], *asked: object) -> Made:
        """Return a figure of many runs; make is a function of a module, StationError as it and where others wait."""
        return self._waited(make, *asked)

    def start(self, data: Path) -> None:
        """Start the process before anybody waits for it, and have it keep the store of a data folder up to its chain.

        A folder of thousands of runs takes minutes once; whoever waits for a report meanwhile waits for a part of it.
        """
        Thread(target=self._keep_up, args=(data,), daemon=True).start()

    def _keep_up(self, data: Path) -> None:
        while not self._over.is_set():
            left = 0
            # Who looks for runs is told what is wrong; here it is tried again.
            with suppress(StationError, OSError, RuntimeError, CancelledError):
                try:
                    behind: Future[int] = self._submit(keep_up, data, KEEP_UP_S)
                    left = behind.result()
                except BrokenProcessPool:
                    self._end()
            self._over.wait(0.0 if left else KEEP_UP_EVERY_S)

    def close(self) -> None:
        """End the process; what it has begun is finished."""
        self._over.set()
        self._end()

    def _end(self) -> None:
        with self._one_at_a_time:
            pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(cancel_futures=True)

    def _once(self, make: Callable[[RunRecord], Made], run: RunRecord) -> Made:
        """Return what is made of a run; what was made before while its files, and the chain, are as they were."""
        chain = Chain(run.folder.parent)
        heads = seen(f"{run.folder.parent}/{CERTIFICATE}")
        key = make.__name__, run.id, seen(f"{run.folder}/{MANIFEST}"), seen_files(run), chain.seen_now(), heads
        with self._one_at_a_time:
            kept = self._kept.get(key)
        if kept is not None:
            return kept  # type: ignore[return-value]  # by its key it was made by the same function
        found = self._made(make, run.folder)
        with self._one_at_a_time:
            self._kept[key] = found
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return found

    def _made(self, make: Callable[[RunRecord], Made], folder: Path) -> Made:
        found: Made = self._waited(_on_run, make, folder)
        return found

    def _waited(self, call: Callable[..., Made], *asked: object) -> Made:
        try:
            found: Future[Made] = self._submit(call, *asked)
            return found.result(LONGEST_S)
        except TimeoutError as error:
            raise StationError("The server is busy with other reports. Try again in a minute.") from error
        except BrokenProcessPool as error:
            self._end()
            raise StationError("The process that evaluates runs ended. Try again.") from error

    def _submit(self, call: Callable[..., Made], *asked: object) -> Future[Made]:
        with self._one_at_a_time:
            if self._over.is_set():
                raise StationError("The server is shutting down. Try again when it runs again.")
            if self._pool is None:
                self._pool = _pool("spawn")  # not forked: by now the server has threads
            return self._pool.submit(call, *asked)


def _pool(way: str) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, get_context(way), _begin, (os.getpid(),))


def _begin(server: int) -> None:
    """Give way to everybody, and end with the server, also where that was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which has what was begun finished
    os.nice(GIVES_WAY_BY)

    def watch() -> None:
        while os.getppid() == server:
            time.sleep(LOOK_FOR_SERVER_S)
        os._exit(0)

    Thread(target=watch, daemon=True).start()
    with loading():
        from station.results.evaluation import load_ahead

        load_ahead()  # now, and not when the first person waits for a loop


def _on_run(make: Callable[[RunRecord], Made], folder: Path) -> Made:
    return make(RunRecord(folder))


def last_record(run: RunRecord) -> bytes:
    """Return the last record of a run as it was written, empty where it has none, or one of another layout.

    Raises:
        RecordError: its samples cannot be read.

    """
    if run.layout() != CURRENT:
        return b""
    return samples_bytes(run)[-RECORD_BYTES:]


def _report_of(run: RunRecord) -> tuple[bytes, bytes]:
    from station.reports.report_of_run import report_of

    return report_of(run)


def _loop_of(run: RunRecord) -> bytes:
    from station.reports.report_of_run import loop_of

    return loop_of(run)


def _curves_of(run: RunRecord) -> LoopCurves:
    from station.reports.loop_curves import loop_curves

    return loop_curves(run)


def _parquet_of(run: RunRecord) -> bytes:
    from station.reports.export_of_run import export_run
    from station.reports.stored_result import refuse_doubtful

    refuse_doubtful(run)
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "run.parquet"
        export_run(run, "parquet", file)
        return file.read_bytes()
