"""A recovery where nobody knows that the drive ends its torque: it is possible, and says so with its question."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from station_samples import IMAGE, ORDERS

from controller.aftermath import FaultReaction
from definitions.faults import FAULT_BY_ID
from definitions.image import DriveState, State
from definitions.protections import UNPROVEN
from station.bench.commissioned import protocol_path
from station.bench.request import DRIVER_PROFILES, Job, load_job
from station.cli.measure import recover as command
from station.commissioning.on_wires import on_wires
from station.commissioning.steps_done import write_down
from station.errors import BenchFaultError
from station.records.ring.reader import RingReader
from station.records.run_record import BENCH_COPY, RunRecord
from station.records.samples.scan_record import pack
from station.records.seal import seal
from station.run.new_record import Wanted, new_record
from station.run.way_back.guide import QUESTION, UNPROVEN_DRIVE
from station.run.way_back.recoveries import recoveries

RECIPE = "rv-40e-121-quick"
FAULTED = pack(
    (1, 1, 0, 0),
    IMAGE._replace(drive_state=DriveState.FAULT),
    ORDERS._replace(
        state=State.FAULT, phase=FaultReaction.SETTLED, fault=FAULT_BY_ID["drive_fault"].number, alarms=0
    ),
)  # fmt: skip


class Unopened:
    """A supervisor that shows one record of a bench in a fault, and then has no bench."""

    def __init__(
        self, _job: Job, record: RunRecord, *_: object, attend: Callable[[RingReader], None], **__: object
    ) -> None:
        self._record, self._attend = record, attend

    def run(self, *_: object) -> None:
        self._attend(cast("RingReader", SimpleNamespace(last=lambda: FAULTED)))
        self._record.samples.write_bytes(FAULTED)
        raise BenchFaultError("not there")


@pytest.fixture
def bench_file(tmp_path: Path) -> Path:
    """A bench on its own wires, with a drive that is not the virtual one; its watchdogs have passed."""
    for name in ("virtual-drive", "virtual-amplifier", "virtual-brake", "virtual-remote-io"):
        content = (DRIVER_PROFILES / f"{name}.yaml").read_text(encoding="utf-8")
        content = content.replace("vendor_id: 0x4C4D0001", "vendor_id: 0x000000FB")
        (tmp_path / f"{name}.yaml").write_text(content, encoding="utf-8")
    text = load_job(RECIPE, "virtual").bench_source.content.decode()
    path = tmp_path / "mine.yaml"
    path.write_text(text.replace("embedded: true", "embedded: false"), encoding="utf-8")
    write_down(on_wires(str(path)), "watchdogs", None, (), ())
    return path


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(command, "Supervisor", Unopened)
    monkeypatch.setattr(sys, "stdin", None)
    return tmp_path / "runs"


def left_in_a_fault(data: Path, bench_file: Path) -> RunRecord:
    record = new_record(
        data, load_job(RECIPE, str(bench_file)), Wanted("SN1", None, None, None, clock="wall"), notes=[]
    )
    record.samples.write_bytes(FAULTED)
    seal(record, state="fault", verdict="NOT DECIDABLE")
    record.lock.close()
    return record


def said(data: Path, bench: Path | None, capsys: pytest.CaptureFixture[str]) -> list[str]:
    capsys.readouterr()
    assert command.recover(None if bench is None else str(bench), data, yes=True, as_json=False) == 4
    return capsys.readouterr().out.splitlines()


def warned(lines: list[str]) -> bool:
    """Tell whether the warning stands right before the question, which is asked in any case."""
    asked = lines.index(QUESTION)
    return lines[asked - 1] == f"WARNING  {UNPROVEN_DRIVE}"


def test_a_recovery_warns_where_the_watchdogs_were_not_measured(
    data: Path, bench_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = left_in_a_fault(data, bench_file)
    assert not warned(said(data, None, capsys))
    assert not warned(said(data, bench_file, capsys))
    assert UNPROVEN not in recoveries(data).newest(1)[0].manifest().notes
    protocol_path(bench_file).unlink()
    assert warned(said(data, bench_file, capsys)), "the bench as it is now"
    assert UNPROVEN in recoveries(data).newest(1)[0].manifest().notes
    assert warned(said(data, None, capsys)), "the recovery before has said so"
    protocol_path(bench_file).write_text("{}", encoding="utf-8")
    assert warned(said(data, bench_file, capsys)), "a damaged protocol proves nothing"
    assert run.manifest().unit.virtual is None


def test_a_recovery_goes_by_what_the_run_has_said_of_its_bench(
    data: Path, bench_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    protocol_path(bench_file).unlink()
    run = left_in_a_fault(data, bench_file)
    assert warned(said(data, None, capsys))
    assert warned(said(data, run.folder / BENCH_COPY, capsys)), "as the station names it"
