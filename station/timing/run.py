"""Measuring a machine without a unit under test: bench, scan and supervisor as in a run; a report, no record."""

from __future__ import annotations

import os
import tempfile
import time
import zlib
from contextlib import ExitStack
from dataclasses import fields, replace
from pathlib import Path

from definitions.image import Image
from definitions.plain_data import plain
from recipes import Recipe
from station.atomic_file import as_json
from station.bench.bench_spec import BenchSpec, Ports
from station.bench.request import Job
from station.documents import entries as documents
from station.documents.reading import read_document
from station.errors import BenchFaultError
from station.records.clocks import WALL
from station.records.program_file import PROGRAM
from station.records.ring.reader import RingReader
from station.records.ring.ring import create
from station.records.samples.scan_record import BODY_BYTES, IMAGE_FIRST, RECORD_BYTES, RECORD_STRUCT
from station.run import children
from station.run.process_specs import EMBEDDED_SPIN_NS, REAL_SPIN_NS, compiled
from station.run.supervisor import LOOK_EVERY_S
from station.scan.machine import look
from station.scan.scan_spec import SpecFile, TimingSpec, write_spec
from station.timing.report import Asked, CheckedRecords, ProcessReport, Scanned, TimingReport

MISSED = IMAGE_FIRST + Image._fields.index("missed_periods")


class Gapless:
    """Looks at every record that comes out of the ring: its CRC, its sequence number, and that no period is missing.

    A scan number may jump only by the periods that the record itself says were missed.
    """

    def __init__(self) -> None:
        self.checked = 0
        self.problem = ""
        self._scan = -1

    def take(self, data: bytes) -> None:
        """Check the records of one drain; the first problem is kept."""
        view = memoryview(data)
        for place, values in enumerate(RECORD_STRUCT.iter_unpack(view)):
            at = place * RECORD_BYTES
            sequence, scan, missed = values[0], values[1], values[MISSED]
            if zlib.crc32(view[at : at + BODY_BYTES]) != values[-1]:
                self._note(f"record {self.checked} fails its CRC")
            elif sequence != self.checked:
                self._note(f"record {sequence} came where {self.checked} was due")
            elif scan != self._scan + 1 + missed:
                self._note(f"scan {scan} follows {self._scan}, its record tells of {missed} missed periods")
            self._scan = scan
            self.checked += 1

    def _note(self, problem: str) -> None:
        self.problem = self.problem or problem


def with_period(recipe: Recipe, period_ns: int) -> Recipe:
    """Return a recipe that is scanned at another period."""
    sampling = recipe.sampling.model_copy(update={"period_ns": period_ns})
    return recipe.model_copy(update={"sampling": sampling})


def measure(job: Job, asked: Asked) -> TimingReport:
    """Measure the machine with this job's bench; nothing is started, nothing moves.

    Raises:
        BenchFaultError: the bench could not be opened, or the process ended early.

    """
    period_ns = asked.period_ns or job.recipe.sampling.period_ns
    with ExitStack() as cleanup:
        folder = Path(cleanup.enter_context(tempfile.TemporaryDirectory(prefix="lostmotion-timing-")))
        embedded = job.bench.bench.embedded
        profiles = {name: str(path) for name, path in job.profile_paths.items()}
        ports, life_line, bench_pid = None, None, 0
        if embedded:
            life_line = children.LifeLine()
            cleanup.callback(life_line.close)
            bench_pid, ports = _virtual_bench(job, profiles, folder, life_line, cleanup)
        ring_path = create(folder)
        cleanup.callback(ring_path.unlink, missing_ok=True)
        ring = RingReader(ring_path)
        cleanup.callback(ring.close)
        usual_spin_ns = EMBEDDED_SPIN_NS if embedded else REAL_SPIN_NS
        timed = replace(job, recipe=with_period(job.recipe, period_ns))
        (folder / PROGRAM).write_bytes(as_json(plain(timed.program)))
        spec = TimingSpec(
            ring=str(ring_path),
            report=str(folder / "report.json"),
            compiled=compiled(timed, folder / PROGRAM, ports),
            spin_ns=usual_spin_ns if asked.spin_ns is None else asked.spin_ns,
            periods=max(round(asked.seconds * 1e9 / period_ns), 1),
        )
        file = write_spec(spec, folder / "spec.json")
        before_s = cpu_seconds(bench_pid)
        records = Gapless()
        scanned = _scanned(file, ring, life_line, cleanup, records)
        bench_cpu_s = round(cpu_seconds(bench_pid) - before_s, 3) if embedded else None
    return TimingReport(
        **{one.name: getattr(scanned, one.name) for one in fields(scanned)},
        period_ns=period_ns,
        spin_ns=spec.spin_ns if scanned.realtime.spin_tail else 0,
        bench=job.bench.bench.name,
        embedded=embedded,
        bitrate=job.bench.can.bitrate,
        bus_us=job.bus_us,
        records=CheckedRecords(records.checked, records.problem),
        virtual_bench_cpu_s=bench_cpu_s,
        machine=tuple(look(asked=scanned.realtime)),
        asked=asked,
    )


def _virtual_bench(
    job: Job,
    profiles: dict[str, str],
    folder: Path,
    life_line: children.LifeLine,
    cleanup: ExitStack,
) -> tuple[int, Ports]:
    from station.bench.assemble_virtual import choose_unit  # noqa: PLC0415 - brings the virtual bench

    unit = choose_unit(None, job.recipe)
    spec = BenchSpec(bench=str(job.bench_source.path), profiles=profiles, unit=unit, clock=WALL)
    path = folder / "virtual-bench-spec.json"
    path.write_bytes(as_json(documents.plain(spec)))
    process, ports = children.start_virtual_bench(path, folder / "virtual-bench.jsonl", life_line)
    cleanup.callback(children.stop, process)
    return process.pid, ports


def cpu_seconds(pid: int) -> float:
    """Return user and system time that a process has taken [s]; 0 when it is gone."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    except OSError:
        return 0.0
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def _scanned(
    spec: SpecFile,
    ring: RingReader,
    life_line: children.LifeLine | None,
    cleanup: ExitStack,
    records: Gapless,
) -> Scanned:
    folder = spec.path.parent
    process = children.start_scanning("station.timing.process", spec, folder / "scan.log", life_line)
    cleanup.callback(children.stop, process)
    while process.poll() is None:
        time.sleep(LOOK_EVERY_S)
        ring.drain(records.take)
    ring.drain(records.take)
    path = folder / "report.json"
    if not path.exists():
        said = (folder / "scan.log").read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
        raise BenchFaultError(
            f"the timing measurement failed: its process {children.why_it_ended(process)}. {' '.join(said)} Try again"
        )
    report = read_document(ProcessReport, path)
    if report.scanned is None:
        raise BenchFaultError(report.error)
    return report.scanned
