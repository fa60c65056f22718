"""The life of a recipe's revision: another person releases it, and then it stays, whatever is done to its files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lostmotion_command import ROOT, here

from recipes import RecipeError, shipped_recipes
from station.errors import RecordError
from station.own_place import PLACE
from station.records.chain.entries import RECIPE_ASKED, RECIPE_RELEASED, RECIPE_SAVED, RECIPE_SENT_BACK
from station.records.revisions.history import HISTORY, KINDS, History
from station.records.revisions.revision import Event, Revision, RevisionError, State, after
from station.records.revisions.writing import ask_release, release, save_draft, send_back

GOLDEN = ROOT / "tests" / "proofs" / "golden" / "golden.yaml"
NAME = "rv-40e-121-quick"
PEOPLE = ("Ada", "Bea", "Cy")
EVENTS = st.lists(
    st.tuples(st.sampled_from(KINDS), st.sampled_from("ab"), st.sampled_from(PEOPLE)),
    max_size=14,
)  # fmt: skip


def text(revision: int, more: str = "") -> bytes:
    shipped = shipped_recipes()[NAME].read_bytes()
    return shipped.replace(b"revision: 2", f"revision: {revision}".encode()) + more.encode()


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(PLACE, str(tmp_path / "place"))
    return tmp_path / "runs"


def released(data: Path, content: bytes) -> Revision:
    draft = save_draft(data, content, "Ada")
    ask_release(data, draft.name, draft.revision, draft.sha256, "Ada")
    return release(data, draft.name, draft.revision, draft.sha256, "Bea")


@given(EVENTS)
def test_whatever_people_try_what_is_released_never_changes_and_nobody_releases_their_own(
    tried: list[tuple[str, str, str]],
) -> None:
    now: Revision | None = None
    wrote: set[str] = set()
    asked = False
    for kind, sha256, person in tried:
        before = now
        try:
            now = after(before, Event(kind, NAME, 3, sha256, person, "t"), Path())
        except RevisionError:
            continue
        assert before is None or before.state is not State.RELEASED, "nothing is done to a released revision"
        wrote |= {person} if kind == RECIPE_SAVED else set()
        asked = (asked and kind not in {RECIPE_SAVED, RECIPE_SENT_BACK}) or kind == RECIPE_ASKED
        assert bool(now.sent_back_by) == (kind == RECIPE_SENT_BACK)
        assert set(now.authors) == wrote
        if now.state is State.RELEASED:
            assert kind == RECIPE_RELEASED
            assert person not in wrote, "a second person"
            assert asked, "somebody has asked for the release of this very text"
            assert sha256 == before.sha256
    if now is not None and now.state is State.RELEASED:
        for kind in KINDS:
            for sha256 in (now.sha256, "another"):
                with pytest.raises(RevisionError):
                    after(now, Event(kind, NAME, 3, sha256, "Cy", "t"), Path())


def test_a_revision_goes_from_its_author_to_its_release_and_is_what_the_name_means(data: Path) -> None:
    assert History(data).newest_released(NAME).shipped
    draft = save_draft(data, text(3), "Ada")
    assert (draft.state, draft.authors) == (State.DRAFT, ("Ada",))
    assert History(data).newest_released(NAME).revision == 2, "a draft measures nothing"
    with pytest.raises(RevisionError, match="has to ask"):
        release(data, NAME, 3, draft.sha256, "Bea")
    ask_release(data, NAME, 3, draft.sha256, "Ada")
    with pytest.raises(RevisionError, match="Another person"):
        release(data, NAME, 3, draft.sha256, "Ada")
    found = release(data, NAME, 3, draft.sha256, "Bea")
    history = History(data)
    assert history.newest_released(NAME) == found == history.released_with(draft.sha256)
    assert found.text() == text(3)
    assert [event.person for event in history.events(NAME)] == ["Ada", "Ada", "Bea"]
    assert history.problems == history.text_problems() == []
    assert here("verify", "--data", str(data)).exit_code == 0


def test_what_is_sent_back_is_a_draft_with_a_reason_until_its_authors_ask_again(data: Path) -> None:
    draft = save_draft(data, text(3), "Ada")
    with pytest.raises(RevisionError, match="has to ask"):
        send_back(data, NAME, 3, draft.sha256, "Bea", "the limit is too wide")
    ask_release(data, NAME, 3, draft.sha256, "Ada")
    with pytest.raises(RevisionError, match="changed"):
        send_back(data, NAME, 3, "0" * 64, "Bea", "the limit is too wide")
    sent = send_back(data, NAME, 3, draft.sha256, "Bea", "the limit is too wide")
    assert sent == History(data).find(NAME, 3)
    assert (sent.state, sent.sent_back_by, sent.reason) == (State.DRAFT, "Bea", "the limit is too wide")
    with pytest.raises(RevisionError, match="has to ask"):
        release(data, NAME, 3, draft.sha256, "Bea")
    ask_release(data, NAME, 3, draft.sha256, "Ada")
    assert release(data, NAME, 3, draft.sha256, "Bea").reason == ""
    history = History(data)
    assert [event.reason for event in history.events(NAME)] == ["", "", "the limit is too wide", "", ""]
    assert history.problems == []
    assert here("verify", "--data", str(data)).exit_code == 0


def test_another_text_is_refused_under_a_revision_that_is_released_and_below_it(data: Path) -> None:
    released(data, text(4))
    for wrong in (text(2, "# other\n"), text(4, "# other\n"), text(3)):
        with pytest.raises(RevisionError):
            save_draft(data, wrong, "Cy")
    assert save_draft(data, text(5), "Cy").state is State.DRAFT
    assert History(data).next_revision(NAME) == 5


def test_whoever_has_changed_a_draft_cannot_release_it_either_and_a_release_is_of_what_was_read(data: Path) -> None:
    first = save_draft(data, text(3), "Ada")
    with pytest.raises(RevisionError, match="was saved by"):
        save_draft(data, text(3, "# more\n"), "Bea")
    second = save_draft(data, text(3, "# more\n"), "Bea", replaces=first.sha256)
    assert second.authors == ("Ada", "Bea")
    with pytest.raises(RevisionError, match="changed by somebody else"):
        ask_release(data, NAME, 3, first.sha256, "Ada")
    ask_release(data, NAME, 3, second.sha256, "Ada")
    for author in second.authors:
        with pytest.raises(RevisionError, match="Another person"):
            release(data, NAME, 3, second.sha256, author)
    third = save_draft(data, text(3, "# again\n"), "Ada", replaces=second.sha256)
    assert third.state is State.DRAFT, "who changes it has to ask anew"
    assert first.text() == text(3), "every text that was saved is kept"


def test_saving_the_same_twice_is_one_event(data: Path) -> None:
    first = save_draft(data, text(3), "Ada")
    ask_release(data, NAME, 3, first.sha256, "Ada")
    assert save_draft(data, text(3), "Ada").state is State.ASKED
    assert len(History(data).events(NAME)) == 2


@pytest.mark.parametrize(
    "wrong",
    [b"", b"recipe: [", b"x: 1", b"recipe: {name: ../up, revision: 1}", b"recipe: {name: a/b, revision: 1}",
     b"recipe: {name: a, revision: '1'}", b"recipe: {name: a, revision: 0}", b"recipe: {name: a}", b"recipe: 5"],
)  # fmt: skip
def test_a_text_that_does_not_say_what_it_is_is_no_draft(data: Path, wrong: bytes) -> None:
    with pytest.raises(RecipeError):
        save_draft(data, wrong, "Ada")
    assert not list(data.glob("recipes/**/*.yaml"))


def lines(data: Path) -> list[bytes]:
    return (data / HISTORY).read_bytes().splitlines(keepends=True)


@pytest.mark.parametrize("how", ["forged", "removed", "other text", "text gone", "other key"])
def test_no_change_of_the_files_makes_a_release(
    data: Path, how: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    kept = released(data, text(3))
    draft = save_draft(data, text(4), "Ada")
    ask_release(data, NAME, 4, draft.sha256, "Ada")
    if how == "forged":
        last = json.loads(lines(data)[-1]) | {"kind": "recipe_released", "person": "Bea"}
        (data / HISTORY).write_bytes(b"".join([*lines(data), json.dumps(last).encode() + b"\n"]))
    elif how == "removed":  # that Ada wrote it
        content = lines(data)
        (data / HISTORY).write_bytes(b"".join([*content[:3], *content[4:]]))
        with pytest.raises(RevisionError):
            release(data, NAME, 4, draft.sha256, "Ada")
    elif how == "other text":
        draft.path.write_bytes(text(4, "# other\n"))
        with pytest.raises(RecordError):
            release(data, NAME, 4, draft.sha256, "Bea")
    elif how == "text gone":
        draft.path.unlink()
        with pytest.raises(RecordError):
            release(data, NAME, 4, draft.sha256, "Bea")
    else:
        (data / HISTORY).unlink()
        (data / "chain.jsonl").unlink(missing_ok=True)
        ran = here("run", str(GOLDEN), "--virtual-time", "--serial", "A", "--no-report", "--data", str(data), "--json")
        assert ran.json["run"], "this computer knows the folder now"
        monkeypatch.setenv(PLACE, str(tmp_path / "another computer"))
        released(data, text(4))
        monkeypatch.setenv(PLACE, str(tmp_path / "place"))
    found = History(data)
    assert [one.revision for one in found.own.values() if one.state is State.RELEASED] == (
        [] if how == "other key" else [kept.revision]
    )
    ran = here("verify", "--data", str(data), "--json")
    assert ran.exit_code == 1
    assert "recipes" in {one["kind"] for one in ran.json["problems"]}


def test_a_line_that_a_power_failure_has_torn_is_no_line_and_no_harm(data: Path) -> None:
    released(data, text(3))
    with (data / HISTORY).open("ab") as file:
        file.write(b'{"kind":"recipe_sa')
    assert History(data).newest_released(NAME).revision == 3
    assert released(data, text(4)).revision == 4
    assert History(data).problems == []
