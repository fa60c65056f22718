"""What the steps of a run share: orders in the making, references, what the scan measured, and where the run stands."""

from __future__ import annotations

import math
from typing import NamedTuple

from controller.conditions import Measured
from controller.sample import is_fresh, tared_nm
from definitions.image import AGE_NEVER, DriveCommand, DriveMode, Image
from definitions.program import Program


class Outcome(NamedTuple):
    """What a step says after a scan: a trigger to fire, a fault to raise, or neither (both empty)."""

    trigger: str = ""
    fault: str = ""


RUNNING = Outcome()


class Event(NamedTuple):
    """Something that happened: `kind` is "transition", "alarm" or "note"; `text` names it; times are scan numbers."""

    scan: int
    kind: str
    state: str
    text: str


class Context:
    """Shared by all steps of one controller; nothing here decides anything."""

    __slots__ = (
        "_answer_took_scans",
        "_fast_for_scans",
        "_fastest_before_rad_s",
        "_fastest_now_rad_s",
        "_oldest_scans",
        "_sample_age_scans",
        "angle_in_zero_rad",
        "angle_out_zero_rad",
        "brake_current_a",
        "brake_on",
        "control_from_input",
        "drive_angle_zero_rad",
        "drive_command",
        "drive_mode",
        "drive_torque_nm",
        "drive_velocity_rad_s",
        "hold",
        "last_counter",
        "left_loaded",
        "left_zeroes_known",
        "loading_offset_nm",
        "loading_slope",
        "lock_found",
        "lock_proven",
        "lock_zero_rad",
        "measured",
        "notes",
        "phase",
        "program",
        "reference_nm",
        "segment",
        "stopping",
        "torque_in_tare_nm",
        "torque_out_tare_nm",
    )

    def __init__(self, program: Program) -> None:
        self.program = program
        self.measured = Measured()
        self.measured.brake_tolerance_a = program.lock.tolerance_a
        self.measured.agreement_live = program.has_torque_out and (program.has_torque_in or not program.loading_input)
        self.last_counter = -1
        self.torque_in_tare_nm = self.torque_out_tare_nm = 0.0
        self.angle_in_zero_rad = self.angle_out_zero_rad = self.lock_zero_rad = self.drive_angle_zero_rad = 0.0
        self.brake_current_a = 0.0
        self.brake_on = 0
        self.left_loaded = False
        self.left_zeroes_known = True
        self.lock_found = True
        self.notes: list[str] = []
        limits = program.limits
        # a sample that is as old as it may be, and whose answer took as long
        self._oldest_scans = (
            2 * limits.sample_stale_scans + limits.drive_stale_scans + math.ceil(limits.angle_lag_scans)
        )
        self._sample_age_scans = AGE_NEVER
        self._answer_took_scans = 0
        self._fast_for_scans = 0
        self._fastest_now_rad_s = self._fastest_before_rad_s = 0.0
        self.begin()

    def begin(self) -> None:
        """Forget the run before, not what is still switched on: brake orders stay as they are."""
        self.drive_command: int = DriveCommand.DISABLE_VOLTAGE
        self.drive_mode: int = DriveMode.NONE
        self.drive_torque_nm = self.drive_velocity_rad_s = 0.0
        self.reference_nm = 0.0
        self.phase = 0
        self.segment = self.program.segments[0]
        self.hold = False
        self.stopping = False
        self.lock_proven = False
        self.measured.lock_motion_limit_rad = math.inf
        self.measured.brake_current_expected_a = 0.0
        self.measured.angles_compared = True
        self.control_from_input = not self.program.has_torque_out
        self.loading_slope = self.program.control.slope
        self.loading_offset_nm = self.program.control.offset_nm

    def measure(self, image: Image) -> None:
        """Take from the image what this scan knows: torques less their tare, motions since the references."""
        if self.lock_found:
            self.keep_lock(image)
        measured, program = self.measured, self.program
        measured.torque_in_nm, measured.torque_out_nm = torque_in_nm, torque_out_nm = tared_nm(image, self)
        measured.controlled_nm = program.control.slope * torque_in_nm if self.control_from_input else torque_out_nm
        if program.loading_input:  # as `travel_rad` and `locked_angle_rad`, which take a call each
            travel_rad = image.angle_in_rad - self.angle_in_zero_rad
            measured.locked_motion_rad = image.angle_out_rad - self.lock_zero_rad
        else:
            travel_rad = image.angle_out_rad - self.angle_out_zero_rad
            measured.locked_motion_rad = image.angle_in_rad - self.lock_zero_rad
        measured.travel_rad = travel_rad
        measured.drive_apart_rad = image.drive_angle_rad - self.drive_angle_zero_rad - travel_rad
        measured.speed_rad_s = speed_rad_s = image.drive_velocity_rad_s
        elapsed, age_scans = 1 + image.missed_periods, image.sample_age_scans
        # How long ago the sample may have been asked for: a slow amplifier may have measured then. It is asked again
        # only when it has answered, so no answer took longer than the time since the one before.
        grown_scans = self._sample_age_scans + elapsed
        if age_scans < grown_scans:
            self._answer_took_scans = grown_scans - age_scans if self._sample_age_scans < AGE_NEVER else 0
        self._sample_age_scans = age_scans
        measured.request_age_scans = age_scans + self._answer_took_scans
        self.keep_fastest(abs(speed_rad_s), elapsed)
        # an answer of this scan or the one before; where none comes, the age tells (`sample_stale`)
        counter = image.sample_counter
        measured.counter_stands = age_scans <= 1 and counter == self.last_counter
        self.last_counter = counter

    def keep_fastest(self, speed_rad_s: float, elapsed: int) -> None:
        """Keep the largest speed of the last scans: of as many as a value may be old before that itself is a fault.

        Two spans of that length follow each other, so that it is kept for one to two of them.
        """
        self._fast_for_scans += elapsed
        if self._fast_for_scans > self._oldest_scans:
            self._fast_for_scans = 0
            self._fastest_before_rad_s, self._fastest_now_rad_s = self._fastest_now_rad_s, 0.0
        # comparisons: calls of max are a tenth of what a scan takes for all that it measures
        now_rad_s, before_rad_s = self._fastest_now_rad_s, self._fastest_before_rad_s
        if speed_rad_s > now_rad_s:
            self._fastest_now_rad_s = now_rad_s = speed_rad_s
        if now_rad_s < before_rad_s:  # noqa: PLR1730 - as above
            now_rad_s = before_rad_s
        self.measured.fastest_rad_s = now_rad_s

    def disable_drive(self) -> None:
        """No torque and no voltage from the drive."""
        self.drive_command = DriveCommand.DISABLE_VOLTAGE
        self.drive_torque_nm = self.drive_velocity_rad_s = 0.0
        self.measured.drive_enabled_expected = False
        self.measured.mode_expected = 0

    def keep_lock(self, image: Image) -> None:
        """Leave the lock as it is found, until a step of the run orders it: nobody knows what a closed one holds."""
        if image.brake_age_scans == AGE_NEVER:
            return
        if not image.brake_on:
            self.brake_on, self.brake_current_a = 0, 0.0
        elif not self.brake_on:
            found_a = image.brake_current_a if math.isfinite(image.brake_current_a) else 0.0
            self.brake_on, self.brake_current_a = 1, max(self.program.lock.current_a, found_a)

    def take_up(self, image: Image, torque_in_tare_nm: float, torque_out_tare_nm: float, *, zeroes_known: bool) -> None:
        """Go on where an earlier run ended: its zeroes, angles from where the shafts stand, the lock as found."""
        self.left_loaded = True
        self.left_zeroes_known = zeroes_known
        self.lock_found = False
        self.torque_in_tare_nm, self.torque_out_tare_nm = torque_in_tare_nm, torque_out_tare_nm
        self.take_references(image)
        self.measured.brake_current_expected_a = self.program.lock.current_a if self.brake_on else 0.0

    def take_over_torque(self, image: Image) -> None:
        """Torque set-point from what the drive shows, so that a change of mode does not move the shaft.

        The drive's word is not trusted beyond the limit, nor at all while the lock is open.
        """
        limit_nm = self.program.control.torque_limit_nm if self.brake_on else 0.0
        self.drive_torque_nm = min(limit_nm, max(-limit_nm, image.drive_torque_nm))
        self.drive_velocity_rad_s = 0.0

    def take_references(self, image: Image) -> None:
        """Count angles of both shafts, and the drive's position, from where they stand now."""
        self.angle_in_zero_rad = image.angle_in_rad
        self.angle_out_zero_rad = image.angle_out_rad
        self.lock_zero_rad = self.locked_angle_rad(image)
        self.drive_angle_zero_rad = image.drive_angle_rad - self.travel_rad(image)

    def travel_rad(self, image: Image) -> float:
        """Angle of the loaded shaft since the reference, by its sensor [rad]."""
        if self.program.loading_input:
            return image.angle_in_rad - self.angle_in_zero_rad
        return image.angle_out_rad - self.angle_out_zero_rad

    def locked_angle_rad(self, image: Image) -> float:
        """Angle of the shaft that the lock holds [rad]."""
        return image.angle_out_rad if self.program.loading_input else image.angle_in_rad

    def control_from(self, *, the_input: bool) -> float:
        """Control the input torque or the output's from now on; return the controlled torque of this scan [N·m]."""
        measured = self.measured
        self.control_from_input = the_input
        from_input_nm = self.program.control.slope * measured.torque_in_nm
        measured.controlled_nm = from_input_nm if the_input else measured.torque_out_nm
        return measured.controlled_nm

    def sample_is_fresh(self, image: Image) -> bool:
        """Whether the torques of this scan are those of now."""
        return is_fresh(image, self.program.limits)

    def torque_is_low(self, image: Image) -> bool:
        """True when a fresh sample shows the torque in the unit below the threshold under which the lock may open."""
        return self.sample_is_fresh(image) and abs(self.measured.controlled_nm) <= self.program.release_torque_nm
