"""A result as OPC 40001-101 tells it: meta data, content, the event that says that it is there, and what filters it."""

from __future__ import annotations

import json
import logging
import uuid
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.common.events import Event
from asyncua.server.address_space import AddressSpace as Nodes
from asyncua.server.monitored_item_service import WhereClauseEvaluator

from station.opcua.address_space import EVENT_FIELDS
from station.opcua.outbox import Kept, ResultMeta
from station.wall_clock import WALL_CLOCK

EVALUATIONS: dict[str | None, int] = {"PASS": 1, "FAIL": 2, "NOT DECIDABLE": 3, None: 0}
"""ResultEvaluationEnum, by verdict: OK, NotOK, NotDecidable; Undefined where there is none."""

STATES = {"complete": 1, "stopped": 3, "fault": 4, "interrupted": 4}
"""ResultState, by how the run ended: completed, aborted, failed."""

CONTENT = "application/json"
SEVERITY, SEVERITY_BAD = 100, 500

PARTS: dict[str, ua.VariantType] = {
    "ResultId": ua.VariantType.String,
    "IsPartial": ua.VariantType.Boolean,
    "IsSimulated": ua.VariantType.Boolean,
    "ResultState": ua.VariantType.Int32,
    "PartId": ua.VariantType.String,
    "ExternalRecipeId": ua.VariantType.String,
    "InternalRecipeId": ua.VariantType.String,
    "ProductId": ua.VariantType.String,
    "InternalConfigurationId": ua.VariantType.String,
    "CreationTime": ua.VariantType.DateTime,
    "ResultEvaluation": ua.VariantType.Int32,
    "ResultEvaluationDetails": ua.VariantType.LocalizedText,
    "FileFormat": ua.VariantType.String,
}
"""Parts of the meta data that this server tells, with their types as fields of an event."""


def meta_of(meta: ResultMeta) -> Any:
    """Return the meta data as ResultMetaDataType."""
    details = "; ".join(meta.altered or meta.reasons)
    times = ua.ProcessingTimesDataType()
    times.StartTime, times.EndTime = _moment(meta.started or meta.sealed_at), _moment(meta.sealed_at)
    return ua.ResultMetaDataType(
        ResultId=meta.run,
        IsPartial=False,
        IsSimulated=meta.simulated,
        ResultState=STATES.get(meta.state, 4),
        PartId=meta.serial,
        ExternalRecipeId=meta.recipe,
        InternalRecipeId=meta.recipe_sha256,
        ProductId=meta.model,
        InternalConfigurationId=meta.bench,
        CreationTime=_moment(meta.sealed_at),
        ProcessingTimes=times,
        ResultEvaluation=ua.ResultEvaluationEnum(0 if meta.altered else EVALUATIONS[meta.verdict]),
        ResultEvaluationDetails=ua.LocalizedText(details, "en"),
        FileFormat=[CONTENT],
    )


def result_of(meta: ResultMeta, content: str | None) -> Any:
    """Return the result as ResultDataType: result.json as it was sealed, and what the chain says of the run."""
    seal = {name: getattr(meta, name) for name in ("run", "serial", "attempt", "sha256", "sealed_at", "altered")}
    texts = [text for text in (content, json.dumps(seal, ensure_ascii=False)) if text is not None]
    return ua.ResultDataType(
        ResultMetaData=meta_of(meta),
        ResultContent=[ua.Variant(text, ua.VariantType.String) for text in texts],
    )


def _moment(text: str) -> datetime:
    return datetime.fromisoformat(text).astimezone(UTC)


def event_of(kept: Kept, event_type: ua.NodeId, source: ua.NodeId, source_name: str) -> Event:
    """Return the event that says that a result is there. Its EventId is made of the result: a repeat has the same."""
    meta, told = kept.meta, meta_of(kept.meta)
    event, kinds = Event(source), ua.VariantType
    good = meta.verdict == "PASS" and not meta.altered
    text = f"{meta.serial}: {'record altered' if meta.altered else meta.verdict or meta.state}"
    identity = uuid.uuid5(uuid.NAMESPACE_URL, f"{meta.run}:{meta.sha256}")
    for name, value, kind in (
        ("EventId", identity.bytes, kinds.ByteString),
        ("EventType", event_type, kinds.NodeId),
        ("SourceNode", source, kinds.NodeId),
        ("SourceName", source_name, kinds.String),
        ("Time", _moment(meta.sealed_at), kinds.DateTime),
        ("ReceiveTime", WALL_CLOCK.now(), kinds.DateTime),
        ("Message", ua.LocalizedText(text, "en"), kinds.LocalizedText),
        ("Severity", SEVERITY if good else SEVERITY_BAD, kinds.UInt16),
        ("Result", ua.ResultDataType(ResultMetaData=told, ResultContent=[]), kinds.ExtensionObject),
        ("Result/ResultMetaData", told, kinds.ExtensionObject),
        ("Verdict", meta.verdict or "", EVENT_FIELDS["Verdict"]),
        ("RunSha256", meta.sha256, EVENT_FIELDS["RunSha256"]),
        ("SerialNumber", meta.serial, EVENT_FIELDS["SerialNumber"]),
        *((f"Result/ResultMetaData/{name}", getattr(told, name), kind) for name, kind in PARTS.items()),
    ):
        event.add_property(name, value, kind)
    return event


class OfTypeToo(WhereClauseEvaluator):
    """A client's filter of events; `OfType` holds for the types above that of the event too, as the standard has it."""

    def __init__(self, nodes: Nodes, where: ua.ContentFilter, types: frozenset[ua.NodeId]) -> None:
        """Prepare it. types: that of our events, and all above it."""
        super().__init__(logging.getLogger(__name__), nodes, where)
        self._types = types

    def _eval_el(self, index: int, event: Any) -> Any:
        element = self.elements[index]
        if element.FilterOperator == ua.FilterOperator.OfType:
            return self._eval_op(element.FilterOperands[0], event) in self._types
        return super()._eval_el(index, event)


class _OfMeta(WhereClauseEvaluator):
    """A filter over results: operands name parts of the meta data, by the last name of their path."""

    def _eval_op(self, op: Any, event: Any) -> Any:
        names: list[str] = []
        if isinstance(op, ua.SimpleAttributeOperand):
            names = [one.Name for one in op.BrowsePath]
        elif isinstance(op, ua.AttributeOperand) and op.BrowsePath:
            names = [one.TargetName.Name for one in op.BrowsePath.Elements]
        return getattr(event, names[-1]) if names else super()._eval_op(op, event)


def chosen_by(nodes: Nodes, where: ua.ContentFilter | None, metas: list[ResultMeta]) -> list[ResultMeta]:
    """Return the results that a filter lets pass.

    Raises:
        ValueError: the filter names what the meta data has not, or asks for what this server cannot do.

    """
    if where is None or not where.Elements:
        return metas
    of_meta = _OfMeta(logging.getLogger(__name__), nodes, where)
    try:
        return [meta for meta in metas if of_meta._eval_el(0, meta_of(meta))]  # noqa: SLF001 - `eval` hides errors
    except (AttributeError, IndexError, NotImplementedError, TypeError, RecursionError) as error:
        raise ValueError(f"the client's filter of results cannot be used: {error}") from error
