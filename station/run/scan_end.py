"""How the scan of a run ended, in the words of its own report and of the ring, seen from the run's supervisor."""

from __future__ import annotations

import subprocess
import time

from definitions.image import State
from definitions.states import row_of
from station.atomic_file import read_file
from station.errors import BenchFaultError, RecordError
from station.records.ring.reader import RingReader
from station.records.ring.ring import ScanState
from station.records.ring.to_disk import RecordWriter
from station.records.run_record import RunRecord
from station.records.samples.scan_record import unpack
from station.run import children
from station.run.outcome import RunOutcome, cause_name, scan_report
from station.run.silent_scan import WHY_ENDED
from station.scan.scan_spec import EXIT_REFUSED
from station.wall_clock import JumpWatch

SCAN_LOG = "scan-process.log"
"""What the scan process wrote to its standard error: why it failed, or why it did not take its spec."""

LAST_WORDS_S = 0.6
"""Time for the virtual drive to notice a dead controller and to say so before it is switched off."""

LOST_IN_THE_MIDDLE = (
    "The scan process ended during the run. The unit may still be under torque: keep clear of its shafts"
)


def outcome_of(
    process: subprocess.Popen[bytes],
    ring: RingReader,
    record: RunRecord,
    writer: RecordWriter,
    wall_clock: JumpWatch,
    *,
    embedded: bool,
    interrupted: bool,
    given_up: bool = False,
) -> RunOutcome:
    """Return how a scan process ended that is not there any more; one that did not say so is marked dead in its ring.

    `embedded`: its bench is a process beside it, and still runs; `interrupted`: the operator asked for a stop.
    `given_up`: it did not answer any more, and was ended by its supervisor.

    Raises:
        BenchFaultError: the bench could not be opened, or the operator stopped before it was; nothing has moved.

    """
    said = scan_report(record)
    if said.state == "refused":
        raise BenchFaultError(said.error)
    if not (said.state or ring.written) and process.returncode == EXIT_REFUSED:
        raise BenchFaultError(read_file(record.folder / SCAN_LOG).decode(errors="replace").strip())
    if interrupted and not ring.written:
        raise BenchFaultError("stopped by the operator before anything moved")
    trouble = ""
    if said.state != "finished" and ring.state is not ScanState.FINISHED:
        ring.mark_died()
        reason = said.error or (WHY_ENDED if given_up else children.why_it_ended(process))
        trouble = (
            f"the scan process was lost in the middle of the run ({reason}). The drive stops itself when it misses "
            "the controller's heartbeat; torque may still be stored in the unit"
        )
        if embedded:
            time.sleep(LAST_WORDS_S)
    return RunOutcome(
        # the ring counts the records in it, the report those that found it full too
        written=ring.written if said.written is None else said.written - ring.lost,
        lost=ring.lost,
        realtime=said.realtime,
        notes=said.notes,
        trouble=trouble,
        counters=said.counters or {},
        times=said.times,
        pace=said.pace,
        started_ns=ring.started_ns,
        clock_jumped_s=wall_clock.jumped_s(),
        stopped_because=ring.stopped_because,
        stopped_by=cause_name(ring),
        disk=writer.times.document(),
    )


def what_waits(run_id: str, error: RecordError, ring: RingReader) -> str:
    """Say what became of a run whose disk was full to the end, and what to do."""
    state = State(unpack(ring.last())[2].state) if ring.written else State.IDLE
    waits = (
        f"{ring.waiting} of {ring.written} records wait in memory" if ring.waiting else "how it ended is kept in memory"
    )
    return (
        f"{error}. {row_of(state).ended or LOST_IN_THE_MIDDLE}; {waits}. When the disk works again, 'lostmotion "
        f"conclude {run_id}' completes the record. Do this before this computer is switched off"
    )
