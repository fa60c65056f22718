"""A station that is served by a process of its own, as people start it."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from lostmotion_command import ROOT
from station_support import PASSWORD, open_database, write_models

LONGEST_S = 120.0


@dataclass
class Served:
    """A server: where it is, its process, and a client of it with the token of its page."""

    url: str
    process: subprocess.Popen[str]
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
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


def prepared(data: Path) -> Path:
    write_models(data)
    open_database(data).close()
    return data


@contextmanager
def served(data: Path, *words: str) -> Iterator[Served]:
    """Serve a data folder; a virtual bench runs as fast as it can, unless other words say how it is served."""
    how = words or ("--fast",)
    with served_by([sys.executable, "-m", "station", "serve", "--port", "0", *how, "--data", str(data)], data) as found:
        yield found


@contextmanager
def served_by(command: list[str], data: Path, env: dict[str, str] | None = None) -> Iterator[Served]:
    """Serve a data folder by a command of one's own, which says where as `lostmotion serve` does."""
    process = subprocess.Popen(command, cwd=ROOT, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        first = process.stdout.readline()
        found = re.match(r"station  (http://\S+)/$", first)
        assert found, first + process.stdout.read()
        with httpx.Client(base_url=found[1], timeout=30.0) as http:
            yield Served(found[1], process, http, data)
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait(timeout=LONGEST_S)
        process.stdout.close()
