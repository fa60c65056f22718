"""The methods of ResultManagementType: results by id, the newest, those a filter chooses; acknowledging them."""

from __future__ import annotations

import asyncio
from typing import Any

from asyncua import Server, ua

from station.errors import StationError
from station.opcua.access import CALLER, tell
from station.opcua.address_space import AddressSpace
from station.opcua.outbox import BEFORE_ALL, Kept, Outbox, ResultMeta
from station.opcua.result_data import chosen_by, meta_of, result_of

MOST_IDS = 1000
"""Results that are acknowledged, or listed, by one call."""

OK, UNKNOWN_RESULT, NO_RESULT, BAD_FILTER, NOT_NOW = 0, -1, -2, -3, -4
"""What the output `error` says; numbers below 0 are ours."""

PAGE = 500


class ResultMethods:
    """The methods over an outbox. acknowledged: is called when a client has taken results."""

    def __init__(self, server: Server, outbox: Outbox, acknowledged: asyncio.Event) -> None:
        """Prepare them."""
        self._server, self._outbox, self._acknowledged = server, outbox, acknowledged
        self._handle = 0

    async def link(self, space: AddressSpace) -> None:
        """Let clients call them."""
        for name, method in {
            "GetResultById": self.by_id,
            "GetLatestResult": self.latest,
            "GetResultIdListFiltered": self.filtered,
            "ReleaseResultHandle": self.release,
            "AcknowledgeResults": self.acknowledge,
        }.items():
            self._server.link_method(await space.method(name), method)

    def _next_handle(self) -> ua.Variant:
        self._handle = self._handle % 0xFFFF_FFFF + 1
        return ua.Variant(self._handle, ua.VariantType.UInt32)

    async def by_id(self, parent: ua.NodeId, run: ua.Variant, _timeout: ua.Variant) -> list[ua.Variant]:
        """Return the result of a run."""
        del parent
        return await self._answer(await asyncio.to_thread(self._outbox.by_run, str(run.Value or "")))

    async def latest(self, parent: ua.NodeId, _timeout: ua.Variant) -> list[ua.Variant]:
        """Return the newest result."""
        del parent
        return await self._answer(await asyncio.to_thread(self._outbox.latest), NO_RESULT)

    async def _answer(self, kept: Kept | None, none: int = UNKNOWN_RESULT) -> list[ua.Variant]:
        if kept is None:
            empty = ua.ResultDataType()
            return [_handle(0), ua.Variant(empty, ua.VariantType.ExtensionObject), _code(none)]
        kept = await asyncio.to_thread(self._outbox.as_now, kept)
        try:
            content = None if kept.meta.altered else await asyncio.to_thread(self._outbox.content, kept.meta)
        except OSError as error:
            tell(f"{kept.meta.run}: its result cannot be read: {error.strerror}")
            content = None
        told = result_of(kept.meta, content)
        return [self._next_handle(), ua.Variant(told, ua.VariantType.ExtensionObject), _code(OK)]

    async def filtered(
        self, parent: ua.NodeId, where: ua.Variant, order: ua.Variant, most: ua.Variant, _timeout: ua.Variant
    ) -> list[ua.Variant]:
        """Return the ids of the results that a filter chooses: oldest first, or by parts of the meta data."""
        del parent
        limit = min(int(most.Value or 0) or MOST_IDS, MOST_IDS)
        try:
            metas = await asyncio.to_thread(self._chosen, where.Value)
            paths = [path for path in order.Value or [] if path.Elements]
            for path in reversed(paths):
                name = path.Elements[-1].TargetName.Name
                metas.sort(key=lambda meta: getattr(meta_of(meta), name))
        except (ValueError, AttributeError, TypeError) as error:
            tell(f"GetResultIdListFiltered: {error}")
            return [_handle(0), _texts([]), _code(BAD_FILTER)]
        return [self._next_handle(), _texts([meta.run for meta in metas[:limit]]), _code(OK)]

    def _chosen(self, where: Any) -> list[ResultMeta]:
        metas: list[ResultMeta] = []
        number = BEFORE_ALL
        while rows := self._outbox.after(number, PAGE):
            number = rows[-1].number
            metas += chosen_by(self._server.iserver.aspace, where, [row.meta for row in rows])
        return metas

    async def release(self, parent: ua.NodeId, handle: ua.Variant) -> list[ua.Variant]:
        """Do nothing: an answer is whole, and nothing is kept for it."""
        del parent, handle
        return [_code(OK)]

    async def acknowledge(self, parent: ua.NodeId, runs: ua.Variant) -> list[ua.Variant] | ua.StatusCode:
        """Note durably that the caller has results."""
        del parent
        caller, ids = CALLER.get(None), [str(one or "") for one in runs.Value or []]
        if caller is None or not caller.client:
            return ua.StatusCode(ua.StatusCodes.BadUserAccessDenied)
        if len(ids) > MOST_IDS:
            return ua.StatusCode(ua.StatusCodes.BadTooManyOperations)
        try:
            there = await asyncio.to_thread(self._outbox.acknowledge, caller.client, ids)
        except StationError as error:
            tell(f"client {caller.client}: its acknowledgement cannot be kept: {error}")
            return [_codes([NOT_NOW] * len(ids)), _code(NOT_NOW)]
        self._acknowledged.set()
        if all(there):
            return [_codes([]), _code(OK)]
        return [_codes([OK if one else UNKNOWN_RESULT for one in there]), _code(UNKNOWN_RESULT)]


def _handle(number: int) -> ua.Variant:
    return ua.Variant(number, ua.VariantType.UInt32)


def _code(number: int) -> ua.Variant:
    return ua.Variant(number, ua.VariantType.Int32)


def _codes(numbers: list[int]) -> ua.Variant:
    return ua.Variant(numbers, ua.VariantType.Int32, is_array=True)


def _texts(texts: list[str]) -> ua.Variant:
    return ua.Variant(texts, ua.VariantType.String, is_array=True)
