"""Brings results to the clients that wait for events: to each what it is owed, and again until it has acknowledged it.

Who is no registered client gets the results that are sealed while it waits, once.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field

from asyncua import Server, ua
from asyncua.server.internal_subscription import InternalSubscription

from station.opcua.access import Guest
from station.opcua.address_space import AddressSpace
from station.opcua.outbox import Kept, Outbox
from station.opcua.result_data import OfTypeToo, event_of

WINDOW = 100
"""Results on their way to a client: the next go when one of these is acknowledged."""

REPEAT_S = 30.0
"""After this time a result that was not acknowledged is sent again to a client that has taken all before."""


@dataclass
class _Item:
    """Somebody who waits for events on a node. sent: when which result was put on its way; last: the newest of them."""

    client: str
    subscription: int
    item: int
    node: ua.NodeId
    last: int = 0
    sent: dict[int, float] = field(default_factory=dict)


class Courier:
    """Knows who waits, and what each was sent."""

    def __init__(self, server: Server, outbox: Outbox, repeat_s: float = REPEAT_S) -> None:
        """Prepare it; `space` is given before the server starts."""
        self.wake = asyncio.Event()
        self.space: AddressSpace
        self._server, self._outbox, self._repeat_s = server, outbox, repeat_s
        self._items: list[_Item] = []
        self._types: frozenset[ua.NodeId] = frozenset()

    async def use(self, space: AddressSpace) -> None:
        """Send events of these nodes."""
        self.space = space
        above, node = [space.event_type.nodeid], space.event_type
        while parent := await node.get_parent():
            if await parent.read_node_class() != ua.NodeClass.ObjectType:
                break
            above.append(parent.nodeid)
            node = parent
        self._types = frozenset(above)

    def watch(self, guest: Guest, subscription: int, items: list[tuple[int, ua.NodeId]]) -> None:
        """Know of somebody who waits from now on."""
        subscribed = self._subscription(subscription)
        newest = self._outbox.latest()
        for number, node in items:
            data = None if subscribed is None else subscribed.monitored_item_srv._monitored_items.get(number)  # noqa: SLF001
            if data is None:
                continue
            data.where_clause_evaluator = OfTypeToo(self._server.iserver.aspace, data.filter.WhereClause, self._types)
            last = 0 if newest is None else newest.number
            self._items.append(_Item(guest.client, subscription, number, node, last))
        self.wake.set()

    def _subscription(self, number: int) -> InternalSubscription | None:
        return self._server.iserver.subscription_service.subscriptions.get(number)

    async def deliver(self) -> None:
        """Send what is due to everybody who waits."""
        self._items = [item for item in self._items if self._place(item) is not None]
        owed: dict[str, list[Kept]] = {}
        for item in self._items:
            if not item.client:
                due = await asyncio.to_thread(self._outbox.after, item.last, WINDOW)
                item.last = due[-1].number if due else item.last
            else:
                if item.client not in owed:
                    owed[item.client] = await asyncio.to_thread(self._outbox.owed, item.client, WINDOW)
                due = self._due(item, owed[item.client])
            for kept in due:
                await self._send(item, kept)

    def _place(self, item: _Item) -> tuple[InternalSubscription, int] | None:
        """Return the subscription of an item and how much waits in its queue; None where it is there no more."""
        subscription = self._subscription(item.subscription)
        if subscription is None or item.item not in subscription.monitored_item_srv._monitored_items:  # noqa: SLF001
            return None
        return subscription, len(subscription._triggered_events.get(item.item, ()))  # noqa: SLF001

    def _due(self, item: _Item, owed: list[Kept]) -> list[Kept]:
        place = self._place(item)
        if place is None:
            return []
        subscription, queued = place
        room = subscription.monitored_item_srv._monitored_items[item.item].queue_size or WINDOW  # noqa: SLF001
        item.sent = {kept.number: item.sent[kept.number] for kept in owed if kept.number in item.sent}
        before_s = time.monotonic() - self._repeat_s
        if queued == 0:  # the client took all of them, and did not acknowledge these
            item.sent = {number: at_s for number, at_s in item.sent.items() if at_s > before_s}
        free = min(room, WINDOW) - len(item.sent)
        return [kept for kept in owed if kept.number not in item.sent][: max(0, free)]

    async def _send(self, item: _Item, kept: Kept) -> None:
        subscription = self._subscription(item.subscription)
        if subscription is None:
            return
        now = await asyncio.to_thread(self._outbox.as_now, kept)
        event = event_of(now, self.space.event_type.nodeid, self.space.results.nodeid, "ResultManagement")
        event.emitting_node = item.node
        if item.client:
            item.sent[kept.number] = time.monotonic()
        await subscription.monitored_item_srv.trigger_event(event, item.item)
