"""A recipe from its draft to the unit that is measured by it, over REST: who may what, what is told and audited."""

from __future__ import annotations

import json
import time
from typing import Any

import pytest
from station_support import GOLDEN, Client, client_of

from station.web.languages import ENGLISH, words_of
from station.web.pages.recipes.dry_run_html import dry_run_html
from station.web.people import audit
from station.web.recipe_text.dry_run import TRIED
from station.web.station import Station

BAD_OPTION = "peak_torqe"


def golden(revision: int, *changed: tuple[str, str]) -> str:
    text = GOLDEN.read_text(encoding="utf-8").replace("name: golden", "name: good")
    for before, now in (("revision: 1", f"revision: {revision}"), *changed):
        assert before in text
        text = text.replace(before, now, 1)
    return text


def saved(client: Client, text: str, replaces: str = "") -> dict[str, Any]:
    answer = client.post("save_recipe", {"text": text, "replaces": replaces})
    assert answer.status_code == 200, answer.text
    found = answer.json()
    return {name: found[name] for name in ("name", "revision", "sha256")}


def refused(answer: Any, status: int, *ids: str) -> str:
    assert answer.status_code == status, answer.text
    assert [one["id"] for one in answer.json()["refused"]] == list(ids)
    return str(answer.json()["refused"][0]["text"])


@pytest.mark.parametrize("sign", ["\u2028", "\x85", "\r", "\u202e", "\u200b"])
def test_a_text_that_looks_other_than_it_is_read_is_not_saved(station: Station, sign: str) -> None:
    engineer = client_of(station, "engineer")
    text = golden(2) + f"\n# the limits were{sign}wider\n"
    answer = engineer.post("save_recipe", {"text": text, "replaces": ""})
    said = refused(answer, 422, "recipe")
    assert f":{text.count(chr(10))}:18: found the character U+{ord(sign):04X}" in said
    listed = engineer.http.get("/api/recipes").json()["revisions"]
    assert [one["revision"] for one in listed if one["name"] == "good"] == [1]


def test_a_second_person_releases_and_the_next_unit_is_measured_by_it(
    station: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[list[str]] = []
    monkeypatch.setattr(station.running, "start", lambda options, _serial: runs.append(options))
    technician, engineer, quality = (client_of(station, role) for role in ("technician", "engineer", "quality"))
    draft = saved(engineer, golden(2))
    refused(technician.post("release_recipe", draft), 403, "role")
    refused(quality.post("release_recipe", draft), 409, "recipe")
    assert engineer.post("ask_release", draft).json()["state"] == "release asked"
    back = draft | {"reason": "the limit is too wide"}
    refused(technician.post("send_recipe_back", back), 403, "role")
    for none in ("  ", "wide\nrv-40e-121-quick r9 released", "wide\x1b[31m", "wide\u202e"):
        assert quality.post("send_recipe_back", draft | {"reason": none}).status_code == 422, "one line of words"
    assert quality.post("send_recipe_back", back).json()["state"] == "draft"
    listed = engineer.http.get("/api/recipes").json()["revisions"]
    sent = next(one for one in listed if (one["name"], one["revision"]) == ("good", 2))
    assert (sent["sent_back_by"], sent["reason"]) == ("the quality", "the limit is too wide")
    refused(quality.post("release_recipe", draft), 409, "recipe")
    assert engineer.post("ask_release", draft).json()["state"] == "release asked"
    assert "Another person" in refused(engineer.post("release_recipe", draft), 409, "recipe")
    assert quality.post("release_recipe", draft).json()["state"] == "released"
    refused(technician.post("save_recipe", {"text": golden(2, ("count: 1", "count: 2"))}), 409, "recipe")

    with station.database.reading() as connection:
        lines = audit.lines_of(connection, 20)
        assert audit.problems_of(connection) == []
    done = {one.action: (one.name, json.loads(one.detail)) for one in lines if one.outcome == "done"}
    held = {"state": "draft", "sha256": draft["sha256"]}
    saved_text = {"text_sha256": draft["sha256"], "before": {}, "after": held}
    changed = {"before": held | {"state": "release asked"}, "after": held | {"state": "released"}}
    assert done["save_recipe"] == ("the engineer", draft | saved_text)
    assert done["release_recipe"] == ("the quality", draft | changed)
    assert [one.outcome for one in lines if one.action == "release_recipe"].count("refused") == 4

    (station.data / "models.yaml").write_text("models: [{model: P1, serial: 'SN-[0-9]+', recipe: good}]\n")
    listed = engineer.http.get("/api/recipes").json()["revisions"]
    newest = next(one for one in listed if one["name"] == "good")
    assert (newest["revision"], newest["released_by"]) == (2, "the quality")
    file = engineer.http.get("/api/recipes/good/2.yaml")
    assert file.text == golden(2)
    assert "good-r2.yaml" in file.headers["content-disposition"]
    assert engineer.http.get("/api/recipes/good/9.yaml").status_code == 404


def test_what_is_in_order_by_its_form_alone_can_be_saved_and_not_released(station: Station) -> None:
    engineer, quality = client_of(station, "engineer"), client_of(station, "quality")
    draft = saved(engineer, golden(3, ("peak_torque", BAD_OPTION)))
    told = engineer.http.get("/api/recipes/good/3/check").json()
    assert not told["fit"]
    assert told["load_profile"] == []
    (message,) = [one for one in told["messages"] if BAD_OPTION in one["text"]]
    assert golden(3, ("peak_torque", BAD_OPTION)).splitlines()[message["line"] - 1].find(BAD_OPTION) >= 0
    assert BAD_OPTION in refused(engineer.post("ask_release", draft), 422, "recipe")
    again = saved(engineer, golden(3), draft["sha256"])
    told = engineer.http.get("/api/recipes/good/3/check").json()
    assert told["fit"]
    assert max(one["torque_nm"] for one in told["load_profile"]) == told["peak_torque_nm"]
    assert engineer.post("ask_release", again).status_code == 200
    assert quality.post("release_recipe", again).status_code == 200


@pytest.mark.parametrize("text", ["", "x", "recipe: [", "recipe: {name: ../up, revision: 1}", "x" * 200_000])
def test_what_is_no_recipe_is_not_saved(shared_station: Station, text: str) -> None:
    assert client_of(shared_station, "engineer").post("save_recipe", {"text": text}).status_code == 422


def test_a_dry_run_measures_a_unit_of_the_catalogue_and_leaves_no_run(station: Station) -> None:
    engineer = client_of(station, "engineer")
    assert engineer.http.get("/api/dry-run").json()["stage"] == "idle"
    refused(engineer.post("try_recipe", {"text": golden(2, ("peak_torque", BAD_OPTION))}), 422, "recipe")
    assert engineer.post("try_recipe", {"text": golden(2)}).status_code == 200
    refused(engineer.post("try_recipe", {"text": golden(2)}), 409, "station")
    until = time.monotonic() + 120.0
    while (now := engineer.http.get("/api/dry-run").json())["stage"] == "running":
        assert time.monotonic() < until, now
        time.sleep(0.2)
    assert now["stage"] == "ended", now
    assert (now["result"]["state"], now["result"]["unit"]["virtual"]) == ("complete", "catalogue")
    assert not list(station.data.glob("*/run.json"))
    shown = dry_run_html(station.dry_runs.now(), TRIED, words_of(ENGLISH))
    assert 'id="trial-unit"' in shown, "what a PASS of it proves stands beside it"
