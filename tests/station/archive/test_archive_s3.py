"""The archive over the S3 protocol, against moto's server on loopback."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import boto3
import pytest
from moto.server import ThreadedMotoServer
from stored_runs import metric, store_run

from station.archive.ask import ask
from station.archive.check import verify_archive
from station.archive.fetch import fetch
from station.archive.place import Place
from station.archive.push import push
from station.archive.settings import ArchiveError, ArchiveSettings, load_settings
from station.records.archive_note import read_note
from station.records.data_folder import Store

KEY, SECRET = "LOSTMOTION_TEST_KEY", "LOSTMOTION_TEST_SECRET"


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@pytest.fixture(autouse=True)
def bucket(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv(KEY, "test")
    monkeypatch.setenv(SECRET, "test")
    named = {"region_name": "us-east-1", "aws_access_key_id": "test", "aws_secret_access_key": "test"}
    found = boto3.resource("s3", endpoint_url=endpoint, **named).Bucket("plant")
    found.create()
    return found


def settings_text(endpoint: str) -> str:
    return f"url: s3://plant/eol\nendpoint: {endpoint}\nkey_from: {KEY}\nsecret_from: {SECRET}\n"


def test_a_bucket_takes_runs_gives_them_back_and_answers(
    golden_run: Any, endpoint: str, bucket: Any, tmp_path: Path
) -> None:
    data = golden_run.copy(tmp_path / "runs").parent
    store_run(data, "U1", [metric(0.4)])
    (data / "archive.yaml").write_text(settings_text(endpoint), encoding="utf-8")
    place = Place(load_settings(data))
    with pytest.raises(ArchiveError, match="has no runs yet"):
        ask(place, "SELECT * FROM runs", 9)
    assert push(data, place).runs == 2
    keys = [one.key for one in bucket.objects.all() if not one.key.endswith("/")]
    assert sorted(key.split("/")[1] for key in keys) == ["archive-id.json", "full", "full", "trace"]
    assert not [key for key in keys if "incoming" in key]
    assert not verify_archive(data, place).problems
    assert ask(place, "SELECT serial FROM runs ORDER BY 1", 9).rows == (("R",), ("U1",))
    assert ask(place, "SELECT count(*) > 1000 FROM traces", 9).rows == ((True,),)
    with pytest.raises(ArchiveError, match="runs, metrics"):
        ask(place, "SELECT * FROM read_csv('/etc/passwd')", 9)
    run = next(run.folder for run in Store(data).runs() if run.serial() == "R")
    before = {one.name: one.read_bytes() for one in run.iterdir() if one.is_file() and one.name != ".owner"}
    shutil.rmtree(run)
    fetch(data, place, run.name)
    assert {one.name: one.read_bytes() for one in run.iterdir() if one.is_file()} == before
    name = read_note(data).runs[run.name].line.full.name
    bad = bytearray(bucket.Object(f"eol/{name}").get()["Body"].read())
    bad[len(bad) // 2] ^= 1
    bucket.put_object(Key=f"eol/{name}", Body=bytes(bad))
    assert [one.kind for one in verify_archive(data, place).problems] == ["changed"]


def test_an_archive_that_is_not_there_is_told_and_nothing_is_noted(
    golden_run: Any, endpoint: str, tmp_path: Path
) -> None:
    data = golden_run.copy(tmp_path / "runs").parent
    named = {"key_from": KEY, "secret_from": SECRET}
    for url, there in (("s3://plant/eol", "http://127.0.0.1:9"), ("s3://nobodys/eol", endpoint)):
        place = Place(ArchiveSettings(url=url, endpoint=there, **named))
        with pytest.raises(ArchiveError, match=r"Check (network, address and credentials|the url in archive.yaml)"):
            push(data, place)
    assert not read_note(data).runs


def test_a_bucket_that_is_not_the_one_before_is_refused(
    golden_run: Any, endpoint: str, bucket: Any, tmp_path: Path
) -> None:
    data = golden_run.copy(tmp_path / "runs").parent
    (data / "archive.yaml").write_text(settings_text(endpoint).replace("/eol", "/second"), encoding="utf-8")
    place = Place(load_settings(data))
    assert push(data, place).runs == 1
    assert push(data, place).runs == 0
    marker = bucket.Object("second/archive-id.json").get()["Body"].read()
    assert marker == (data / "archive-id.json").read_bytes()
    bucket.Object("second/archive-id.json").delete()
    with pytest.raises(ArchiveError, match=r"it has no archive-id.json; expected is the id [0-9a-f]{32}"):
        push(data, place)
    (data / "archive.yaml").write_text(settings_text(endpoint).replace("/eol", "/third"), encoding="utf-8")
    third = Place(load_settings(data))
    with pytest.raises(ArchiveError, match="is not the archive of"):
        push(data, third)
    assert push(data, third, new=True).runs == 1
    assert not verify_archive(data, third).problems
