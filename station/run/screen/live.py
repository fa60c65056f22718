"""What an operator sees of a run while it runs: drawn from the newest record, in words."""

from __future__ import annotations

from dataclasses import dataclass

from controller.sample import shown_torque_nm
from definitions.faults import FAULT_BY_NUMBER, FAULTS
from definitions.image import Image, Orders, Reaction, State
from definitions.program import Program
from definitions.states import row_of
from definitions.units import ARCMIN_PER_RAD
from drivers.servo_drive.emcy import drive_said
from station.records.samples.scan_record import unpack

TOWARDS = (State.RAMP_POS, State.RAMP_NEG)
"""States whose words name the torque that the ramp goes to."""

NOTE_BITS = sum(1 << fault.number for fault in FAULTS if fault.reaction <= Reaction.HOLD)


@dataclass(frozen=True)
class LiveView:
    """One moment of a run, in the units of the screen; torque and wind-up are None while the newest sample is stale."""

    state: State
    words: str
    torque_nm: float | None
    windup_arcmin: float | None
    cycle: int
    cycles: int
    fraction: float
    left_s: float
    time_s: float
    alarms: tuple[str, ...]
    notes: tuple[str, ...] = ()


class LiveReader:
    """Turns records into `LiveView`s for one program."""

    def __init__(self, program: Program, *, angle_out: bool = True) -> None:
        self.program = program
        """What the controller of the run steps through."""
        self._program = program
        self._angle_out = angle_out
        self._cycles = max((segment.cycle for segment in program.segments), default=0)
        self._planned_before = [0]
        for segment in program.segments:
            self._planned_before.append(self._planned_before[-1] + segment.planned_scans)
        self._segment = -1
        self._entered = 0

    def read(self, record: bytes | memoryview) -> LiveView:
        """Return what the newest record says."""
        scan, image, orders = unpack(record)
        state = State(orders.state)
        fraction, left_scans = self._advance(scan, orders)
        torque_nm = shown_torque_nm(image, orders, self._program)
        return LiveView(
            state=state,
            words=self._words(state, orders.segment),
            torque_nm=torque_nm,
            windup_arcmin=None if torque_nm is None else self._windup_arcmin(image, orders),
            cycle=orders.cycle,
            cycles=self._cycles,
            fraction=fraction,
            left_s=left_scans * self._program.period_s,
            time_s=scan * self._program.period_s,
            alarms=alarm_texts(orders.alarms & ~NOTE_BITS, image.drive_emcy_code),
            notes=alarm_texts(orders.alarms & NOTE_BITS),
        )

    def _words(self, state: State, segment: int) -> str:
        if state not in TOWARDS:
            return row_of(state).words
        target = f"{self._program.segments[segment].target_nm:+.0f}".replace("-", "−")
        return f"{row_of(state).words} towards {target} N·m"

    def _windup_arcmin(self, image: Image, orders: Orders) -> float:
        angle_in = (image.angle_in_rad - orders.angle_in_zero_rad) / self._program.ratio
        angle_out = (image.angle_out_rad - orders.angle_out_zero_rad) if self._angle_out else 0.0
        sign = 1.0 if self._program.loading_input else -1.0
        return sign * (angle_in - angle_out) * ARCMIN_PER_RAD

    def _advance(self, scan: int, orders: Orders) -> tuple[float, float]:
        """Return the share of the planned time that is over, and the planned scans that are left."""
        total = self._program.planned_scans
        load = self._planned_before[-1]
        preparation = total - load
        if orders.state in (State.COMPLETE, State.STOPPED):
            return 1.0, 0.0
        if orders.segment == 0:
            done = min(scan, preparation)
        else:
            if orders.segment != self._segment:
                self._segment, self._entered = orders.segment, scan
            planned = self._program.segments[orders.segment].planned_scans
            within = min(scan - self._entered, planned)
            done = preparation + self._planned_before[orders.segment] + within
        return min(done / max(total, 1), 1.0), max(total - done, 0)


def alarm_texts(alarms: int, emcy_code: int = 0) -> tuple[str, ...]:
    """Return the active and latched alarms in plain words, each with what to do; emcy_code: what the drive says."""
    numbers = [number for number in range(alarms.bit_length()) if alarms >> number & 1]
    faults = [FAULT_BY_NUMBER[number] for number in numbers]
    said = [(fault, drive_said(fault.id, emcy_code)) for fault in faults]
    return tuple(f"{fault.text}{more and f' ({more})'}. {fault.next_action}." for fault, more in said)
