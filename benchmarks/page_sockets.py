"""Clients of the operator page's web socket that draw nothing: `python -m benchmarks.page_sockets URL COUNT`.

What browsers on other computers cost the bench computer is what these cost. Name and password are read from standard
input. A second line there has them tell what came, one JSON object: bytes a second, and what each loop was when.
"""

from __future__ import annotations

import ast
import asyncio
import json
import re
import sys
import time
import uuid
from typing import Any

import httpx
import socketio

ACKNOWLEDGE_EVERY_S = 3.0
GREW = re.compile(r"showLoop\(\d+, (\d+), (\[.*\])\)")


class PageSocket:
    """One open page: what a browser asks for and answers, without a screen."""

    def __init__(self, url: str, cookies: httpx.Cookies) -> None:
        self._url, self._cookies = url, cookies
        self._client = socketio.AsyncClient(reconnection=False)
        self._next, self._id = 0, ""
        self.came = 0
        self.points: list[Any] = []
        self.drawn: list[tuple[float, int]] = []
        """When the loop has grown [ms since 1970], and how many points it had then."""
        self._client.on("*", self._hear)

    async def open(self) -> None:
        """Ask for the page, and open its socket."""
        async with httpx.AsyncClient(base_url=self._url, cookies=self._cookies, timeout=60.0) as http:
            page = (await http.get("/")).text
        found = re.search(r"query: (\{.*?\}),\n", page)
        if found is None:
            raise SystemExit(f"{self._url}/ is no page of the station: {page[:200]!r}")
        query = ast.literal_eval(found[1]) | {"tab_id": str(uuid.uuid4()), "implicit_handshake": "true"}
        query["document_id"] = str(uuid.uuid4())
        self._id = query["client_id"]
        words = "&".join(f"{name}={value}" for name, value in query.items())
        cookie = "; ".join(f"{one.name}={one.value}" for one in self._cookies.jar)
        await self._client.connect(
            f"{self._url}?{words}", {"Cookie": cookie, "Origin": self._url}, transports=["websocket"],
            socketio_path="_nicegui_ws/socket.io",
        )  # fmt: skip
        self._task = asyncio.create_task(self._acknowledge())

    async def close(self) -> None:
        """Leave the page."""
        self._task.cancel()
        await self._client.disconnect()

    async def _hear(self, event: str, told: object = None) -> None:
        if not isinstance(told, dict):
            return
        self._next = told.get("_id", self._next) + 1
        self.came += len(json.dumps(told)) + len(event)
        if grew := GREW.fullmatch(str(told.get("code", ""))):
            del self.points[int(grew[1]) :]
            self.points += json.loads(grew[2])
            self.drawn.append((1000.0 * time.time(), len(self.points)))

    async def _acknowledge(self) -> None:
        """Tell what has come, as a page does every few seconds."""
        while True:
            await asyncio.sleep(ACKNOWLEDGE_EVERY_S)
            await self._client.emit("ack", {"client_id": self._id, "next_message_id": self._next})


async def main(url: str, count: int) -> None:
    """Open pages, and tell what came when asked."""
    name, password = sys.stdin.readline().rstrip("\n").split("\t")
    async with httpx.AsyncClient(base_url=url, timeout=60.0) as http:
        (await http.post("/api/enter", json={"name": name, "password": password})).raise_for_status()
        cookies = http.cookies
    pages = [PageSocket(url, cookies) for _ in range(count)]
    for page in pages:
        await page.open()
    print("open", flush=True)
    began_s = time.monotonic()
    await asyncio.to_thread(sys.stdin.readline)
    rate = sum(page.came for page in pages) / (time.monotonic() - began_s)
    for page in pages:
        await page.close()
    print(json.dumps({"rate": rate, "seen": [{"drawn": page.drawn, "points": page.points} for page in pages]}))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
