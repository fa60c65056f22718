"""What a scan process is told: the same program and bench for every shipped recipe, and nothing that was changed."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

from definitions.plain_data import exact, plain
from recipes import shipped_recipes
from station.atomic_file import as_json
from station.bench.bench_spec import Ports
from station.bench.request import Job, load_job
from station.records.clocks import BY_WALL_CLOCK, SCAN, Pacing
from station.records.program_file import PROGRAM, plain_program
from station.records.run_record import RunRecord
from station.run.process_specs import EMBEDDED_SPIN_NS, compiled, write_scan_spec
from station.scan.scan_spec import Compiled, ScanSpec, SpecError, SpecFile, read_program, told, write_spec

ROOT = Path(__file__).parents[3]
PARTS = ("can", "amplifier", "brake", "remote_io", "pace")
READY = {part: {"channel": "vcan0", "host": "127.0.0.1", "port": place} for place, part in enumerate(PARTS, start=1)}
PORTS = Ports.of_ready_line(json.dumps({"ready": True, "unit": "P1", **READY}).encode())
NOT_LOADED = ("recipes", "analysis", "virtual_bench", "numpy", "scipy", "pydantic", "pint", "ruamel", "yaml")
"""What a process that scans does without: it would stand in its locked memory, and some of it starts threads."""


def test_a_line_that_names_no_bus_is_no_ready_line() -> None:
    assert (PORTS.can.channel, PORTS.devices["brake"].port) == ("vcan0", 3)
    for line in (b"no JSON", b"[]", b'{"ready": true}', b'{"can": {"port": 1}}'):
        with pytest.raises(ValueError, match=r"expected its addresses|Expecting"):
            Ports.of_ready_line(line)


def _job(recipe: str) -> Job:
    return load_job(recipe, None)


def _compiled(job: Job, folder: Path) -> Compiled:
    (folder / PROGRAM).write_bytes(as_json(plain_program(job.program)))
    return compiled(job, folder / PROGRAM, PORTS, waits=True)


def _spec(folder: Path, job: Job) -> SpecFile:
    spec = ScanSpec(
        ring=str(folder / "ring"),
        report=str(folder / "report.json"),
        compiled=_compiled(job, folder),
        clock="scan",
        fast=True,
        spin_ns=0,
        supervisor=1,
        after_end_scans=0,
        left=None,
    )
    return write_spec(spec, folder / "scan-spec.json")


@pytest.mark.parametrize("recipe", sorted(shipped_recipes()))
def test_program_and_bench_of_every_shipped_recipe_arrive_as_they_were_compiled(recipe: str, tmp_path: Path) -> None:
    job = _job(recipe)
    file = _spec(tmp_path, job)
    spec = told(["process", file.sha256, str(file.path)], ScanSpec)
    assert repr(read_program(spec.compiled)) == repr(job.program)
    assert repr(spec.compiled) == repr(_compiled(job, tmp_path))
    assert repr(exact(ScanSpec, plain(spec))) == repr(spec)


@pytest.mark.parametrize(("pacing", "spin_ns"), [(BY_WALL_CLOCK, EMBEDDED_SPIN_NS), (Pacing(SCAN), 0)])
def test_before_a_bench_that_waits_no_scan_spins(pacing: Pacing, spin_ns: int, tmp_path: Path) -> None:
    job, record, report = _job("rv-40e-121-quick"), RunRecord(tmp_path), tmp_path / "report.json"
    (tmp_path / PROGRAM).write_bytes(as_json(plain_program(job.program)))
    file = write_scan_spec(job, record, tmp_path / "ring", report, PORTS, pacing=pacing, after_end_scans=0, left=None)
    assert told(["process", file.sha256, str(file.path)], ScanSpec).spin_ns == spin_ns


@pytest.mark.parametrize("module", ["station.scan.scan_process", "station.timing.process"])
def test_a_process_takes_no_spec_but_the_one_that_was_written_for_it(module: str, tmp_path: Path) -> None:
    file = _spec(tmp_path, _job("rv-40e-121-quick"))
    file.path.write_bytes(file.path.read_bytes().replace(b'"node_id": 5', b'"node_id": 6'))
    command = [sys.executable, "-m", module, file.sha256, str(file.path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(f"file {file.path} was changed after it was checked: found SHA-256 ")
    assert done.stderr.count("\n") == 1


def test_a_spec_of_another_version_is_refused(tmp_path: Path) -> None:
    file = _spec(tmp_path, _job("rv-40e-121-quick"))
    content = json.loads(file.path.read_bytes())
    del content["compiled"]["wires"]["drive"]["gear_ratio"]
    content["compiled"]["wires"]["drive"]["gear_rato"] = 2.0
    again = json.dumps(content).encode()
    file.path.write_bytes(again)
    with pytest.raises(SpecError, match=r"drive\.gear_ratio is missing; .*drive\.gear_rato is unknown"):
        told(["process", hashlib.sha256(again).hexdigest(), str(file.path)], ScanSpec)


@pytest.mark.parametrize("words", [["process"], ["process", "spec.json"], ["process", "a", "b", "c"]])
def test_a_process_wants_both_words(words: list[str]) -> None:
    with pytest.raises(SpecError, match=r"SHA256 SPEC\.json"):
        told(words, ScanSpec)


@pytest.mark.parametrize("module", ["station.scan.scan_process", "station.timing.process"])
def test_a_process_that_scans_loads_what_it_scans_with_and_no_more(module: str) -> None:
    code = (
        f"import sys, {module}; print(*sorted({{name.partition('.')[0] for name, one in sys.modules.items() if one}}))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = done.stdout.split()
    assert {"controller", "drivers", "can", "canopen", "pymodbus"} <= set(loaded)
    assert [name for name in NOT_LOADED if name in loaded] == []
