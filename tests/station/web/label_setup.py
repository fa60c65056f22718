"""A station that prints labels: its settings, its sealed runs, and the thread of the server that prints."""

from __future__ import annotations

from pathlib import Path

from stored_runs import metric, store_run

from station.records.certificate_code import code_of
from station.web.labels import outbox
from station.web.labels.outbox import Printing, awaited
from station.web.labels.settings import FILE, SHIPPED
from station.web.people.database import LABELS
from station.web.station import Station

SETTINGS = """\
printer: {{port: {port}, timeout_s: 0.5}}
templates: {{PASS: pass.zpl}}
read_back: "{read_back}"
"""


def set_up(data: Path, port: int, read_back: str = "{code}", template: str | None = None) -> None:
    data.mkdir(parents=True, exist_ok=True)
    (data / FILE).write_text(SETTINGS.format(port=port, read_back=read_back))
    (data / "pass.zpl").write_text(template or SHIPPED.read_text())


def thread_of(plant: Station) -> Printing:
    assert plant.labels is not None
    return Printing(plant.database, plant.data, plant.labels)


def stand(plant: Station) -> outbox.Awaited | None:
    assert plant.labels is not None
    with plant.database.reading() as connection:
        return awaited(connection, plant.labels)


def due_now(plant: Station) -> None:
    """Let the wait before a printer is asked again be over."""
    with plant.database.writing() as connection:
        connection.execute(LABELS.update().values(next_s=0.0))


def released_text(data: Path) -> bytes:
    return (data.parent / "recipes" / "good.yaml").read_bytes()


def good_run(plant: Station, serial: str = "SN-1", **words: object) -> str:
    run = store_run(plant.data, serial, [metric(0.4)], **{"text": released_text(plant.data)} | words)
    return code_of(run)
