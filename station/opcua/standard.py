"""Makes the types of the companion specifications in a server, as `standard_types` tells them."""

from __future__ import annotations

from typing import Any

from asyncua import Server, ua

from station.opcua import standard_types as table
from station.opcua.standard_types import Change, Field, Id, Name, State, StateMachine, Structure

OURS = "urn:lostmotion:opcua"
"""Namespace of what the standards have no node for, and of all instances."""

Ids = ua.ObjectIds
PROPERTY = Id(table.BASE, Ids.PropertyType)


async def load_standards(server: Server) -> dict[str, int]:
    """Put the types of the specifications into a server; return the numbers of the namespaces."""
    numbers = {uri: await server.register_namespace(uri) for uri in (*(row.uri for row in table.MODELS), OURS)}
    maker = _Maker(server, numbers | {table.BASE: 0})
    await maker.models()
    await maker.data_types()
    await maker.types()
    await maker.members()
    await maker.methods()
    await maker.state_machines()
    await server.load_data_type_definitions()
    return numbers


class _Maker:
    """Adds nodes to a server. numbers: of the namespaces."""

    def __init__(self, server: Server, numbers: dict[str, int]) -> None:
        self._session, self._numbers = server.iserver.isession, numbers

    def _id(self, node: Id) -> ua.NodeId:
        return ua.NodeId(node.number, self._numbers[node.space])

    def _name(self, name: Name) -> ua.QualifiedName:
        return ua.QualifiedName(name.name, self._numbers[name.space])

    async def _add(
        self, kind: ua.NodeClass, node: Id, name: Name, attributes: Any, *, parent: Id, by: int,
        of_type: Id | None = None, rule: Id | None = None,
    ) -> None:  # fmt: skip
        """Add a node below another. by: the reference that holds it; of_type: its type definition."""
        attributes.DisplayName = ua.LocalizedText(name.name)
        item = ua.AddNodesItem(
            ParentNodeId=self._id(parent), ReferenceTypeId=ua.NodeId(by), RequestedNewNodeId=self._id(node),
            BrowseName=self._name(name), NodeClass=kind, NodeAttributes=attributes,
        )  # fmt: skip
        if of_type is not None:
            item.TypeDefinition = self._id(of_type)
        (made,) = await self._session.add_nodes([item])
        made.StatusCode.check()
        if rule is not None:
            await self._refer(node, Ids.HasModellingRule, rule, back=False)

    async def _refer(self, source: Id, by: int, target: Id, *, back: bool = True) -> None:
        """Add a reference; back: the target knows of it too."""
        ends = ((source, target, True), (target, source, False)) if back else ((source, target, True),)
        for from_node, to_node, forward in ends:
            item = ua.AddReferencesItem(
                SourceNodeId=self._id(from_node), ReferenceTypeId=ua.NodeId(by), IsForward=forward,
                TargetNodeId=self._id(to_node),
            )  # fmt: skip
            (status,) = await self._session.add_references([item])
            status.check()

    async def _add_object(self, node: Id, name: Name, parent: Id, *, by: int, of_type: int, notifier: int = 0) -> None:
        attributes, kind = ua.ObjectAttributes(EventNotifier=notifier), ua.NodeClass.Object
        await self._add(kind, node, name, attributes, parent=parent, by=by, of_type=Id(table.BASE, of_type))

    async def _add_variable(
        self, node: Id, name: Name, parent: Id, data_type: Id, value: ua.Variant | None = None, *,
        by: int = Ids.HasProperty, rank: int = table.SCALAR, size: int = 0, rule: Id | None = None,
        of_type: Id = PROPERTY,
    ) -> None:  # fmt: skip
        """Add a variable, a property where nothing else is said. size: of a list, 0 where it is not fixed."""
        attributes = ua.VariableAttributes(
            DataType=self._id(data_type), ValueRank=rank, Value=ua.Variant() if value is None else value,
            ArrayDimensions=[size] if rank == table.LIST else None,
        )  # fmt: skip
        await self._add(ua.NodeClass.Variable, node, name, attributes, parent=parent, by=by, of_type=of_type, rule=rule)

    async def models(self) -> None:
        """Tell of each specification; of each there is only a part here."""
        kinds = ua.VariantType
        for row in table.MODELS:
            node = Id(row.uri, row.number)
            parent = Id(table.BASE, Ids.Server_Namespaces)
            await self._add_object(
                node, Name(row.uri, row.uri), parent, by=Ids.HasComponent, of_type=Ids.NamespaceMetadataType
            )
            values = (
                ua.Variant(row.uri, kinds.String), ua.Variant(row.version, kinds.String),
                ua.Variant(row.published, kinds.DateTime), ua.Variant(True, kinds.Boolean),  # noqa: FBT003 - a value
                ua.Variant([0], kinds.Int32, is_array=True),
                ua.Variant(list(row.numbers), kinds.String, is_array=True), ua.Variant("", kinds.String),
            )  # fmt: skip
            for number, (name, data_type, rank), value in zip(row.properties, table.TOLD, values, strict=True):
                await self._add_variable(
                    Id(row.uri, number), Name(table.BASE, name), node, data_type, value, rank=rank
                )  # fmt: skip

    async def data_types(self) -> None:
        """Make enumerations and structures."""
        for row in table.ENUMERATIONS:
            texts = [(number, name, ua.LocalizedText(name)) for number, name in enumerate(row.names)]
            fields = [ua.EnumField(Value=number, DisplayName=text, Name=name) for number, name, text in texts]
            definition = ua.EnumDefinition(Fields=fields)
            await self._data_type(row.id, row.name, Id(table.BASE, Ids.Enumeration), definition)
            values = [ua.EnumValueType(Value=number, DisplayName=text) for number, _, text in texts]
            await self._add_variable(
                row.id._replace(number=row.values), Name(table.BASE, "EnumValues"), row.id,
                Id(table.BASE, Ids.EnumValueType), ua.Variant(values, ua.VariantType.ExtensionObject, is_array=True),
                rank=table.LIST, size=len(values),
            )  # fmt: skip
        inherited: dict[Id, tuple[Field, ...]] = {}
        for structure in table.STRUCTURES:
            fields_of = inherited[structure.id] = (*inherited.get(structure.above, ()), *structure.fields)
            await self._data_type(
                structure.id, structure.name, structure.above, self._definition(structure, fields_of),
                abstract=structure.binary is None,
            )  # fmt: skip
            if structure.binary is not None:
                await self._add_object(
                    structure.id._replace(number=structure.binary), Name(table.BASE, "Default Binary"), structure.id,
                    by=Ids.HasEncoding, of_type=Ids.DataTypeEncodingType,
                )  # fmt: skip

    async def _data_type(
        self, node: Id, name: str, above: Id, definition: ua.DataTypeDefinition, *, abstract: bool = False
    ) -> None:
        attributes = ua.DataTypeAttributes(IsAbstract=abstract)
        attributes.DataTypeDefinition = definition
        await self._add(
            ua.NodeClass.DataType, node, Name(node.space, name), attributes, parent=above, by=Ids.HasSubtype
        )

    def _definition(self, row: Structure, fields: tuple[Field, ...]) -> ua.StructureDefinition:
        definition = ua.StructureDefinition(BaseDataType=self._id(row.above))
        if any(field.optional for field in fields):
            definition.StructureType = ua.StructureType.StructureWithOptionalFields
        if row.binary is not None:
            definition.DefaultEncodingId = self._id(row.id._replace(number=row.binary))
        definition.Fields = [
            ua.StructureField(
                Name=field.name, DataType=self._id(field.data_type), ValueRank=field.rank,
                ArrayDimensions=[0] if field.rank == table.LIST else None,
                IsOptional=field.optional,
            )
            for field in fields
        ]  # fmt: skip
        return definition

    async def types(self) -> None:
        """Make the types of objects and the one of variables."""
        for row in table.TYPES:
            attributes = ua.ObjectTypeAttributes(IsAbstract=row.abstract)
            name = Name(row.id.space, row.name)
            await self._add(ua.NodeClass.ObjectType, row.id, name, attributes, parent=row.above, by=Ids.HasSubtype)
            for interface in row.interfaces:
                await self._refer(row.id, Ids.HasInterface, interface)
            for event in row.events:
                await self._refer(row.id, Ids.GeneratesEvent, event)
        row = table.RESULT_TYPE
        attributes = ua.VariableTypeAttributes(
            DataType=self._id(table.WHOLE), ValueRank=table.SCALAR, IsAbstract=row.abstract
        )
        name = Name(row.id.space, row.name)
        await self._add(ua.NodeClass.VariableType, row.id, name, attributes, parent=row.above, by=Ids.HasSubtype)

    async def members(self) -> None:
        """Make properties and variables of the types, and the folder of machines."""
        for row in table.PROPERTIES:
            value = None if row.value is None else ua.Variant(self._name(row.value), ua.VariantType.QualifiedName)
            await self._add_variable(row.id, row.name, row.of, row.data_type, value, rule=row.rule)
        parts = {field.name: field for structure in table.STRUCTURES for field in structure.fields}
        for one in table.VARIABLES:
            await self._add_variable(
                one.id, Name(one.id.space, one.name), one.of, one.data_type,
                by=one.by, rank=one.rank, rule=one.rule, of_type=one.of_type,
            )  # fmt: skip
        wholes = [one.id for one in table.VARIABLES if one.data_type == table.META]
        for name, numbers in table.PARTS.items():
            for whole, number in zip(wholes, numbers, strict=True):
                await self._add_variable(
                    whole._replace(number=number), Name(whole.space, name), whole, parts[name].data_type,
                    by=Ids.HasStructuredComponent, rank=parts[name].rank,
                    rule=table.OPTIONAL if parts[name].optional else table.MANDATORY,
                    of_type=Id(table.BASE, Ids.BaseDataVariableType),
                )  # fmt: skip
        await self._add_object(
            table.MACHINES, Name(table.MACHINERY, "Machines"), Id(table.BASE, Ids.ObjectsFolder), by=Ids.Organizes,
            of_type=Ids.FolderType, notifier=ua.EventNotifier.SubscribeToEvents.mask,
        )  # fmt: skip

    async def methods(self) -> None:
        """Make the methods of ResultManagementType."""
        owner = next(row.id for row in table.TYPES if row.name == "ResultManagementType")
        for row in table.METHODS:
            node = owner._replace(number=row.number)
            await self._add(
                ua.NodeClass.Method, node, Name(table.RESULT, row.name), ua.MethodAttributes(),
                parent=owner, by=Ids.HasComponent, rule=table.OPTIONAL,
            )  # fmt: skip
            for name, (number, fields) in (("InputArguments", row.inputs), ("OutputArguments", row.outputs)):
                arguments = [
                    ua.Argument(
                        Name=field.name, DataType=self._id(field.data_type), ValueRank=field.rank,
                        ArrayDimensions=[0] if field.rank == table.LIST else [],
                    )
                    for field in fields
                ]  # fmt: skip
                await self._add_variable(
                    owner._replace(number=number), Name(table.BASE, name), node, Id(table.BASE, Ids.Argument),
                    ua.Variant(arguments, ua.VariantType.ExtensionObject, is_array=True),
                    rank=table.LIST, size=len(arguments), rule=table.MANDATORY,
                )  # fmt: skip

    async def state_machines(self) -> None:
        """Make states and transitions of the two state machines."""
        for machine in table.STATE_MACHINES:
            nodes = {state.name: machine.of._replace(number=state.number) for state in machine.states}
            for state in machine.states:
                await self._step(machine, state, state.name, Ids.StateType, "StateNumber")
            for change in machine.changes:
                name = f"From{change.source}To{change.target}"
                await self._step(machine, change, name, Ids.TransitionType, "TransitionNumber")
                node = machine.of._replace(number=change.number)
                await self._refer(node, Ids.FromState, nodes[change.source])
                await self._refer(node, Ids.ToState, nodes[change.target])

    async def _step(
        self, machine: StateMachine, row: State | Change, name: str, of_type: int, told: str
    ) -> None:  # fmt: skip
        """Add a state or a transition with its number."""
        node, number = (machine.of._replace(number=row.number + more) for more in (0, machine.above))
        await self._add_object(node, Name(node.space, name), machine.of, by=Ids.HasComponent, of_type=of_type)
        await self._add_variable(
            number, Name(table.BASE, told), node, Id(table.BASE, Ids.UInt32),
            ua.Variant(row.value, ua.VariantType.UInt32), rule=table.MANDATORY,
        )  # fmt: skip
