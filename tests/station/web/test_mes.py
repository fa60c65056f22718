"""The MES beside the station: its word on a unit, and the webhooks that it gets in spite of cut cables and kills."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from types import ModuleType
from typing import Any

import httpx
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from lostmotion_command import ROOT, here
from served import prepared, served
from sqlalchemy import select, update
from station_samples import SETUP
from station_support import client_of

from recipes import RecipeError
from station.documents.manifest import StudyPlace
from station.errors import StationError
from station.records.chain.chain_file import CHAIN
from station.records.chain.entries import SEALED, signed_entry
from station.records.chain.keys import BenchKey
from station.records.data_folder import Store, check_note
from station.records.seal import seal
from station.web.mes import outbox
from station.web.mes.outbox import Sender, collect, signature
from station.web.mes.previous_step import PreviousStep
from station.web.mes.settings import FILE, MesSettings, load_mes, read_secret
from station.web.people.database import MES_CONTACT, WEBHOOKS
from station.web.permission import Wanted, refusals, situation_of, unverified_note
from station.web.station import Station

EXAMPLE = ROOT / "docs" / "example_mes.py"
SECRET = b"a secret of a test"


def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("example_mes", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def settings(url: str = "http://127.0.0.1:9/", when_away: str = "hold") -> MesSettings:
    return MesSettings(url=url, secret_file="mes.secret", when_away=when_away)  # noqa: S106 - a path


def write_secret(data: Path, secret: bytes = SECRET) -> None:
    (data / "mes.secret").write_bytes(secret + b"\n")
    (data / "mes.secret").chmod(0o600)


@pytest.fixture
def plant(station: Station) -> Station:
    write_secret(station.data)
    return dataclasses.replace(station, mes=settings())


@contextmanager
def listening(keep: Path, port: int = 0) -> Iterator[Any]:
    mes = example()
    server = mes.server(SECRET, mes.Results(keep), port)
    thread = Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def kept(file: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


KEY = BenchKey(Ed25519PrivateKey.generate())


def entry(run: str, serial: str, number: int) -> bytes:
    words = {"run": run, "serial": serial, "attempt": 1, "created": 1, "sha256": f"{number:064x}"}
    words |= {"state": "complete", "verdict": "PASS"}
    line = signed_entry(SEALED, number, "0" * 64, "2026-01-05T08:00:00+00:00", KEY, **words).line
    return line + b"\n"


@pytest.mark.parametrize(
    ("step", "refused", "unverified"),
    [
        (PreviousStep("passed", away=True, silent_s=None, may_be_unverified=False), False, False),
        (PreviousStep("passed", away=False, silent_s=1.0, may_be_unverified=True), False, False),
        (PreviousStep("failed", away=True, silent_s=90.0, may_be_unverified=True), True, False),
        (PreviousStep("failed", away=False, silent_s=1.0, may_be_unverified=True), True, False),
        (PreviousStep("", away=False, silent_s=1.0, may_be_unverified=True), True, False),
        (PreviousStep("", away=True, silent_s=90.0, may_be_unverified=False), True, False),
        (PreviousStep("", away=True, silent_s=90.0, may_be_unverified=True), False, True),
        (PreviousStep("", away=True, silent_s=None, may_be_unverified=True), False, True),
    ],
)
def test_a_unit_is_measured_on_the_word_of_the_mes_or_by_the_plants_choice_without_it(
    station: Station, step: PreviousStep, *, refused: bool, unverified: bool
) -> None:
    found = situation_of(
        station.data, station.models, Wanted("SN-1"), busy=False, confirmed=frozenset(), previous_step=step
    )
    assert [name for name, _ in refusals(found)] == ["previous_step_passed"] * refused
    note = unverified_note(found)
    assert (note is not None) == unverified
    assert note is None or check_note(note) == note


def test_the_mes_announces_asks_and_starts(plant: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[list[str]] = []
    monkeypatch.setattr(plant.running, "start", lambda options, *_: runs.append(options))
    mes, operator = client_of(plant, "mes"), client_of(plant, "operator")
    asked = operator.post("ask_permission", {"scanned": "SN-1"}).json()
    assert (asked["allowed"], [one["id"] for one in asked["reasons"]]) == (False, ["previous_step_passed"])
    assert "never heard" in asked["reasons"][0]["text"]
    assert operator.post("announce_unit", {"serial": "SN-1", "previous_step": "passed"}).status_code == 403
    assert mes.post("announce_unit", {"serial": "SN-1", "previous_step": "perhaps"}).status_code == 422
    assert mes.post("announce_unit", {"serial": "SN-1", "previous_step": "failed"}).status_code == 200
    assert operator.post("start_run", {"scanned": "SN-1"}).json()["refused"][0]["id"] == "previous_step_passed"
    assert mes.post("announce_unit", {"serial": "SN-1", "previous_step": "passed"}).status_code == 200
    assert mes.post("ask_permission", {"scanned": "SN-1"}).json()["allowed"] is True
    assert runs == [], "to ask starts nothing"
    assert operator.post("start_run", {"scanned": "SN-1"}).status_code == 200
    assert "--note" not in runs[0]
    assert mes.post("start_run", {"scanned": "SN-2"}).status_code == 409, "it was not announced"


def test_a_unit_that_is_measured_while_the_mes_is_away_says_so(plant: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[list[str]] = []
    monkeypatch.setattr(plant.running, "start", lambda options, *_: runs.append(options))
    lenient = dataclasses.replace(plant, mes=settings(when_away="unverified"))
    assert client_of(lenient, "operator").post("start_run", {"scanned": "SN-1"}).status_code == 200
    (note,) = [runs[0][at + 1] for at, word in enumerate(runs[0]) if word == "--note"]
    assert note.startswith("unverified")
    client_of(lenient, "mes").post("announce_unit", {"serial": "SN-9", "previous_step": "passed"})
    assert client_of(lenient, "operator").post("start_run", {"scanned": "SN-2"}).status_code == 409, "it is there again"
    with lenient.database.writing() as connection:
        connection.execute(update(MES_CONTACT).values(heard_s=MES_CONTACT.c.heard_s - 61.0))
    assert client_of(lenient, "operator").post("start_run", {"scanned": "SN-2"}).status_code == 200


def test_messages_come_once_and_in_order_of_a_serial_though_the_mes_refuses_and_answers_are_lost(
    plant: Station, tmp_path: Path
) -> None:
    chain, keep = plant.data / CHAIN, tmp_path / "results.jsonl"
    chain.write_bytes(entry("OLD", "SN-1", 1))
    sender = Sender(plant.database, plant.data, plant.mes)
    with chain.open("ab") as file:
        file.write(entry("A", "SN-1", 2) + entry("B", "SN-1", 3) + entry("C", "SN-2", 4)[:-9])
    assert collect(plant.database, plant.data) == 2, "what was sealed before the MES, and half a line, are not told"
    assert collect(plant.database, plant.data) == 0
    calls: list[str] = []
    answers = iter([httpx.Response(500), httpx.ConnectError("cut")])

    def refuse(request: httpx.Request) -> httpx.Response:
        calls.append(request.headers["Idempotency-Key"])
        found = next(answers)
        if isinstance(found, Exception):
            raise found
        return found

    cut = httpx.Client(transport=httpx.MockTransport(refuse))
    sender.look(cut)
    assert [one.split(":")[1] for one in calls] == ["A"], "B waits for A"
    due_now(plant)
    sender.look(cut)
    assert [one.split(":")[1] for one in calls] == ["A", "A"]
    left = client_of(plant, "operator").http.get("/api/now").json()["webhooks"]
    assert left["waiting"] == 2
    assert "cut" in left["last_error"]
    with listening(keep) as server, httpx.Client() as http:
        there = dataclasses.replace(plant, mes=settings(f"http://127.0.0.1:{server.server_port}/"))
        again = Sender(there.database, there.data, there.mes)
        for _ in range(3):
            due_now(plant)
            again.look(http)
        lost_answer(plant, "A")
        again.look(http)
    assert [one["message"]["run"] for one in kept(keep)] == ["A", "B"]
    message = kept(keep)[0]["message"]
    assert (message["serial"], message["verdict"], message["result"]) == ("SN-1", "PASS", None)
    assert message["altered"], "there is no such folder, and that is told in place of its result"
    assert (message["not_a_product"], kept(keep)[0]["may_ship"]) == (None, False)
    assert len(message["audit"]["head_sha256"]) == 64
    assert client_of(plant, "operator").http.get("/api/now").json()["webhooks"] == {"waiting": 0, "last_error": ""}


def due_now(station: Station) -> None:
    with station.database.writing() as connection:
        connection.execute(update(WEBHOOKS).values(next_s=0.0))


def lost_answer(station: Station, run: str) -> None:
    with station.database.writing() as connection:
        connection.execute(update(WEBHOOKS).where(WEBHOOKS.c.key.contains(f":{run}:")).values(delivered_at=None))


def test_the_wait_grows_to_a_minute(plant: Station) -> None:
    sender = Sender(plant.database, plant.data, plant.mes)
    (plant.data / CHAIN).write_bytes(entry("A", "SN-1", 1))
    down = httpx.Client(transport=httpx.MockTransport(lambda _request: httpx.Response(503)))
    waits = []
    for _ in range(9):
        due_now(plant)
        sender.look(down)
        with plant.database.reading() as connection:
            waits.append(connection.execute(select(WEBHOOKS.c.next_s)).scalar_one() - time.time())
    assert waits == pytest.approx([1, 2, 4, 8, 16, 32, 60, 60, 60], abs=0.9)


@pytest.mark.parametrize(("wait_s", "tries"), [(30.0, 0), (59.0, 0), (-1.0, 1), (3600.0, 1), (86400.0, 1)])
def test_a_clock_that_was_set_back_holds_no_message_up(plant: Station, wait_s: float, tries: int) -> None:
    begun = Sender(plant.database, plant.data, settings())
    (plant.data / CHAIN).write_bytes(entry("R1", "SN-1", 1))
    assert collect(plant.database, plant.data) == 1
    with plant.database.writing() as connection:
        connection.execute(update(WEBHOOKS).values(next_s=time.time() + wait_s))
    with httpx.Client() as http:
        begun.look(http)
    with plant.database.reading() as connection:
        assert connection.execute(select(WEBHOOKS.c.tries)).scalar_one() == tries


def test_a_chain_that_became_shorter_is_said_and_nothing_is_told(plant: Station) -> None:
    (plant.data / CHAIN).write_bytes(entry("A", "SN-1", 1))
    Sender(plant.database, plant.data, plant.mes)
    (plant.data / CHAIN).write_bytes(b"")
    with pytest.raises(StationError, match="shorter"):
        collect(plant.database, plant.data)


def test_the_example_takes_only_what_is_signed_and_new(tmp_path: Path) -> None:
    body = json.dumps({"kind": "result"}).encode()
    now = str(int(time.time()))
    good = {outbox.TIMESTAMP: now, outbox.SIGNATURE: signature(SECRET, now, body), outbox.KEY: "k"}
    old = str(int(time.time()) - 3600)
    wrong = (
        {outbox.SIGNATURE: signature(b"another", now, body)},
        {outbox.TIMESTAMP: str(int(now) + 1)},
        {outbox.TIMESTAMP: old, outbox.SIGNATURE: signature(SECRET, old, body)},
        {outbox.KEY: ""},
    )
    keep = tmp_path / "results.jsonl"
    keep.write_bytes(b'{"key": "half')
    with listening(keep) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.server_port}") as http:
        for one in wrong:
            assert http.post("/", content=body, headers=good | one).status_code == 401
        assert http.post("/", content=body + b" ", headers=good).status_code == 401
        assert [http.post("/", content=body, headers=good).status_code for _ in range(2)] == [204, 204]
    assert [one["key"] for one in kept(keep)] == ["k"]


@pytest.mark.parametrize(
    "text",
    [
        "url: ftp://x/",
        "url: http://user:word@x/",
        "url: http://mes:port/x",
        "url: http://a..b/x",
        "when_away: perhaps",
        "away_after_s: 0",
        "wenn_away: hold",
    ],
)
def test_wrong_settings_are_refused_with_their_place(tmp_path: Path, text: str) -> None:
    lines = {"url": "http://127.0.0.1:9/", "secret_file": "mes.secret", "when_away": "hold"}
    name, _, value = text.partition(": ")
    whole = "".join(f"{key}: {one}\n" for key, one in (lines | {name: value}).items())
    (tmp_path / FILE).write_text(whole)
    with pytest.raises(RecipeError, match=name):
        load_mes(tmp_path)


def test_a_secret_is_long_and_for_its_owner_alone(tmp_path: Path) -> None:
    with pytest.raises(StationError, match="cannot be read"):
        read_secret(tmp_path, settings())
    write_secret(tmp_path, b"short")
    with pytest.raises(StationError, match="has 5 bytes"):
        read_secret(tmp_path, settings())
    write_secret(tmp_path)
    assert read_secret(tmp_path, settings()) == SECRET
    (tmp_path / "mes.secret").chmod(0o640)
    with pytest.raises(StationError, match="chmod 600"):
        read_secret(tmp_path, settings())


@pytest.mark.wires
@pytest.mark.long
def test_the_cable_of_the_mes_is_cut_in_mid_run_and_the_server_killed(tmp_path: Path) -> None:
    data, keep = prepared(tmp_path / "runs"), tmp_path / "results.jsonl"
    write_secret(data)
    with listening(tmp_path / "unused.jsonl") as server:
        port = server.server_port
    mes = f"url: http://127.0.0.1:{port}/\nsecret_file: mes.secret\nwhen_away: unverified\naway_after_s: 3\n"
    (data / FILE).write_text(mes)
    with served(data) as first:
        with listening(keep, port):
            first.log_in("mes")
            told = first.post("announce_unit", {"serial": "SN-1", "previous_step": "passed"}, "announced")
            assert told.status_code == 200, told.text
            assert first.post("start_run", {"scanned": "SN-1"}, "start").status_code == 200
            first.wait("running")
        ended = first.wait("ended")
        assert ended["verdict"] == "PASS"
        until = time.monotonic() + 30
        while not (left := first.now()["webhooks"])["last_error"]:
            assert time.monotonic() < until, left
            time.sleep(0.1)
        assert left["waiting"] == 1
        first.kill()
    command = [sys.executable, str(EXAMPLE), "--secret-file", str(data / "mes.secret"), "--keep", str(keep)]
    process = subprocess.Popen([*command, "--port", str(port)], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline().startswith("MES ")
        with served(data) as second:
            second.log_in("operator")
            until = time.monotonic() + 90
            while (left := second.now()["webhooks"])["waiting"]:
                assert time.monotonic() < until, left
                time.sleep(0.1)
    finally:
        process.terminate()
        process.wait(timeout=10)
        process.stdout.close()
    (only,) = kept(keep)
    message = only["message"]
    assert (message["run"], message["verdict"], message["altered"]) == (ended["run"], "PASS", [])
    assert message["result"]["run"] == ended["run"]
    assert (message["not_a_product"], only["may_ship"]) == (["simulated"], False), "a PASS of the virtual bench"
    assert not any(note.startswith("unverified") for note in message["result"]["notes"])
    assert len(here("list", "--data", str(data), "--json").json) == 1
    assert here("verify", "--data", str(data)).exit_code == 0


def test_what_is_no_product_says_why(plant: Station) -> None:
    real = dataclasses.replace(SETUP, bench=dataclasses.replace(SETUP.bench, embedded=False), clock="wall")
    unit = dataclasses.replace
    study = StudyPlace(name="gage", plan="0" * 64, step=1, steps=30)
    made = {
        (): real,
        ("simulated",): dataclasses.replace(real, clock="virtual"),
        ("faults_injected",): dataclasses.replace(real, scenario="scenario.yaml"),
        ("master_part",): dataclasses.replace(real, unit=unit(real.unit, master="PASS")),
        ("study",): dataclasses.replace(real, study=study),
        ("simulated", "master_part"): dataclasses.replace(real, unit=unit(real.unit, virtual="P1", master="PASS")),
    }
    outbox.begin_here(plant.database, plant.data)
    for number, setup in enumerate(made.values()):
        seal(Store(plant.data).create(f"SN-{number}", setup, {}), state="complete", verdict="PASS")
    assert collect(plant.database, plant.data) == len(made)
    with plant.database.reading() as connection:
        bodies = connection.execute(select(WEBHOOKS.c.body).order_by(WEBHOOKS.c.number)).scalars()
        messages = [json.loads(body) for body in bodies]
    assert [tuple(one["not_a_product"]) for one in messages] == list(made)
    assert {name for names in made for name in names} == set(outbox.NOT_A_PRODUCT)
    assert not any(example().may_ship(one) for one in messages), "these records lack their recipes"
    assert [example().may_ship(one | {"altered": []}) for one in messages] == [names == () for names in made]


def test_a_sender_that_never_began_is_closed(plant: Station) -> None:
    """As where the port of the server is taken: the reason is told, and not that a thread was never started."""
    Sender(plant.database, plant.data, plant.mes).close()
