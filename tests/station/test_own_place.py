"""Where the service's own place is, and that nobody else may enter it."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from station.errors import StationError
from station.own_place import PLACE, SERVICE, own_folder, own_place

NAMES = (PLACE, "STATE_DIRECTORY", "XDG_STATE_HOME")
ROOT, SOMEBODY = 0, 4242


@pytest.mark.parametrize(
    ("given", "user", "place"),
    [
        ({PLACE: "/a", "STATE_DIRECTORY": "/b", "XDG_STATE_HOME": "/c"}, ROOT, Path("/a")),
        ({"STATE_DIRECTORY": "/b:/other", "XDG_STATE_HOME": "/c"}, SOMEBODY, Path("/b")),
        ({"XDG_STATE_HOME": "/c"}, ROOT, Path("/c/lostmotion")),
        ({}, ROOT, SERVICE),
        ({"HOME": "/home/s"}, SOMEBODY, Path("/home/s/.local/state/lostmotion")),
    ],
)
def test_the_first_that_is_named_is_taken(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, str], user: int, place: Path
) -> None:
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(os, "geteuid", lambda: user)
    assert own_place() == place


def test_a_folder_is_made_for_this_user_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(PLACE, str(tmp_path / "deep" / "own"))
    assert stat.S_IMODE(own_folder("benches").stat().st_mode) == 0o700
    assert own_folder("benches") == tmp_path / "deep" / "own" / "benches"


def test_a_folder_of_another_user_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(PLACE, str(tmp_path))
    own_folder("benches")
    monkeypatch.setattr(os, "geteuid", lambda: SOMEBODY)
    with pytest.raises(StationError, match=f"runs as user {SOMEBODY}. Run the program as the owner of the folder"):
        own_folder("benches")


def test_a_file_in_its_place_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv(PLACE, str(tmp_path / "file"))
    with pytest.raises(StationError, match="file/benches: this folder cannot be made: "):
        own_folder("benches")
