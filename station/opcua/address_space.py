"""The nodes of the server: the bench as a machine of OPC 40001-1, its results, its states and its live values."""

from __future__ import annotations

from typing import Any, NamedTuple

from asyncua import Node, Server, ua

from definitions.states import STATES
from station.opcua.projection import NOTHING_KNOWN, ItemState, OperationMode, Projected
from station.opcua.settings import OpcUaSettings
from station.opcua.standard import OURS, load_standards
from station.opcua.standard_types import DI, MACHINERY, RESULT
from station.opcua.values import NOTHING, VALUES, Value, unit_information
from station.version import version
from station.wall_clock import WALL_CLOCK

MACHINES_FOLDER, IDENTIFICATION, ITEM_STATE, OPERATION_MODE = 1001, 1012, 1002, 1008
"""Nodes of OPC 40001-1: the folder of machines, and three types."""

RESULT_MANAGEMENT, RESULT_READY = 1004, 1002
"""Types of OPC 40001-101."""

EVENT_FIELDS: dict[str, ua.VariantType] = {
    "Verdict": ua.VariantType.String,
    "RunSha256": ua.VariantType.String,
    "SerialNumber": ua.VariantType.String,
}
"""What our event has beside that of the standard."""


class Text(NamedTuple):
    """A variable of ours that says something in words: its name, and what it means."""

    name: str
    meaning: str


TEXTS: tuple[Text, ...] = (
    Text("State", f"State of the controller: {', '.join(row.state.name.lower() for row in STATES)}"),
    Text("StateText", "The same in words, as an operator reads it"),
    Text("Run", "Run that is on, or was on last"),
    Text("SerialNumber", "Unit of that run"),
    Text("Recipe", "Recipe of that run, with its revision"),
)


class AddressSpace:
    """The nodes that change, and how they are changed."""

    def __init__(self, server: Server, settings: OpcUaSettings, spaces: dict[str, int]) -> None:
        """Use `built_in`."""
        self.server, self.settings, self.spaces = server, settings, spaces
        self.machine: Node
        self.results: Node
        self.event_type: Node
        self._nodes: dict[str, ua.NodeId] = {}
        self._written: dict[str, tuple[object, int]] = {}

    def _id(self, name: str) -> ua.NodeId:
        return ua.NodeId(name, self.spaces[OURS])

    def _named(self, name: str, space: str = OURS) -> ua.QualifiedName:
        return ua.QualifiedName(name, self.spaces[space])

    def _type(self, number: int, space: str = MACHINERY) -> ua.NodeId:
        return ua.NodeId(number, self.spaces[space])

    async def build(self) -> None:
        """Make all nodes."""
        folder = self.server.get_node(self._type(MACHINES_FOLDER))
        name = self.settings.machine.serial_number
        self.machine = await folder.add_object(self._id("Machine"), self._named(name))
        await self._identification()
        await self._states()
        await self._results()
        await self._packml()
        await self._values()

    async def _identification(self) -> None:
        machine = self.settings.machine
        told: tuple[tuple[str, str, str | ua.LocalizedText | None], ...] = (
            ("Manufacturer", DI, ua.LocalizedText(machine.manufacturer)),
            ("SerialNumber", DI, machine.serial_number),
            ("ProductInstanceUri", DI, self.settings.product_uri),
            ("Model", DI, ua.LocalizedText(machine.model)),
            ("SoftwareRevision", DI, version()),
            ("DeviceClass", DI, "Test bench for gear reducers"),
            ("Location", MACHINERY, machine.location),
        )
        node = await self.machine.add_object(
            self._id("Machine.Identification"),
            self._named("Identification", DI),
            self._type(IDENTIFICATION),
            instantiate_optional=False,
        )
        mandatory = {(await child.read_browse_name()).Name: child for child in await node.get_children()}
        for name, space, value in told:
            if value is None:
                continue
            kind = ua.VariantType.LocalizedText if isinstance(value, ua.LocalizedText) else ua.VariantType.String
            if name in mandatory:
                await mandatory[name].write_value(ua.Variant(value, kind))
            else:
                await node.add_property(
                    self._id(f"Machine.Identification.{name}"), self._named(name, space), value, kind
                )
        blocks = await self.machine.add_folder(
            self._id("Machine.MachineryBuildingBlocks"), self._named("MachineryBuildingBlocks", MACHINERY)
        )
        self._nodes["blocks"] = blocks.nodeid
        await blocks.add_reference(node, ua.ObjectIds.HasAddIn)

    async def _states(self) -> None:
        blocks = self.server.get_node(self._nodes["blocks"])
        for name, kind in (("MachineryItemState", ITEM_STATE), ("MachineryOperationMode", OPERATION_MODE)):
            node = await self.machine.add_object(
                self._id(f"Machine.{name}"), self._named(name, MACHINERY), self._type(kind), instantiate_optional=False
            )
            await blocks.add_reference(node, ua.ObjectIds.HasAddIn)
            current = await node.get_child(["0:CurrentState"])
            self._nodes[name] = current.nodeid
            self._nodes[f"{name}.Id"] = (await current.get_child(["0:Id"])).nodeid

    async def _results(self) -> None:
        self.results = await self.machine.add_object(
            self._id("Machine.ResultManagement"), self._named("ResultManagement", RESULT),
            self._type(RESULT_MANAGEMENT, RESULT),
        )  # fmt: skip
        ready = self.server.get_node(self._type(RESULT_READY, RESULT))
        self.event_type = await ready.add_object_type(
            self._id("LostmotionResultReadyEventType"), self._named("LostmotionResultReadyEventType")
        )
        for name, kind in EVENT_FIELDS.items():
            node = await self.event_type.add_property(self._id(f"Event.{name}"), self._named(name), "", kind)
            await node.set_modelling_rule(mandatory=True)
        for node in (self.results, self.machine):
            await node.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
            await node.add_reference(self.event_type, ua.ObjectIds.GeneratesEvent)
        await self.machine.add_reference(self.results, ua.ObjectIds.HasNotifier)

    async def method(self, name: str) -> Node:
        """Return a method of the result management."""
        return await self.results.get_child([self._named(name, RESULT)])

    async def _packml(self) -> None:
        node = await self.machine.add_object(self._id("Machine.PackML"), self._named("PackML"))
        for name, first in (("StateCurrent", 0), ("StateName", ""), ("UnitModeCurrent", 0)):
            kind = ua.VariantType.String if isinstance(first, str) else ua.VariantType.Int32
            variable = await node.add_variable(self._id(f"Machine.PackML.{name}"), self._named(name), first, kind)
            self._nodes[f"PackML.{name}"] = variable.nodeid

    async def _values(self) -> None:
        folder = await self.machine.add_folder(self._id("Machine.Bench"), self._named("Bench"))
        for text in TEXTS:
            node = await folder.add_variable(
                self._id(f"Machine.Bench.{text.name}"), self._named(text.name), "", ua.VariantType.String
            )
            await _describe(node, text.meaning)
            self._nodes[text.name] = node.nodeid
        values = await folder.add_folder(self._id("Machine.Bench.Values"), self._named("Values"))
        for field in VALUES:
            node = await values.add_variable(
                self._id(f"Machine.Bench.Values.{field.name}"), self._named(field.name), 0.0, ua.VariantType.Double,
                datatype=ua.NodeId(ua.ObjectIds.Double),
            )  # fmt: skip
            await _describe(node, f"{field.meaning} [{field.unit}]")
            await node.delete_reference(ua.ObjectIds.BaseDataVariableType, ua.ObjectIds.HasTypeDefinition)
            await node.add_reference(ua.ObjectIds.AnalogUnitType, ua.ObjectIds.HasTypeDefinition)
            await node.add_property(
                self._id(f"Machine.Bench.Values.{field.name}.EngineeringUnits"),
                ua.QualifiedName("EngineeringUnits", 0), unit_information(field.unit),
                datatype=ua.NodeId(ua.ObjectIds.EUInformation),
            )  # fmt: skip
            self._nodes[field.name] = node.nodeid

    async def _write(self, name: str, value: Any, kind: ua.VariantType, status: int = ua.StatusCodes.Good) -> None:
        """Write a value where it is another, or another status, than before."""
        if self._written.get(name) == (value, status):
            return
        self._written[name] = (value, status)
        told = ua.Variant(value, kind) if value is not None else ua.Variant(None, ua.VariantType.Null)
        data = ua.DataValue(told, ua.StatusCode(status), SourceTimestamp=WALL_CLOCK.now())
        await self.server.iserver.write_attribute_value(self._nodes[name], data)

    async def show_state(self, row: Projected) -> None:
        """Show the state of the bench as the standards name it."""
        shown: tuple[tuple[str, ItemState | OperationMode], ...] = (
            ("MachineryItemState", row.item), ("MachineryOperationMode", row.operation),
        )  # fmt: skip
        for name, state in shown:
            await self._write(name, ua.LocalizedText(state.title, "en"), ua.VariantType.LocalizedText)
            await self._write(f"{name}.Id", self._type(int(state)), ua.VariantType.NodeId)
        await self._write("PackML.StateCurrent", int(row.packml), ua.VariantType.Int32)
        await self._write("PackML.StateName", row.packml.title, ua.VariantType.String)
        await self._write("PackML.UnitModeCurrent", int(row.mode), ua.VariantType.Int32)

    async def show_texts(self, texts: dict[str, str]) -> None:
        """Show what is said of the bench in words, by the names of `TEXTS`."""
        for name, text in texts.items():
            await self._write(name, text, ua.VariantType.String)

    async def show_values(self, values: dict[str, Value]) -> None:
        """Show live values with their status."""
        for name, (value, status) in values.items():
            await self._write(name, value, ua.VariantType.Double, status)


async def _describe(node: Node, text: str) -> None:
    await node.write_attribute(ua.AttributeIds.Description, ua.DataValue(ua.LocalizedText(text, "en")))


async def built_in(server: Server, settings: OpcUaSettings) -> AddressSpace:
    """Make all nodes in a server; nothing is known of the bench yet."""
    space = AddressSpace(server, settings, await load_standards(server))
    await space.build()
    await space.show_state(NOTHING_KNOWN)
    await space.show_texts({text.name: "" for text in TEXTS})
    await space.show_values(NOTHING)
    return space
