"""What the OPC UA server says, by its tables; its settings, its certificates, its outbox. No sockets."""

from __future__ import annotations

import re
import shutil
import socket
from dataclasses import replace
from pathlib import Path

import pytest
from asyncua import ua
from ended_runs import bench_of, cancelled, ended, recovered
from lostmotion_command import ROOT, here
from opcua_support import SETTINGS, Plant, write_pair
from station_support import GOLDEN
from stored_runs import metric, store_run
from test_bench_sight import FRESH, NO_ORDERS

from controller.aftermath import FaultReaction
from definitions.image import AGE_NEVER, IMAGE_FIELDS, Link, State
from definitions.program import Program
from definitions.states import RUNNING as RUNNING_STATES
from recipes import RecipeError
from station.bench.request import load_job
from station.documents.manifest import RECORDING, STATES, VERDICTS
from station.errors import StationError
from station.opcua import result_data
from station.opcua.bench_view import STATE_OF_RUN, BenchView
from station.opcua.certificates import checked_certificate, make_certificate
from station.opcua.outbox import BEFORE_ALL, Outbox
from station.opcua.projection import PROJECTION, ItemState, OperationMode, PackMl, UnitMode, projected
from station.opcua.server import _held
from station.opcua.settings import Client, load_opcua
from station.opcua.values import UNITS, VALUES, unit_information, values_of
from station.records.chain.entries import REMOVED
from station.records.chain.writing import writing_to
from station.records.samples.scan_record import pack
from station.web.people.database import StationDatabase
from station.web.running import ENDED, READY, RUNNING, Now


@pytest.fixture(scope="module")
def program() -> Program:
    return load_job(str(GOLDEN), None).program


def test_every_state_is_one_of_packml_and_of_machinery() -> None:
    assert set(PROJECTION) == set(State)
    assert projected(State.FAULT, settled=False).packml is PackMl.ABORTING
    assert projected(State.FAULT).item is ItemState.OUT_OF_SERVICE
    assert projected(None).item is ItemState.NOT_AVAILABLE
    executing = {state for state, row in PROJECTION.items() if row.item is ItemState.EXECUTING}
    assert executing == RUNNING_STATES, "the bench executes exactly where a run is between its start and its end"
    page = (ROOT / "docs" / "opcua.md").read_text()
    for state, row in PROJECTION.items():
        line = rf"^\|[^|]*\b{state.name.lower()}\b[^|]*\|[^|]*\b{row.packml} {row.packml.title}"
        assert re.search(line, page, re.MULTILINE)


def test_every_end_of_a_run_and_every_verdict_is_told() -> None:
    assert set(STATE_OF_RUN) >= set(STATES) - {RECORDING}
    assert set(result_data.STATES) == set(STATES) - {RECORDING}
    assert set(result_data.EVALUATIONS) == {*VERDICTS, None}


def test_every_measured_value_has_a_unit_and_a_status(program: Program) -> None:
    assert {field.unit for field in IMAGE_FIELDS} - set(UNITS) == {"", "scans", "µs"}
    assert len({unit_information(unit).UnitId for unit in UNITS}) == len(UNITS)

    def status(name: str, *, on: bool = True, **image: float) -> int:
        return values_of(FRESH._replace(**image), program, on=on)[name][1]

    good = values_of(FRESH, program, on=True)
    assert list(good) == [field.name for field in VALUES]
    assert good["torque_out_nm"] == (20.0, ua.StatusCodes.Good)
    codes = ua.StatusCodes
    assert status("torque_out_nm", on=False) == codes.UncertainLastUsableValue
    too_old = program.limits.sample_stale_scans + 1
    assert status("torque_out_nm", sample_age_scans=too_old) == codes.UncertainLastUsableValue
    assert status("torque_out_nm", sample_age_scans=AGE_NEVER) == codes.BadWaitingForInitialData
    assert status("torque_out_nm", links_lost=Link.AMPLIFIER) == codes.BadNoCommunication
    assert status("torque_out_nm", torque_out_nm=float("nan")) == codes.BadSensorFailure
    without = replace(program, has_torque_in=False)
    assert values_of(FRESH, without, on=True)["torque_in_nm"] == (None, codes.BadNotSupported)


def test_the_bench_is_shown_while_a_run_is_on_and_as_it_was_left(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = BenchView(tmp_path)
    nothing = view.look()
    assert (nothing.states.item, nothing.texts["State"]) == (ItemState.NOT_AVAILABLE, "")
    orders = NO_ORDERS._replace(state=State.RAMP_POS)
    now = Now(RUNNING, "SN-1", "the run", recipe="r r1", record=pack((0, 0, 0, 0), FRESH, orders), program=program)
    monkeypatch.setattr(view._running, "now", lambda: now)
    seen = view.look()
    assert (seen.states.packml, seen.texts["SerialNumber"]) == (PackMl.EXECUTE, "SN-1")
    assert seen.values["torque_out_nm"] == (20.0, ua.StatusCodes.Good)
    monkeypatch.setattr(view, "_changed_s", -100.0)
    assert view.look().values["torque_out_nm"][1] == ua.StatusCodes.UncertainLastUsableValue, "no record came for long"
    fault = NO_ORDERS._replace(state=State.FAULT, phase=FaultReaction.SETTLED - 1)
    monkeypatch.setattr(view._running, "now", lambda: replace(now, record=pack((0, 0, 0, 0), FRESH, fault)))
    assert view.look().states.packml is PackMl.ABORTING
    jog = replace(now, serial="jog", run="a jog", record=pack((0, 0, 0, 0), FRESH, NO_ORDERS._replace(state=State.JOG)))
    with monkeypatch.context() as patch:
        patch.setattr(view._jog, "now", lambda: jog)
        patch.setattr(view, "_program_of_jog", lambda _: program)
        jogged = view.look()
        assert (jogged.states.mode, jogged.states.operation) == (UnitMode.MANUAL, OperationMode.SETUP)
        assert (jogged.texts["Run"], jogged.texts["SerialNumber"]) == ("a jog", "")
        patch.setattr(view, "_program_of_jog", lambda _: None)
        assert view.look().states.packml is PackMl.IDLE, "its program is being written"
    run = store_run(tmp_path, "SN-1", [metric(0.5)])
    monkeypatch.setattr(view._running, "now", lambda: Now(ENDED, "SN-1", run.id))
    left = view.look()
    assert left.states.packml is PackMl.COMPLETE
    assert left.values["torque_out_nm"] == (20.0, ua.StatusCodes.UncertainLastUsableValue)
    fault = ended(tmp_path, "SN-2", None, "fault", bench_of("bench-3"))
    last = cancelled(tmp_path, "SN-3", bench_of("bench-3"))
    monkeypatch.setattr(view._running, "now", lambda: Now(ENDED, "SN-3", last))
    assert view.look().texts["State"] == "fault", "as the run before the cancelled start left it"
    recovered(tmp_path, fault, bench_of("bench-3"))
    assert view.look().texts["State"] == "stopped"
    monkeypatch.setattr(view._running, "now", lambda: Now(READY))
    assert view.look().states.item is ItemState.NOT_AVAILABLE


def test_what_an_outbox_owes_is_owed_until_it_is_acknowledged(tmp_path: Path) -> None:
    data = tmp_path / "data"
    before = store_run(data, "SN-0", [metric(0.5)]).id
    database = StationDatabase(data)
    outbox = Outbox(database, data)
    late, first = Client(name="late", user="a"), Client(name="first", user="b", from_first=True)
    outbox.set_up([first])
    assert outbox.collect() == 1
    outbox.set_up([first, late])
    stopped = store_run(data, "SN-1", [metric(0.5)], state="stopped").id
    altered = store_run(data, "SN-2", [metric(0.5)])
    (altered.folder / "result.json").write_text("{}")
    assert (outbox.collect(), outbox.collect()) == (2, 0)
    assert [one.meta.run for one in outbox.owed("first", 9)] == [before, stopped, altered.id]
    assert [one.meta.run for one in outbox.owed("late", 9)] == [stopped, altered.id]
    again = Outbox(database, data)
    again.set_up([late])
    assert again.collect() == 0
    assert again.acknowledge("first", [before, "no such run"]) == [True, False]
    assert again.acknowledge("first", [before]) == [True], "the answer to the first may have been lost"
    rows = {row.name: row for row in again.clients()}
    assert (rows["first"].waiting, rows["first"].acknowledged, rows["late"].waiting) == (2, 1, 2)
    assert again.content(again.owed("first", 1)[0].meta) is not None
    told = again.owed("first", 9)[-1].meta
    assert told.altered
    assert again.content(told) is None
    assert again.forget("first") == 2
    with pytest.raises(StationError, match="Known clients: late"):
        again.forget("first")
    database.close()


def test_a_client_that_is_added_later_is_owed_what_was_there_before_it_in_its_order(tmp_path: Path) -> None:
    data = tmp_path / "data"
    early = [store_run(data, serial, [metric(0.5)]).id for serial in ("SN-0", "SN-1")]
    database = StationDatabase(data)
    outbox = Outbox(database, data)
    plain, every = Client(name="plain", user="a"), Client(name="every", user="b", from_first=True)
    outbox.set_up([plain])
    since = store_run(data, "SN-2", [metric(0.5)]).id
    assert outbox.collect() == 1
    unread = store_run(data, "SN-3", [metric(0.5)]).id
    outbox.set_up([plain, every])
    outbox.set_up([plain, every, Client(name="third", user="c", from_first=True)])
    assert outbox.collect() == 1
    for name, owed in (("plain", [since, unread]), ("every", [*early, since, unread])):
        assert [one.meta.run for one in outbox.owed(name, 9)] == owed
    assert outbox.owed("third", 9) == outbox.owed("every", 9)
    newest = outbox.latest()
    assert newest is not None
    assert newest.meta.run == unread
    assert [one.meta.run for one in outbox.after(BEFORE_ALL, 9)] == [*early, since, unread]
    database.close()


def test_of_clients_that_are_known_from_the_first_start_those_alone_get_all_that_ask_for_it(tmp_path: Path) -> None:
    data = tmp_path / "data"
    early = store_run(data, "SN-0", [metric(0.5)]).id
    database = StationDatabase(data)
    outbox = Outbox(database, data)
    outbox.set_up([Client(name="plain", user="a"), Client(name="every", user="b", from_first=True)])
    outbox.collect()
    assert outbox.owed("plain", 9) == []
    assert [one.meta.run for one in outbox.owed("every", 9)] == [early]
    database.close()


def test_a_record_that_was_altered_after_it_was_collected_is_told_as_altered(tmp_path: Path) -> None:
    data = tmp_path / "data"
    run = store_run(data, "SN-0", [metric(0.5)])
    database = StationDatabase(data)
    outbox = Outbox(database, data)
    outbox.set_up([Client(name="every", user="b", from_first=True)])
    outbox.collect()
    (kept,) = outbox.owed("every", 9)
    assert outbox.as_now(kept) == kept
    before = (run.folder / "result.json").read_bytes()
    (run.folder / "result.json").write_bytes(before + b" ")
    now = outbox.as_now(kept).meta
    assert "result.json: was changed" in now.altered[0]
    (run.folder / "result.json").write_bytes(before)
    assert outbox.as_now(kept) == kept
    shutil.move(run.folder, tmp_path / "away")
    assert outbox.as_now(kept).meta.altered, "it is gone, and no line says why"
    with writing_to(data) as chain:
        chain.append(REMOVED, run=run.id, serial="SN-0", sha256=kept.meta.sha256, rule="r", person="p", trace="")
    assert outbox.as_now(kept) == kept
    assert outbox.content(kept.meta) is None
    database.close()


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("endpoint: opc.tcp://127.0.0.1/", "an address such as opc.tcp://127.0.0.1:4840/"),
        ("endpoint: http://127.0.0.1:4840/", "an address such as"),
        ("policies: [None]", "Basic256Sha256"),
        ("clients: [{name: a, user: x}, {name: a, user: y}]", "a different name"),
        ("clients: [{name: a, user: x, certificate: y}]", "exactly one of user and certificate"),
        ("anonymus: true", "anonymous"),
    ],
)
def test_settings_that_cannot_be_used_are_refused_in_plain_words(tmp_path: Path, text: str, found: str) -> None:
    (tmp_path / "opcua.yaml").write_text(f"machine: {{manufacturer: a, model: b, serial_number: c}}\n{text}\n")
    with pytest.raises(RecipeError) as refused:
        load_opcua(tmp_path)
    assert found in str(refused.value)


def test_a_certificate_that_clients_would_refuse_is_refused_at_the_start(tmp_path: Path) -> None:
    plant = Plant(tmp_path / "data")
    plant.set_up()
    settings = load_opcua(plant.data)
    assert checked_certificate(plant.data, settings)[1].startswith("urn:")
    with pytest.raises(StationError, match="the server has a certificate already"):
        make_certificate(plant.data, settings, ())
    elsewhere = settings.model_copy(update={"endpoint": "opc.tcp://bench-7.plant.example:4840/"})
    with pytest.raises(StationError, match="not for bench-7"):
        checked_certificate(plant.data, elsewhere)
    expired, key = write_pair(tmp_path, "expired", days=-1)
    old = settings.model_copy(update={"certificate": str(expired), "key": str(key)})
    with pytest.raises(StationError, match="expired on"):
        checked_certificate(plant.data, old)
    other = settings.model_copy(update={"key": str(key)})
    key.chmod(0o644)
    with pytest.raises(StationError, match="chmod 600"):
        checked_certificate(plant.data, other)
    key.chmod(0o600)
    with pytest.raises(StationError, match="does not belong to the certificate"):
        checked_certificate(plant.data, other)


def test_the_commands_say_what_is_missing_and_what_is_in_the_way(tmp_path: Path) -> None:
    data = tmp_path / "data"
    words = ("--data", str(data))
    data.mkdir()
    missing = here("opcua", "serve", *words)
    assert (missing.exit_code, "manufacturer: Example GmbH" in missing.err) == (2, True)
    plant = Plant(data)
    plant.set_up()
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", plant.port))
        taken.listen()
        refused = here("opcua", "serve", *words)
    assert (refused.exit_code, "uses this port" in refused.err) == (2, True)
    (data / "opcua.yaml").write_text(SETTINGS.format(port=plant.port).replace("the mes", "nobody"))
    unknown = here("opcua", "serve", *words)
    assert (unknown.exit_code, "there is no account 'nobody'" in unknown.err) == (2, True)
    with _held(data):
        held = here("opcua", "serve", *words)
    assert "another 'lostmotion opcua serve'" in held.err
    trusted = here("opcua", "trust", str(tmp_path / "client.pem"), *words)
    assert (trusted.exit_code, "CN=client" in trusted.out) == (0, True)
    assert here("opcua", "trust", str(data / "opcua.yaml"), *words).exit_code == 2
    assert "no clients" in here("opcua", "clients", *words).out
    assert here("opcua", "clients", "--json", *words).out.strip() == "[]"
    assert "Known clients: none" in here("opcua", "forget", "mes", *words).err
    unit = here("opcua", "serve", "--install-unit", str(tmp_path), *words)
    assert "systemctl enable --now lostmotion-opcua.service" in unit.out
    assert f"opcua serve --data {data}" in (tmp_path / "lostmotion-opcua.service").read_text()
