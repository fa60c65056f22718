"""A connection that is hung up has ended before anything else happens, on each event loop that a bench may run on."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
import uvloop

from virtual_bench.wires.hang_up import hang_up


@pytest.mark.parametrize("run", [asyncio.run, uvloop.run], ids=["asyncio", "uvloop"])
def test_the_other_side_sees_the_end_before_the_loop_goes_on(run: Callable[[Coroutine[Any, Any, bytes]], bytes]):
    async def hung_up() -> bytes:
        here, there = socket.socketpair()
        there.settimeout(0)
        transport, _ = await asyncio.get_running_loop().create_connection(asyncio.Protocol, sock=here)
        hang_up(transport)
        with there:
            return there.recv(1)

    assert run(hung_up()) == b""
