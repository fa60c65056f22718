"""The scan: read, step, write, record. One loop for both clocks.

In real time a schedule waits for absolute deadlines and skips whole periods; in virtual time scan follows scan as fast
as they go, wake-up latency and work are recorded as 0, and the same seed gives the same bytes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from definitions.image import Command, Image, Orders, State
from station.records.scan_times import ScanTimes
from station.scan.schedule import Schedule

START_AT = 50
"""Sequence number of the scan that START is given to: by then every device has answered."""


class Bench(Protocol):
    """What the loop needs of a bench, over wires or in process; neither call may wait."""

    def read(self, scan: int, missed_periods: int, command: int) -> Image:
        """Return the inputs of this scan."""

    def write(self, orders: Orders, scan: int) -> None:
        """Send the outputs of this scan."""


class Stepper(Protocol):
    """What the loop needs of the controller."""

    @property
    def finished(self) -> bool:
        """True when nothing more will happen: complete, stopped, or a fault that has settled."""

    def step(self, image: Image, scan: int) -> Orders:
        """Decide one scan."""


class Injected(Protocol):
    """What faults in virtual time need of the loop: only it knows the scan and the controller's state."""

    def take_missed(self) -> int:
        """Return how many periods are missed before the next scan."""

    def tell(self, state: str, scan: int) -> None:
        """Take the state of the controller after a scan."""


Append = Callable[[int, int, int, Image, Orders], bool]
"""`append(scan, lateness_ns, work_ns, image, orders)`, False when the record was lost."""


class Stop:
    """A wish to end the run, set by a signal handler or by a lost record; becomes the command STOP."""

    def __init__(self) -> None:
        self.wanted = False
        self.given = False
        self.supervisor_gone = False
        """Asked for because the supervisor ended before it had given START."""

    def ask(self, *_: object) -> None:
        """Ask for it (usable as a signal handler)."""
        self.wanted = True


def run_virtual(
    bench: Bench,
    controller: Stepper,
    append: Append,
    take_command: Callable[[int], int],
    faults: Injected | None = None,
) -> int:
    """Run scans back to back until the controller has finished; return how many there were.

    `faults` may skip periods, as a machine in trouble does, and are told where the controller is.
    """
    sequence = missed = 0
    scan = -1
    read, step, write = bench.read, controller.step, bench.write
    while True:
        if faults is not None:
            missed = faults.take_missed()
        scan += 1 + missed
        image = read(scan, missed, take_command(sequence))
        orders = step(image, scan)
        append(scan, 0, 0, image, orders)  # before the devices answer into the same image
        write(orders, scan)
        if faults is not None:
            faults.tell(State(orders.state).name.lower(), scan)
        sequence += 1
        if controller.finished:
            return sequence


def run_real(
    bench: Bench,
    controller: Stepper,
    append: Append,
    take_command: Callable[[], int],
    *,
    schedule: Schedule,
    stop: Stop,
    times: ScanTimes,
    note_start: Callable[[int], None] | None = None,
    after_end_scans: int = 0,
) -> int:
    """Run scans at their deadlines until the controller has finished; return the number of the last period.

    `times` counts what every scan took; `note_start` is given the monotonic time from which deadlines count. A lost
    record asks for a stop: what nobody records must not go on under torque.
    `after_end_scans` are run on after the end, so that what would clear by itself is seen to do so; a person may
    acknowledge and reset in them.
    """
    now_ns: Callable[[], int] = time.monotonic_ns
    read, step, write, wait, count = bench.read, controller.step, bench.write, schedule.wait, times.add
    scan, ended = -1, 0
    schedule.start()
    if note_start is not None:
        note_start(schedule.started_ns)
    while not controller.finished or ended < after_end_scans:
        ended = ended + 1 if controller.finished else 0
        woken = wait()
        missed = schedule.missed
        scan += 1 + missed
        command = take_command()
        if command == 0 and stop.wanted and not stop.given:
            stop.given = True
            command = int(Command.STOP)
        image = read(scan, missed, command)
        was_read = now_ns()
        orders = step(image, scan)
        stepped = now_ns()
        write(orders, scan)
        written = now_ns()
        if not append(scan, schedule.lateness_ns, written - woken, image, orders):
            stop.wanted = True
        if stop.given and orders.state == State.IDLE:
            break  # nothing was started, so there is nothing to bring to an end
        count(scan, missed, schedule.lateness_ns, (woken, was_read, stepped, written, now_ns()))
    return scan


def start_once(sequence: int) -> int:
    """Return the command of a virtual run for the given scan: START once, else none."""
    return int(Command.START) if sequence == START_AT else 0
