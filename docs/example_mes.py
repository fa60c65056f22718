"""A small example MES: takes the webhooks of a station, checks them, and keeps each result once.

    python example_mes.py --secret-file mes.secret --keep results.jsonl

Copy from it what your own needs: the check of the signature, the age of a message, and the key that tells a message that
comes again. It needs nothing but Python.
"""

from __future__ import annotations

import argparse
import hashlib
import hmac
import json
import os
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock

OLDEST_S = 300
LARGEST_BYTES = 16_000_000


class Results:
    """Results in a file, one JSON line each, with the keys under which they came."""

    def __init__(self, file: Path) -> None:
        """Open the file, which a killed MES may have left with half a line at its end."""
        self._file, self._lock = file, Lock()
        content = file.read_bytes() if file.exists() else b""
        whole = content[: content.rfind(b"\n") + 1]
        if whole != content:
            file.write_bytes(whole)
        self._keys = {json.loads(line)["key"] for line in whole.splitlines()}

    def keep(self, key: str, message: dict) -> None:
        """Keep a result on disk; one that is there already is not kept again."""
        with self._lock:
            if key in self._keys:
                return
            with self._file.open("a", encoding="utf-8") as out:
                row = {"key": key, "may_ship": may_ship(message), "message": message}
                out.write(json.dumps(row) + "\n")
                out.flush()
                os.fsync(out.fileno())
            self._keys.add(key)


def may_ship(message: dict) -> bool:
    """Say whether a unit passed: nothing simulated, no master part, no faults injected, and a record as it was sealed."""
    return message.get("verdict") == "PASS" and message.get("not_a_product") == [] and message.get("altered") == []


def is_signed(secret: bytes, timestamp: str, body: bytes, signature: str, now_s: float) -> bool:
    """Say whether a message is the station's own, and not an old one that somebody sends again."""
    wanted = "sha256=" + hmac.new(secret, timestamp.encode() + b"." + body, hashlib.sha256).hexdigest()
    return hmac.compare_digest(wanted, signature) and timestamp.isdigit() and abs(now_s - int(timestamp)) <= OLDEST_S


def server(secret: bytes, results: Results, port: int) -> ThreadingHTTPServer:
    """Return the server on loopback; port 0: a free one."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.send_response(self._taken())
            self.send_header("Content-Length", "0")
            self.end_headers()

        def _taken(self) -> int:
            size = self.headers.get("Content-Length", "")
            if not size.isdigit() or int(size) > LARGEST_BYTES:
                return 413
            body = self.rfile.read(int(size))
            timestamp = self.headers.get("X-Lostmotion-Timestamp", "")
            signature = self.headers.get("X-Lostmotion-Signature", "")
            key = self.headers.get("Idempotency-Key", "")
            if not key or not is_signed(secret, timestamp, body, signature, time.time()):
                return 401
            message = json.loads(body)
            if message["kind"] == "result":  # the other kind, "alive", only asks whether somebody is there
                results.keep(key, message)
            return 204

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    return ThreadingHTTPServer(("127.0.0.1", port), Handler)


def main() -> None:
    """Serve until the process is asked to end."""
    parser = argparse.ArgumentParser(description="A small example MES.")
    parser.add_argument("--secret-file", type=Path, required=True)
    parser.add_argument("--keep", type=Path, default=Path("results.jsonl"))
    parser.add_argument("--port", type=int, default=8090)
    given = parser.parse_args()
    served = server(given.secret_file.read_bytes().strip(), Results(given.keep), given.port)
    print(f"MES      http://127.0.0.1:{served.server_port}/", flush=True)  # noqa: T201 - what a person needs
    served.serve_forever()


if __name__ == "__main__":
    main()
