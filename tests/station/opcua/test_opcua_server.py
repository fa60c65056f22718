"""The OPC UA server over real sockets: who gets in, what is shown, and results that come to each client once.

One server for all of it; it is killed in the middle, and started again.
"""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from asyncua import Client, ua
from asyncua.server.address_space import AddressSpace, NodeManagementService
from asyncua.server.standard_address_space import standard_address_space
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from opcua_support import (
    NODE_CLIENT,
    PATIENCE_S,
    Plant,
    acknowledge,
    call,
    kept_by,
    know_types,
    listen,
    of_ours,
    write_pair,
)
from station_support import PASSWORD

from station.opcua.certificates import read_certificate
from station.opcua.outbox import Outbox
from station.own_place import PLACE
from station.web.people.accounts import disable_person
from station.web.people.database import StationDatabase

pytestmark = pytest.mark.wires

NO_NODE = shutil.which("node") is None or not (NODE_CLIENT.parent / "node_modules").exists()


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    patch = pytest.MonkeyPatch()
    folder = tmp_path_factory.mktemp("opcua")
    patch.setenv(PLACE, str(folder / "place"))
    base = AddressSpace()
    standard_address_space.fill_address_space(NodeManagementService(base))
    # The nodes of OPC UA itself take seconds: they are made once, and each server that is forked has them.
    patch.setattr(
        standard_address_space, "fill_address_space", lambda service: service._aspace._nodes.update(base._nodes)
    )
    found = Plant(folder / "data")
    found.set_up()
    found.seal("SN-1", "SN-2")
    found.start()
    yield found
    found.kill()
    patch.undo()


def test_the_bench_is_a_machine_with_states_and_values_that_nobody_writes(plant: Plant) -> None:
    async def look(client: Client) -> None:
        machines = await client.nodes.objects.get_child(["3:Machines"])
        (machine,) = [one for one in await machines.get_children() if one.nodeid.NamespaceIndex == 5]
        assert (await machine.read_browse_name()).Name == "TB-1"
        told = {}
        for one in await of_ours(client, "Machine.Identification").get_children():
            told[(await one.read_browse_name()).Name] = await one.read_value()
        assert told["Manufacturer"].Text == "Example GmbH"
        assert (told["SerialNumber"], told["Location"]) == ("TB-1", "Hall 3")
        assert told["ProductInstanceUri"] == "urn:example-gmbh:rv-bench:tb-1"
        end_s = asyncio.get_running_loop().time() + PATIENCE_S
        state = of_ours(client, "Machine.MachineryItemState.CurrentState")
        while (await state.read_value()).Text != "NotExecuting":  # until the bench was looked at first
            assert asyncio.get_running_loop().time() < end_s
            await asyncio.sleep(0.05)
        assert await of_ours(client, "Machine.PackML.StateName").read_value() == "Complete"
        torque = of_ours(client, "Machine.Bench.Values.torque_out_nm")
        seen = await torque.read_data_value(raise_on_bad_status=False)
        assert seen.StatusCode.value == ua.StatusCodes.BadWaitingForInitialData
        unit = await (await torque.get_child(["0:EngineeringUnits"])).read_value()
        assert (unit.DisplayName.Text, unit.UnitId) == ("N·m", 20053)
        with pytest.raises(ua.UaStatusCodeError) as refused:
            await torque.write_value(1.0)
        assert refused.value.code == ua.StatusCodes.BadUserAccessDenied
        with pytest.raises(ua.UaStatusCodeError) as refused:
            await machine.add_folder(5, "mine")
        assert refused.value.code == ua.StatusCodes.BadUserAccessDenied

    async def main() -> None:
        async with plant.session("the admin") as client:
            await look(client)
            with pytest.raises(ua.UaStatusCodeError) as refused:
                await acknowledge(client, ["x"])
            assert refused.value.code == ua.StatusCodes.BadUserAccessDenied, "no results are kept for this account"

    asyncio.run(main())


async def pretend(plant: Plant) -> None:
    """Show the certificate of a trusted application over a channel that was opened with a key of one's own."""
    client = plant.client()
    await plant.secure(client, "stranger")
    await client.connect_socket()
    try:
        await client.send_hello()
        await client.open_secure_channel()
        trusted = read_certificate(plant.data.parent / "client.pem")
        client.security_policy.host_certificate = trusted.public_bytes(serialization.Encoding.DER)
        client.security_policy.asymmetric_cryptography.verify = lambda *_: None
        await client.create_session()
        await client.activate_session("the mes", PASSWORD)
    finally:
        client.disconnect_socket()


def test_who_is_not_trusted_or_not_known_gets_no_session(plant: Plant, monkeypatch: pytest.MonkeyPatch) -> None:
    codes = ua.StatusCodes
    stranger = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    write_pair(plant.data.parent, "stranger", stranger)

    async def refused(*expected: int, **words: str | None) -> None:
        with pytest.raises(ua.UaStatusCodeError) as error:
            async with plant.session(**words):
                pass
        assert error.value.code in expected

    async def main() -> None:
        with monkeypatch.context() as patch:
            patch.setattr(Client, "find_endpoint", staticmethod(lambda endpoints, *_: endpoints[0]))
            with pytest.raises(ua.UaStatusCodeError) as error:
                async with plant.client():
                    pass
        assert error.value.code == codes.BadSecurityPolicyRejected, "nobody logs in over an open channel"
        with pytest.raises(ua.UaStatusCodeError) as error:
            await pretend(plant)
        assert error.value.code == codes.BadCertificateUntrusted, "the key of the channel counts"
        await refused(codes.BadCertificateUntrusted, name="stranger")
        await refused(codes.BadUserAccessDenied, password="not this")  # noqa: S106 - it is wrong
        await refused(codes.BadUserAccessDenied, user="nobody")
        await refused(codes.BadIdentityTokenRejected, user=None)
        kept = list((plant.data / "opcua" / "rejected").iterdir())
        assert len(kept) == 1, "it can be trusted by one command"

    asyncio.run(main())


def test_results_by_id_the_newest_and_those_that_a_filter_chooses(plant: Plant) -> None:
    async def main() -> None:
        (bad,) = plant.seal("SN-BAD", failed="too large")
        async with plant.session() as client:
            await know_types(client)
            no_time = ua.Variant(0, ua.VariantType.Int32)
            for _ in range(int(PATIENCE_S / 0.05)):
                _, result, error = await call(client, "GetLatestResult", no_time)
                if result.ResultMetaData.ResultId == bad:
                    break
                await asyncio.sleep(0.05)
            meta = result.ResultMetaData
            assert (error, meta.ResultId, meta.PartId, int(meta.ResultEvaluation)) == (0, bad, "SN-BAD", 2)
            content, seal = (json.loads(one.Value) for one in result.ResultContent)
            assert content == json.loads((plant.data / bad / "result.json").read_text())
            assert (seal["run"], seal["altered"], len(seal["sha256"])) == (bad, [], 64)
            file = plant.data / bad / "result.json"
            sealed = file.read_bytes()
            file.write_text("{}")
            for method, asked in (("GetResultById", [ua.Variant(bad)]), ("GetLatestResult", [])):
                _, result, error = await call(client, method, *asked, no_time)
                meta = result.ResultMetaData
                assert (error, int(meta.ResultEvaluation), len(result.ResultContent)) == (0, 0, 1)
                assert "result.json: was changed after" in meta.ResultEvaluationDetails.Text
            file.write_bytes(sealed)
            _, _, error = await call(client, "GetResultById", ua.Variant("no such run"), no_time)
            assert error < 0
            chosen = ua.ContentFilter(
                Elements=[
                    ua.ContentFilterElement(
                        FilterOperator=ua.FilterOperator.Equals,
                        FilterOperands=[
                            ua.SimpleAttributeOperand(BrowsePath=[ua.QualifiedName("PartId", 4)]),
                            ua.LiteralOperand(Value=ua.Variant("SN-BAD")),
                        ],
                    )
                ]
            )
            none = ua.Variant([], ua.VariantType.ExtensionObject, is_array=True)
            most = ua.Variant(0, ua.VariantType.UInt32)
            for where, expected in ((chosen, [bad]), (ua.ContentFilter(), None)):
                _, ids, error = await call(client, "GetResultIdListFiltered", ua.Variant(where), none, most, no_time)
                assert error == 0
                assert ids == expected or (expected is None and len(ids) >= 3)

    asyncio.run(main())


def waiting(plant: Plant, client: str) -> int:
    database = StationDatabase(plant.data)
    (row,) = [one for one in Outbox(database, plant.data).clients() if one.name == client]
    database.close()
    return row.waiting


def test_each_result_comes_to_each_client_once_through_disconnects_and_a_kill(plant: Plant, tmp_path: Path) -> None:
    kept = tmp_path / "kept.jsonl"
    before = [one.name for one in sorted(plant.data.glob("*Z-*"))]

    async def first() -> None:
        async with plant.session() as client:
            heard = await listen(client)
            await heard.wait_for(len(before))
            assert heard.runs == before, "what was sealed before it came, in this order"
            assert heard.events[0].Message.Text == "SN-1: PASS"
            assert len(heard.events[0].RunSha256) == 64
        file = plant.data / before[0] / "result.json"
        sealed = file.read_bytes()
        file.write_text("{}")
        async with plant.session() as client:
            heard = await listen(client)
            await heard.wait_for(len(before))
            assert heard.runs == before, "it was not acknowledged: it comes again"
            assert heard.events[0].Message.Text == "SN-1: record altered"
            assert int(heard.events[0].Result.ResultMetaData.ResultEvaluation) == 0
            file.write_bytes(sealed)
            assert (await acknowledge(client, [*before, "no such run"]))[1] < 0
            assert await acknowledge(client, before) == [[], 0], "to acknowledge twice is no error"
            new = plant.seal("SN-LIVE")
            await heard.wait_for(len(before) + 1)
            assert heard.runs[len(before) :] == new
            await acknowledge(client, new)

    asyncio.run(first())
    plant.kill()
    away = plant.seal("SN-AWAY-1", "SN-AWAY-2")
    plant.start()

    async def second() -> None:
        async with plant.session() as client:
            heard = await listen(client)
            await heard.wait_for(2)
            last = plant.seal("SN-LAST")
            await heard.wait_for(3)
            assert heard.runs == [*away, *last], "none of those that were acknowledged, and each that was sealed"
            await acknowledge(client, heard.runs)
        assert waiting(plant, "mes") == 0

    asyncio.run(second())
    if not NO_NODE:
        node = plant.node(kept, len(_runs(plant)))
        assert node.wait(PATIENCE_S) == 0, node.communicate()
        assert [one["id"] for one in kept_by(kept)] == _runs(plant)
        assert not kept.with_name("kept.jsonl.again").exists(), "none came twice"
        assert {one["verdict"] for one in kept_by(kept)} == {"PASS", "FAIL"}, "read from the content that came"
    assert waiting(plant, "node") == (len(_runs(plant)) if NO_NODE else 0)


def test_the_session_of_an_account_that_is_closed_ends(plant: Plant) -> None:
    async def main() -> None:
        async with plant.session("the engineer") as client:
            database = StationDatabase(plant.data)
            with database.writing() as connection:
                disable_person(connection, "the engineer")
            database.close()
            state = of_ours(client, "Machine.PackML.StateName")
            for _ in range(int(PATIENCE_S / 0.2)):
                try:
                    await state.read_value()
                except (ua.UaError, ConnectionError):
                    return
                await asyncio.sleep(0.2)
        raise AssertionError("its session goes on")

    asyncio.run(main())


@pytest.mark.skipif(NO_NODE, reason="node-opcua is missing: make node-opcua")
def test_node_opcua_took_part() -> None:
    """One line where it is missing."""


def _runs(plant: Plant) -> list[str]:
    return [one.name for one in sorted(plant.data.glob("*Z-*"))]
