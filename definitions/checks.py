"""Validity checks: whether a measurement may be judged at all, apart from what its metrics say.

A check is a figure held against a limit. One that fails makes the verdict NOT DECIDABLE; one whose figure does not
apply says why and decides nothing.
"""

from __future__ import annotations

from typing import NamedTuple

from definitions.units import FRACTION, LOSS, NUMBER, SAMPLES, SCANS, TEMPERATURE, TEMPERATURE_CHANGE, Kind, Range


class LeavesOpen(NamedTuple):
    """Error that a check cannot see: its name for people, and the unit of its size."""

    text: str
    unit: str


class Check(NamedTuple):
    """One validity check: its figure, the limit that holds unless the recipe has another, and what a failure means."""

    id: str
    title: str
    """What people read first."""
    kind: Kind
    limit: float
    """In the unit of the check."""
    figure: str
    """What the number is."""
    failed: str
    """What is wrong, unless the figure has words of its own."""
    action: str
    """What to do."""
    at_least: bool = False
    """The limit is the least value allowed, otherwise the largest."""
    settable: Range | None = None
    """Limits that a recipe may set; None where the limit is fixed, or is one of another section."""
    below: str = ""
    """Check whose limit must be above this one's."""
    explained_by: str = ""
    """Check whose failure explains one of this: then it is no reason of its own."""
    leaves_open: LeavesOpen | None = None
    """Error that passes the check unseen, up to a size that depends on its limit and on the measurement."""

    @property
    def unit(self) -> str:
        """Unit of figure and limit; `1` for a plain number."""
        return self.kind.shown


SHARES = Range(0.0, 100.0)
EFFICIENCIES = Range(0.0, 150.0, beyond_least=True)
SAMPLE_COUNTS = Range(1.0, 100_000.0)
TEMPERATURES = Range(-40.0, 150.0)
TEMPERATURE_CHANGES = Range(0.0, 100.0, beyond_least=True)

CHECK_RATIO = (
    "compare the gear ratio in the recipe with the unit's type plate, then check range and gain of both torque sensors"
)
CHECK_SCALES = "check units and scale of angles and torques, then the stiffness in the recipe"

_ROWS = (
    Check(
        "record", "Record errors", NUMBER, 0.0,
        "number of errors in the record of the measurement",
        "the record of the measurement has errors",
        "measure again",
    ),
    Check(
        "missed_periods", "Scan overruns", FRACTION, 1.0,
        "share of control cycles (scans) that the computer missed; the limit is sampling.missed_periods of the recipe",
        "the computer missed control cycles (scans)",
        "close other programs on this computer and measure again",
    ),
    Check(
        "sample_age", "Age of samples", SCANS, 20.0,
        "age of the oldest torque or angle sample while measuring, in control cycles (scans); the limit is "
        "sampling.sample_age of the recipe",
        "a torque or angle sample was too old",
        "check the measuring amplifier and its network",
    ),
    Check(
        "torque_in_saturated", "Saturated samples of the input torque", SAMPLES, 0.0,
        "samples with the status: input torque out of range",
        "the input torque sensor was saturated",
        "check the measuring range of the input torque sensor",
    ),
    Check(
        "torque_out_saturated", "Saturated samples of the output torque", SAMPLES, 0.0,
        "samples with the status: output torque out of range",
        "the output torque sensor was saturated",
        "check the measuring range of the output torque sensor",
    ),
    Check(
        "not_ready", "Samples taken while the amplifier was not ready", SAMPLES, 0.0,
        "samples with the status: amplifier not ready",
        "the measuring amplifier reported that it was not ready",
        "check the supply of the measuring amplifier, wait until it has started, and measure again",
    ),
    Check(
        "torque_zeroes", "Zero offsets of the torque sensors after the run", FRACTION, 100.0,
        "change of a torque sensor's zero offset during the run, relative to the change that the bench file allows "
        "(tared_zero, at_rest)",
        "the zero offset of a torque sensor changed during the run",
        "check mounting, cable and temperature of the torque sensor, then measure again",
    ),
    Check(
        "points_per_bin", "Samples per torque bin", SAMPLES, 3.0,
        "smallest number of samples in one torque bin of a branch; each bin is 2 % of the reference torque wide",
        "too few samples per torque bin",
        "raise the sampling rate, or lower the torque rate of the cycles",
        at_least=True, settable=SAMPLE_COUNTS,
    ),
    Check(
        "angle_steps", "Resolution of the wind-up", FRACTION, 3.0,
        "smallest step between two values of the wind-up, relative to the whole wind-up",
        "the resolution of the angles is too coarse",
        "record the angles with more digits, or with a finer encoder",
    ),
    Check(
        "late_torque", "Delay at the ends of the ramps", FRACTION, 0.25,
        "torque error caused by the delay between torque and angle, where a ramp ends or the load reverses, relative "
        "to the reference torque",
        "torque and wind-up do not stop or reverse at the same time",
        "set the filters of torque and angles as the bench file states, or correct their lags in the bench file",
        explained_by="angle_steps", settable=SHARES,
    ),
    Check(
        "clipping", "Clipping", FRACTION, 1.0,
        "change of the wind-up while the torque stays exactly at its largest value, relative to the whole wind-up; or "
        "change of the torque while the angle of the loaded shaft stays constant, relative to the whole torque range",
        "the torque stays at its largest value while the unit still turns: the channel is saturated",
        "use a sensor or a range that covers the peak torque of the cycles",
        explained_by="angle_steps", settable=SHARES,
    ),
    Check(
        "wrong_way", "Energy of the loop", LOSS, 0.0,
        "smallest loop energy of all cycles; it must be positive",
        "the loop energy is not positive",
        "check the signs of torque and angle, and that loading and unloading branch are not exchanged",
        at_least=True,
    ),
    Check(
        "loop_closure", "Loop closure", FRACTION, 2.0,
        "difference in wind-up between start and end of a cycle at the same torque, relative to the whole wind-up",
        "the loop does not close: the unit, the lock or an encoder has moved",
        "check lock, couplings and encoder, and measure again",
        settable=SHARES,
    ),
    Check(
        "drift", "Drift", FRACTION, 1.0,
        "drift of the wind-up in a cycle, before its correction, relative to the whole wind-up",
        "the wind-up drifts over the cycle",
        "let unit and bench warm up, or raise the torque rate of the cycles",
        settable=SHARES,
    ),
    Check(
        "repeat", "Repeatability of the cycles", FRACTION, 2.0,
        "deviation of a cycle from the mean of all cycles (rms), relative to the whole wind-up",
        "the load cycles differ too much from each other",
        "condition the unit (recipe step fatigue_cycles), check the lock, and measure again",
        settable=SHARES,
    ),
    Check(
        "copied_cycles", "Copied cycles", FRACTION, 50.0,
        "share of the samples of a branch that are identical to the samples of another cycle. If the bench file gives "
        "the noise of a sensor: share of identical noise values",
        "cycles are copies of each other",
        "measure again: copies have no scatter, so they give no uncertainty",
    ),
    Check(
        "repeated_samples", "Repeated samples", FRACTION, 20.0,
        "share of the samples of a branch that are identical to the sample before, if the bench file gives the noise",
        "samples were recorded more than once",
        "record each sample once, not faster than the amplifier measures",
        settable=SHARES,
    ),
    Check(
        "lag", "Lag between torque and angle", FRACTION, 1.0,
        "change of the loop width caused by different lags of torque and angle, before their correction, relative to "
        "the whole wind-up",
        "the lags of torque and angle differ",
        "lower the torque rate of the cycles, set both channels to the same filter, or enter their lags in the bench "
        "file",
        settable=SHARES,
    ),
    Check(
        "noise_low", "Lowest noise of a torque sensor", FRACTION, 15.0,
        "smallest noise of a torque sensor in any 50 successive samples, relative to its specification",
        "the noise of a torque sensor is lower than its specification, at least for a while",
        "switch off filters behind the sensor: they narrow the loop. If the sensor is "
        "better than specified, correct its noise in the bench file",
        at_least=True,
    ),
    Check(
        "noise_high", "Highest noise of a torque sensor", FRACTION, 500.0,
        "noise of a torque sensor over all cycles, relative to its specification; the larger value of both sensors",
        "the noise of a torque sensor is higher than its specification",
        "check cables, earthing and the resolution of the torque channel",
    ),
    Check(
        "time_scale", "Time scale", NUMBER, 5.0,
        "measured torque rate of a branch divided by the planned rate, or planned divided by measured: the larger of "
        "the two",
        "the torque changes far faster or slower than the recipe plans",
        "check that the time column is in seconds, then the torque rates in the recipe",
    ),
    Check(
        "ramp_rate", "Ramp rate", FRACTION, 50.0,
        "deviation of the torque rate from a steady ramp, as exceeded in 10 % of a branch",
        "the torque does not rise or fall at a steady rate",
        "check the drive, or lower the torque rate of the cycles",
        settable=SHARES,
    ),
    Check(
        "interrupted", "Interrupted ramps", FRACTION, 3.0,
        "torque range of a branch that is left out because its ramp stopped or reversed, relative to the range between "
        "the turning points; of a run with any, U is stated with k = 3",
        "a ramp was interrupted",
        "find out what stopped the ramp (late samples, an overshoot, an alarm limit), and measure again",
        explained_by="angle_steps", settable=SHARES,
    ),
    Check(
        "monotone_loading", "Torque reversal within a branch", FRACTION, 5.0,
        "largest torque reversal within a branch, relative to the reference torque",
        "the torque reverses within a branch",
        "check drive and torque sensor, and the column segment of the measured data",
        settable=SHARES,
    ),
    Check(
        "torque_agreement", "Agreement of input and output torque", FRACTION, 60.0,
        "output torque divided by (gear ratio · input torque), under load: deviation from 1",
        "input and output torque do not agree",
        "check sign, range and calibration of both torque sensors, and the gear ratio in the recipe",
        settable=SHARES,
    ),
    Check(
        "efficiency_low", "Lowest efficiency", FRACTION, 50.0,
        "efficiency while loading: slope of output torque over input torque, divided by the gear ratio; the smaller "
        "value of both torque directions",
        "the output torque is too low for a unit of this gear ratio",
        CHECK_RATIO, at_least=True, settable=EFFICIENCIES, below="efficiency_high",
    ),
    Check(
        "efficiency_high", "Highest efficiency", FRACTION, 102.0,
        "efficiency while loading: slope of output torque over input torque, divided by the gear ratio; the larger "
        "value of both torque directions",
        "the output torque is too high for a unit of this gear ratio",
        CHECK_RATIO, settable=EFFICIENCIES,
    ),
    Check(
        "ratio_agreement", "Gear ratio from the torques", FRACTION, 0.25,
        "deviation of the gear ratio calculated from the torques (harmonic mean of the slopes of loading and "
        "unloading) from the ratio in the recipe, or between both torque directions. The part that sensor gains, "
        "friction and scatter can cause is subtracted",
        "the measured gear ratio differs from the gear ratio in the recipe",
        CHECK_RATIO, settable=SHARES, leaves_open=LeavesOpen("gain of the output torque, or ratio in the recipe", "%"),
    ),
    Check(
        "temperature_change", "Change of temperature", TEMPERATURE_CHANGE, 5.0,
        "change of the housing temperature during the measurement",
        "the housing temperature changed too much during the measurement",
        "let unit and bench warm up before measuring",
        settable=TEMPERATURE_CHANGES,
    ),
    Check(
        "temperature_low", "Lowest temperature", TEMPERATURE, 10.0,
        "lowest housing temperature",
        "the unit is too cold",
        "let the unit come to room temperature; check the temperature sensor",
        at_least=True, settable=TEMPERATURES, below="temperature_high",
    ),
    Check(
        "temperature_high", "Highest temperature", TEMPERATURE, 50.0,
        "highest housing temperature",
        "the unit is too hot",
        "let the unit cool down; check the temperature sensor",
        settable=TEMPERATURES,
    ),
    Check(
        "locked_angle", "Deflection of lock and couplings", NUMBER, 0.0,
        "number of unknown deflections (of lock and couplings) that the wind-up includes",
        "the angle of the locked shaft was not measured and the stiffness of the fixture is not known: their "
        "deflection is in the wind-up",
        "measure the angle of the locked shaft, or give the fixture's stiffness in the bench file",
    ),
    Check(
        "locked_motion", "Motion of the locked shaft", FRACTION, 2.0,
        "motion of the locked shaft that is more than the fixture deflection under its torque, relative to the whole "
        "wind-up",
        "the locked shaft moves",
        "check the lock, the encoder of the locked shaft, and that both angles were measured on this unit",
        explained_by="angle_steps", settable=SHARES,
    ),
    Check(
        "fixture_share", "Fixture deflection", FRACTION, 25.0,
        "fixture deflection that was subtracted, relative to the uncorrected wind-up",
        "the fixture deflection is too large",
        "check stiffness and curve of the fixture in the bench file, or clamp the unit more rigidly",
        settable=SHARES,
    ),
    Check(
        "stiffness_low", "Lowest stiffness against the catalogue", NUMBER, 0.5,
        "measured stiffness (between medium torques) divided by the stiffness in the recipe "
        "(unit_under_test.stiffness); the smaller value of both torque directions",
        "the measured stiffness is far below the stiffness in the recipe: no defect of a unit can cause that",
        CHECK_SCALES, at_least=True,
    ),
    Check(
        "stiffness_high", "Highest stiffness against the catalogue", NUMBER, 1.5,
        "measured stiffness (between medium torques) divided by the stiffness in the recipe "
        "(unit_under_test.stiffness); the larger value of both torque directions",
        "the measured stiffness is far above the stiffness in the recipe",
        CHECK_SCALES,
    ),
    Check(
        "loss", "Hysteresis loss", FRACTION, 1.0,
        "smallest loop energy of all cycles, relative to torque range times wind-up range",
        "the hysteresis loss is too small for a reducer: loading and unloading branch are nearly the same curve",
        "check that loading and unloading were both measured. Then check the filters and lags of torque and angle",
        at_least=True, settable=SHARES,
    ),
    Check(
        "width_growth", "Growth of the loop width with the load", FRACTION, 10.0,
        "growth of the loop width from 30 % to 70 % of the peak torque, relative to the width at 30 %; the larger "
        "value of both torque directions",
        "the loop gets wider towards its turning points, which friction cannot cause: the wind-up moves back "
        "against the torque, or an angle is wrong",
        "let unit and bench come to rest before measuring, check lock, couplings and encoders, and measure again",
        explained_by="angle_steps", settable=SHARES,
    ),
    Check(
        "creep_back", "Wind-up moving back while the torque is held", FRACTION, 0.5,
        "speed of the wind-up against the direction of the torque while the torque is held (dwells), times the "
        "duration of a branch, relative to the whole wind-up",
        "the wind-up moves back while the torque is held; a reducer can only move in the direction of the torque",
        "check that the lock does not slip and that couplings and encoders are tight. Let unit and bench reach one "
        "temperature. Then measure again",
        explained_by="angle_steps", settable=SHARES,
    ),
    Check(
        "angle_waves", "Periodic error of an angle", FRACTION, 0.1,
        "amplitude of a periodic angle error in loading branches, relative to the whole wind-up. Noise, rounding and "
        "the encoder errors in the bench file are subtracted",
        "an angle has an error that repeats while the encoder turns",
        "check mounting, coupling and electrical adjustment of the encoders, and measure again",
        explained_by="angle_steps", settable=SHARES,
        leaves_open=LeavesOpen("fast wave of the loaded shaft's encoder, at that shaft", "arcmin"),
    ),
    Check(
        "calibrated_turn", "Turning points of the torque ratio's calibration", FRACTION, 0.4,
        "difference in input torque between the turning points of the cycles and those of the torque ratio's "
        "calibration; only if the output torque is calculated from the input torque",
        "the load cycles and the calibration of the torque ratio reverse at different torques",
        "calibrate the torque ratio again, up to the peak torque of the cycles",
        settable=SHARES,
    ),
    Check(
        "calibrated_gap", "Gap in the torque ratio's calibration", FRACTION, 1.0,
        "largest torque range without a sample in the calibration of the torque ratio, relative to the reference "
        "torque; only if the output torque is calculated from the input torque",
        "the calibration of the torque ratio has no samples in a torque range",
        "calibrate the torque ratio again, slower or with a higher sampling rate",
        settable=SHARES,
    ),
    Check(
        "calibrated_zero", "Zero offset found by the torque ratio's calibration", FRACTION, 95.0,
        "zero offset of the output torque that the calibration of the torque ratio found, relative to the range in "
        "which it is searched; only if the output torque is calculated from the input torque",
        "the zero offset of the output torque was not found",
        "tare the output torque sensor at rest and without load, and calibrate the torque ratio again",
    ),
    Check(
        "calibration_agreement", "Agreement of calibration and measured cycles", FRACTION, 0.25,
        "gear ratio calculated from the torques of the calibration (harmonic mean of the slopes of loading and "
        "unloading): deviation from that of the measured cycles; the larger value of both torque directions. The part "
        "that the scatter of the lines can cause is subtracted",
        "the torques of the calibration and of the measured cycles do not agree",
        "measure again. If it comes back, check gain, cable and mounting of both torque sensors, and raise the torque "
        "rate of calibration and cycles: at a low rate friction can change within a ramp",
        settable=SHARES,
    ),
    Check(
        "calibration_torque", "Torques of calibration and measured cycles", FRACTION, 0.4,
        "output torque in the calibration: largest deviation from that of the measured cycles at the same input "
        "torque, averaged over ranges of 10 % of the calibration's peak torque and relative to it. The part that "
        "scatter, or a change of friction, can cause is subtracted. The limit holds at half of the peak torque; at no "
        "load a quarter of it is allowed, and in between and beyond in proportion",
        "the torques of the calibration and of the measured cycles do not agree",
        "measure again. If it comes back, check cable, mounting and zero offset of both torque sensors, and raise the "
        "torque rate of calibration and cycles: at a low rate friction can change within a ramp",
        settable=SHARES, explained_by="calibration_agreement",
    ),
    Check(
        "torque_out_zero", "Zero offset of the output torque", FRACTION, 0.5,
        "zero offset of the output torque sensor, less the offset that the bench file allows (tared_zero), relative "
        "to the reference torque. It is measured where the lines of output torque over input torque for loading and "
        "unloading cross. Half of the difference between falling and rising torque counts as well, less the "
        "reversibility of the bench file and less what the friction of the unit can cause",
        "the output torque sensor does not read zero without load",
        "tare the output torque sensor at rest and without load, and check its zero; then measure again",
        settable=SHARES, leaves_open=LeavesOpen("hysteresis of the output torque sensor, alike at every load", "N·m"),
    ),
    Check(
        "torque_lines", "Residual of the torque ratio", FRACTION, 0.5,
        "deviation (rms) of output torque over input torque from a straight line while loading, relative to the "
        "reference torque",
        "output torque over input torque is not a straight line",
        "check range, linearity and filters of both torque channels",
        settable=SHARES,
    ),
    Check(
        "torque_bend", "Curvature of the torque ratio", FRACTION, 1.0,
        "change with the load of the slope of output torque over input torque, while loading. The part that the "
        "sensor gains in the bench file and the scatter of the points can cause is subtracted",
        "a torque channel is not linear: its gain changes with the load",
        "calibrate both torque channels over their range, and check their mounting for side loads",
        settable=SHARES, leaves_open=LeavesOpen("hysteresis of the output torque sensor at mid-range", "N·m"),
    ),
    Check(
        "drive_torque_agreement", "Agreement of drive torque and sensor torque", FRACTION, 10.0,
        "torque that the drive reports, divided by the torque of the sensor: deviation from 1",
        "the torque that the drive reports and the torque sensor of the loaded shaft do not agree",
        "check gain and calibration of both torque sensors, then the drive's rated torque and gear ratio",
        settable=SHARES, leaves_open=LeavesOpen("gain of both torques alike", "%"),
    ),
    Check(
        "drive_torque_gap", "Hysteresis between drive torque and sensor torque", FRACTION, 1.0,
        "deviation between drive torque and sensor torque on the loaded shaft: rising branch minus falling branch, "
        "relative to the torque between the turning points",
        "the torque sensor lags behind the drive, or friction lies between them",
        "set the filters of both torque channels as the bench file states, then measure again with a lower torque "
        "rate",
        settable=SHARES, leaves_open=LeavesOpen("delay of both torques within a ramp, as torque at mid-range", "N·m"),
    ),
    Check(
        "drive_angle_agreement", "Agreement of drive and angle encoder", FRACTION, 2.0,
        "deviation between drive position and encoder angle of the loaded shaft: its change within a branch, relative "
        "to the travel of the shaft. A constant delay is subtracted",
        "the drive's position and the angle of the loaded shaft do not agree",
        "check line count, scale and mounting of the encoder, then the drive's gear ratio and couplings",
        settable=SHARES,
        leaves_open=LeavesOpen("slower wave or scale of the loaded shaft's encoder, at that shaft", "arcmin"),
    ),
    Check(
        "drive_angle_direction", "Delay of the angle encoder within a ramp", FRACTION, 0.25,
        "deviation between drive position and encoder angle of the loaded shaft: rising branch minus falling branch at "
        "the same angle, relative to the travel of the shaft. A constant delay and the twist of the coupling are "
        "subtracted",
        "the angle of the loaded shaft is delayed in a part of the ramps",
        "check filter and supply of the encoder. Check the coupling between drive and encoder for play. Then measure "
        "again",
        settable=SHARES,
        leaves_open=LeavesOpen("delay of the loaded shaft's angle within a ramp, at the output", "arcmin"),
    ),
    Check(
        "drive_angle_repeat", "Delay of the angle encoder between branches", FRACTION, 0.15,
        "deviation between drive position and encoder angle of the loaded shaft: difference between two branches of "
        "the same direction at the same angle, relative to the travel of the shaft",
        "the delay between drive and angle encoder differs from branch to branch",
        "check cable, supply and filter of the encoder, and measure again",
        settable=SHARES,
    ),
    Check(
        "locked_compliance", "Fixture compliance", FRACTION, 30.0,
        "measured fixture compliance, relative to the compliance in the bench file",
        "the measured fixture compliance is too small for the fixture in the bench file",
        "check the encoder of the locked shaft, its sign, and the stiffness of the fixture in the bench file",
        at_least=True, settable=SHARES,
    ),
)  # fmt: skip

CHECKS: dict[str, Check] = {row.id: row for row in _ROWS}
"""All validity checks by id."""
