"""What is refused before anything looks at a request: foreign origins, foreign hosts, and answers that may be framed.

A browser says by `Origin` which page makes a request; a page of another origin may neither post here nor open a web
socket. `Host` is held against the names of this server, so that no foreign name can be made to point here.
No address of this server has a step up, or a separator in a name: who asks for one tries to get at other files.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from urllib.parse import unquote_to_bytes

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

ALWAYS = {
    b"x-frame-options": b"DENY",
    b"x-content-type-options": b"nosniff",
    b"referrer-policy": b"same-origin",
    b"cross-origin-opener-policy": b"same-origin",
}


LONGEST_PATH = 200
"""Of an address that was refused, what is kept of it."""

Keep = Callable[[Mapping[str, str], str], None]
"""Keeps what was refused: the cookies of the request, and the address that it asked for."""


class Guard:
    """Around the whole application; `hosts`: names with ports that the server is reached by.

    keep: where addresses that lead elsewhere are kept; without it they are refused and forgotten.
    """

    def __init__(self, app: ASGIApp, hosts: Collection[str], keep: Keep | None = None) -> None:
        self._app = app
        self._hosts = frozenset(hosts)
        self._keep = keep

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if host not in self._hosts:
            words = f"This server has no name {host[:60]!r}. To allow that name, start the station with --name."
            await _refuse(scope, receive, send, words)
            return
        path = scope.get("raw_path") or scope["path"].encode()
        if _leads_elsewhere(path):
            if self._keep is not None:
                asked = path[:LONGEST_PATH].decode("ascii", "backslashreplace")
                await run_in_threadpool(self._keep, HTTPConnection(scope).cookies, asked)
            await _refuse(scope, receive, send, "There is nothing at this address.", 404, "path")
            return
        foreign = origin is not None and origin.partition("://")[2].lower() != host
        if foreign and (scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")):
            await _refuse(scope, receive, send, "This request was made by a page of another server.")
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *ALWAYS.items()]
            await send(message)

        await self._app(scope, receive, send_with_headers)


def _leads_elsewhere(path: bytes) -> bool:
    """Say whether an address has a step, a separator or a zero byte in a name."""
    parts = [unquote_to_bytes(part) for part in path.split(b"/")]
    return any(part in {b".", b".."} or any(one in part for one in (b"/", b"\\", b"\0")) for part in parts)


async def _refuse(  # noqa: PLR0917 - as the application is called, and the answer
    scope: Scope, receive: Receive, send: Send, words: str, status: int = 403, name: str = "origin"
) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    body = json.dumps({"refused": [{"id": name, "text": words}]}).encode()
    start: Message = {"type": "http.response.start", "status": status}
    await send({**start, "headers": [(b"content-type", b"application/json"), *ALWAYS.items()]})
    await send({"type": "http.response.body", "body": body})
