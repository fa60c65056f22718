"""A station that is served by a process of its own: a fork, where everything is loaded, or as people start it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import IO, Any

import httpx
from lostmotion_command import ROOT
from station_support import PASSWORD, open_database, write_models

LONGEST_S = 120.0


@dataclass
class Served:
    """A server: where it is, its process, and a client of it with the token of its page."""

    url: str
    process: subprocess.Popen[str] | BaseProcess
    http: httpx.Client
    data: Path
    csrf: str = ""

    def log_in(self, role: str) -> None:
        answer = self.http.post("/api/enter", json={"name": f"the {role}", "password": PASSWORD})
        assert answer.status_code == 200, answer.text
        self.csrf = answer.json()["csrf"]

    def post(self, action: str, values: dict[str, Any], key: str) -> httpx.Response:
        headers = {"X-CSRF-Token": self.csrf, "Idempotency-Key": key}
        return self.http.post(f"/api/actions/{action}", json=values, headers=headers)

    def now(self) -> dict[str, Any]:
        found: dict[str, Any] = self.http.get("/api/now").json()
        return found

    def wait(self, *stages: str) -> dict[str, Any]:
        """Wait until the bench comes to one of these stages."""
        until = time.monotonic() + LONGEST_S
        while (found := self.now())["stage"] not in stages:
            assert time.monotonic() < until, found
            time.sleep(0.1)
        return found

    def kill(self) -> None:
        self.process.kill()
        self.ended()

    def ended(self) -> None:
        """Wait until the server has ended."""
        if isinstance(self.process, subprocess.Popen):
            self.process.wait(LONGEST_S)
        else:
            self.process.join(LONGEST_S)
            assert self.process.exitcode is not None, "the server does not end"


def prepared(data: Path) -> Path:
    write_models(data)
    open_database(data).close()
    return data


@contextmanager
def served(data: Path, *words: str) -> Iterator[Served]:
    """Serve a data folder; a virtual bench runs as fast as it can, unless other words say how it is served.

    By a fork of this process: to load the server takes two seconds of processor time.
    """
    import station.web.server  # noqa: F401, PLC0415 - loaded here once, and not in each fork

    args = ("lostmotion", "serve", "--port", "0", *(words or ("--fast",)), "--data", str(data))
    out, theirs = os.pipe()
    process = get_context("fork").Process(target=_serve, args=(args, theirs))
    process.start()
    os.close(theirs)
    with os.fdopen(out, encoding="utf-8") as said, _reached(process, said, data) as found:
        yield found


def _serve(args: tuple[str, ...], out: int) -> None:
    """Be `lostmotion serve`, whose words go into a pipe."""
    from station import cli  # noqa: PLC0415

    for handle in (1, 2):
        os.dup2(out, handle)
    sys.stdout = sys.stderr = os.fdopen(1, "w", encoding="utf-8")
    sys.argv = [*args]
    os.chdir(ROOT)
    cli.main()


@contextmanager
def served_by(command: list[str], data: Path, env: dict[str, str] | None = None) -> Iterator[Served]:
    """Serve a data folder by a command of one's own, which says where as `lostmotion serve` does."""
    process = subprocess.Popen(command, cwd=ROOT, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    with process.stdout as said, _reached(process, said, data) as found:
        yield found


@contextmanager
def _reached(process: subprocess.Popen[str] | BaseProcess, said: IO[str], data: Path) -> Iterator[Served]:
    """Yield a server with a client of it, from when it says where it is; it is ended after."""
    with httpx.Client(timeout=30.0) as http:
        found = Served("", process, http, data)
        try:
            first = said.readline()
            place = re.match(r"station  (http://\S+)/$", first)
            assert place, first + said.read()
            found.url = place[1]
            http.base_url = found.url
            yield found
        finally:
            process.terminate()
            found.ended()
