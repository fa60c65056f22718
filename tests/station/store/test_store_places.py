"""Where a store may be: no network mount, no place without a file, no database of another kind."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from lostmotion_command import here

from station.errors import StationError
from station.store.places import STORE_URL, network_type, store_place

MOUNT_LINES = """\
22 1 8:1 / / rw,relatime - ext4 /dev/vda rw
30 22 0:40 / /mnt/line rw,relatime shared:1 - nfs4 server:/x rw
31 22 0:41 / /mnt/my\\040line rw - cifs //server/x rw
32 30 8:2 / /mnt/line/local rw - xfs /dev/vdb rw
33 22 0:42 / /mnt/Prüfstand\\0402 rw - nfs4 server:/y rw
"""


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/data", ""),
        ("/mnt/line/runs", "nfs4"),
        ("/mnt/my line/runs", "cifs"),
        ("/mnt/line/local/x", ""),
        ("/mnt/lines", ""),
        ("/mnt/Prüfstand 2/runs", "nfs4"),
    ],
)
def test_a_network_mount_is_known_by_its_type(tmp_path: Path, path: str, kind: str) -> None:
    mounts = tmp_path / "mounts"
    mounts.write_text(MOUNT_LINES, encoding="utf-8")
    assert network_type(Path(path), mounts) == kind


@pytest.mark.parametrize("named", ["sqlite:///", "sqlite:///:memory:"])
def test_a_store_that_names_no_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: str) -> None:
    monkeypatch.setenv(STORE_URL, named)
    with pytest.raises(StationError, match="names no file"):
        store_place(tmp_path)


def test_a_store_that_is_named_from_here_stays_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(STORE_URL, "sqlite:///own.sqlite3")
    assert store_place(tmp_path).url == f"sqlite:///{tmp_path}/own.sqlite3"


def test_no_sqlite_file_lies_on_a_network_mount(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mounts = tmp_path / "mounts"
    mounts.write_text(f"30 22 0:40 / {tmp_path.resolve()} rw - nfs4 server:/x rw\n")
    monkeypatch.setattr("station.store.places.network_type", lambda path: network_type(path, mounts))
    monkeypatch.delenv(STORE_URL, raising=False)
    place = store_place(tmp_path)
    assert "network mount (nfs4)" in place.note
    assert not place.url.startswith(f"sqlite:///{tmp_path}")
    monkeypatch.setenv(STORE_URL, f"sqlite:///{tmp_path}/x.sqlite3")
    with pytest.raises(StationError, match="network drive"):
        store_place(tmp_path)


@pytest.mark.parametrize("url", ["mysql://x/y", "x", "oracle://u:secret@h/y"])
def test_a_url_of_another_kind_is_refused(tmp_path: Path, url: str) -> None:
    (tmp_path / "runs").mkdir()
    ran = here("--store", url, "list", "--data", str(tmp_path / "runs"))
    assert ran.exit_code == 2
    assert "sqlite:///FILE and postgresql://" in ran.err
    assert "secret" not in ran.err
    assert STORE_URL not in os.environ
