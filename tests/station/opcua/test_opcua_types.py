"""Types of the companion specifications: their tables fit what the server says, and all of them are made."""

from __future__ import annotations

import asyncio
from collections import Counter

from asyncua import Server, ua

from station.opcua import projection, result_data
from station.opcua import standard_types as table
from station.opcua.standard import OURS, load_standards


def test_what_the_server_says_is_in_the_tables() -> None:
    item, operation = table.STATE_MACHINES
    for machine, states in ((item, projection.ItemState), (operation, projection.OperationMode)):
        assert {(state.number, state.name) for state in machine.states} == {(int(one), one.title) for one in states}
        names = [state.name for state in machine.states]
        changes = [(change.source, change.target) for change in machine.changes]
        assert sorted(changes) == sorted((source, target) for source in names for target in names)
    assert set(table.PARTS) == {*result_data.PARTS, "ProcessingTimes"}
    (evaluation,) = table.ENUMERATIONS
    assert set(result_data.EVALUATIONS.values()) == set(range(len(evaluation.names)))


def rows_of_a_namespace() -> Counter[str]:
    """Count the nodes that the tables ask for."""
    count = Counter({row.uri: 1 + len(row.properties) for row in table.MODELS})
    owners = (*table.TYPES, *table.PROPERTIES, *table.STRUCTURES, *table.VARIABLES, table.RESULT_TYPE)
    count += Counter(row.id.space for row in owners)
    machines = table.STATE_MACHINES
    count[table.MACHINERY] += 1 + sum(2 * len((*machine.states, *machine.changes)) for machine in machines)
    binary = sum(row.binary is not None for row in table.STRUCTURES)
    count[table.RESULT] += binary + 2 * len(table.ENUMERATIONS) + 2 * len(table.PARTS) + 3 * len(table.METHODS)
    return count


def test_all_types_are_made_in_their_namespaces() -> None:
    async def main() -> None:
        server = Server()
        await server.init()
        numbers = await load_standards(server)
        assert (await server.get_namespace_array())[2:] == [table.DI, table.MACHINERY, table.RESULT, OURS]
        made = Counter(node.NamespaceIndex for node in server.iserver.aspace._nodes)
        assert {uri: made[numbers[uri]] for uri in (table.DI, table.MACHINERY, table.RESULT)} == rows_of_a_namespace()
        for row in table.MODELS:
            told = await server.nodes.namespaces.get_child([ua.QualifiedName(row.uri, numbers[row.uri])])
            assert await (await told.get_child(["0:IsNamespaceSubset"])).read_value(), "clients know that more exists"
        above = server.get_node(ua.NodeId(1012, numbers[table.MACHINERY]))
        names = []
        while above.nodeid != ua.NodeId(ua.ObjectIds.BaseObjectType):
            names.append((await above.read_browse_name()).Name)
            above = await above.get_parent()
        assert names == [
            "MachineIdentificationType", "MachineryItemIdentificationType", "FunctionalGroupType", "FolderType",
        ]  # fmt: skip

    asyncio.run(main())
