"""Ends a connection now: `abort` of an event loop does so in its next round, which a scan may be faster than."""

from __future__ import annotations

import asyncio
import os
import socket
from contextlib import suppress


def hang_up(transport: asyncio.WriteTransport) -> None:
    """End a connection at once; what was not yet sent is lost, as when a plug is pulled."""
    connection = transport.get_extra_info("socket")
    if connection is not None:
        # a descriptor of our own: what uvloop gives as the socket cannot be shut down
        with suppress(OSError), socket.socket(fileno=os.dup(connection.fileno())) as own:  # the other side was faster
            own.shutdown(socket.SHUT_RDWR)
    transport.abort()
