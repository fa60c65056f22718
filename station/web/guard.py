"""What is refused before anything looks at a request: foreign origins, foreign hosts, and answers that may be framed.

A browser says by `Origin` which page makes a request; a page of another origin may neither post here nor open a web
socket. `Host` is held against the names of this server, so that no foreign name can be made to point here.
"""

from __future__ import annotations

import json
from collections.abc import Collection

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

ALWAYS = {
    b"x-frame-options": b"DENY",
    b"x-content-type-options": b"nosniff",
    b"referrer-policy": b"same-origin",
    b"cross-origin-opener-policy": b"same-origin",
}


class Guard:
    """Around the whole application; `hosts`: names with ports that the server is reached by."""

    def __init__(self, app: ASGIApp, hosts: Collection[str]) -> None:
        self._app = app
        self._hosts = frozenset(hosts)

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
        foreign = origin is not None and origin.partition("://")[2].lower() != host
        if foreign and (scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")):
            await _refuse(scope, receive, send, "This request was made by a page of another server.")
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *ALWAYS.items()]
            await send(message)

        await self._app(scope, receive, send_with_headers)


async def _refuse(scope: Scope, receive: Receive, send: Send, words: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    body = json.dumps({"refused": [{"id": "origin", "text": words}]}).encode()
    start: Message = {"type": "http.response.start", "status": 403}
    await send({**start, "headers": [(b"content-type", b"application/json"), *ALWAYS.items()]})
    await send({"type": "http.response.body", "body": body})
