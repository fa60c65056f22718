"""The table of models is read again at a scan when its file has changed, and a wrong or missing one starts nothing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from station_support import client_of, station_in

from station.web.models import FILE, ModelsFile
from station.web.station import Station

ROW = "models:\n  - {model: NEW, serial: 'NEW-[0-9]+', recipe: good, unit: worn}\n"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Station]:
    opened = station_in(tmp_path / "runs")
    found = replace(opened, models_file=ModelsFile(opened.data, None))
    yield found
    found.close()
    opened.close()


def test_a_changed_table_counts_from_the_next_scan_on(served: Station) -> None:
    before = served.models
    assert served.read_models() is before
    (served.data / FILE).write_text(ROW, encoding="utf-8")
    found = served.read_models()
    assert found is served.models
    assert [(one.model, one.unit) for one in found.models] == [("NEW", "worn")]
    assert served.read_models() is found


@pytest.mark.parametrize("text", ["models: []\n", "models: [", None])
def test_a_table_that_is_wrong_or_gone_starts_nothing_until_it_is_right(served: Station, text: str | None) -> None:
    path, before = served.data / FILE, (served.data / FILE).read_bytes()
    path.unlink() if text is None else path.write_text(text, encoding="utf-8")
    operator = client_of(served, "operator")
    for _ in range(2):
        answer = operator.post("start_run", {"scanned": "SN-1"})
        assert answer.status_code != 200
        assert FILE in answer.json()["refused"][0]["text"]
    assert not served.running.busy()
    path.write_bytes(before)
    assert served.read_models().models
