"""A label printer on a real socket: takes ZPL, answers ~HS, and does what printers do when they are left alone."""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread

LABEL = re.compile(rb"\^XA.*?\^XZ", re.DOTALL)
PATIENCE_S = 30.0
FIELD_DATA = re.compile(r"\^FH\^FD(.*?)\^FS", re.DOTALL)


class ZplPrinter:
    """What it was sent and has printed; `paper_out`, `head_open`, `silent`, `holds`, `cut`: how it stands.

    holds: it takes labels and prints none. cut: it ends the connection as soon as a label comes.
    """

    def __init__(self) -> None:
        self.paper_out = self.head_open = self.silent = self.holds = self.cut = False
        self.waiting: list[str] = []
        self.printed: list[str] = []
        self.end = Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.05)
        self.port = self._listener.getsockname()[1]
        self._thread = Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self.end.set()
        self._thread.join()
        self._listener.close()

    def _serve(self) -> None:
        while not self.end.is_set():
            self._print()
            with suppress(TimeoutError):
                connection, _ = self._listener.accept()
                with connection, suppress(OSError):
                    connection.settimeout(0.05)
                    self._talk(connection)

    def _talk(self, connection: socket.socket) -> None:
        got = b""
        while not self.end.is_set():
            try:
                read = connection.recv(4096)
            except TimeoutError:
                self._print()
                continue
            if not read:
                return
            got += read
            if self.cut and b"^XA" in got:
                return
            for label in LABEL.findall(got):
                self.waiting.append(label.decode())
            got = LABEL.sub(b"", got)
            while b"~HS" in got:
                got = got.replace(b"~HS", b"", 1)
                self._print()
                if not self.silent:
                    connection.sendall(self._status())

    def wait_for(self, count: int) -> None:
        """Wait until so many labels have come out."""
        end_s = time.monotonic() + PATIENCE_S
        while len(self.printed) < count:
            assert time.monotonic() < end_s, f"{len(self.printed)} of {count} labels came out"
            time.sleep(0.02)

    def _print(self) -> None:
        if not (self.paper_out or self.head_open or self.holds):
            self.printed += self.waiting
            self.waiting = []

    def _status(self) -> bytes:
        first = f"030,{self.paper_out:d},0,0300,{len(self.waiting):03d},0,0,0,000,0,0,0"
        second = f"000,0,{self.head_open:d},0,0,2,6,0,00000000,1,000"
        return "".join(f"\x02{line}\x03\r\n" for line in (first, second, "1234,0")).encode()


def read_fields(label: str) -> list[str]:
    """Return the data of the fields of a label as a printer reads them, with ^FH resolved."""
    return [
        re.sub(rb"_([0-9A-F]{2})", lambda one: bytes([int(one[1], 16)]), data.encode()).decode()
        for data in FIELD_DATA.findall(label)
    ]


@contextmanager
def printing() -> Iterator[ZplPrinter]:
    printer = ZplPrinter()
    try:
        yield printer
    finally:
        printer.close()
