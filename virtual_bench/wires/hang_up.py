"""Ends a connection now: asyncio's `abort` does so in its next round, which a scan may be faster than."""

from __future__ import annotations

import asyncio
import socket
from contextlib import suppress


def hang_up(transport: asyncio.WriteTransport) -> None:
    """End a connection at once; what was not yet sent is lost, as when a plug is pulled."""
    connection = transport.get_extra_info("socket")
    if connection is not None:
        with suppress(OSError):  # the other side was faster
            connection.shutdown(socket.SHUT_RDWR)
    transport.abort()
