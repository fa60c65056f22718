"""Validity gates: whether a measurement may be judged at all, apart from what its metrics say.

A gate is a row of `GATES`: what it looks at, its figure, the limit, and what to do when it fails. `gates` judges them.
"""

from __future__ import annotations

from typing import NamedTuple

from analysis import (
    calibration_gates,
    cycle_gates,
    drive_gates,
    fixture_gates,
    loop_gates,
    noise_gates,
    ramp_end_gates,
    record_gates,
    torque_gates,
)
from analysis import gate_figures as figures
from analysis.reading import Figure

CHECK_RATIO = "compare the ratio in the recipe with the unit's plate, then check range and gain of both torque sensors"
CHECK_SCALES = "check units and scale of angles and torques, then the stiffness in the recipe"


class Gate(NamedTuple):
    """One gate: what it looks at, unit, limit and its sense, figure, words when failed, what to do."""

    what: str
    unit: str
    limit: float
    least: bool
    """The limit is the least value allowed, otherwise the largest."""
    figure: Figure
    failed: str
    """What is wrong, unless the figure has words of its own."""
    action: str
    configurable: bool


def _row(  # noqa: PLR0917 - the columns of the table
    what: str,
    unit: str,
    limit: float,
    figure: Figure,
    failed: str,
    action: str,
    *,
    least: bool = False,
    configurable: bool = True,
) -> Gate:
    return Gate(what, unit, limit, least, figure, failed, action, configurable)


GATES: dict[str, Gate] = {
    "record": _row(
        "objections against the record as a whole", "1", 0.0, record_gates.objections,
        "the record does not count", "measure again", configurable=False,
    ),
    "missed_periods": _row(
        "scan periods that were missed (limit: sampling.missed_periods)", "%", 1.0, record_gates.missed_periods,
        "scan periods were missed", "close other programs on this computer and measure again", configurable=False,
    ),
    "sample_age": _row(
        "age of the oldest sample while measuring (limit: sampling.sample_age)", "scans", 20.0, record_gates.sample_age,
        "a sample was too old", "check the measuring amplifier and its network", configurable=False,
    ),
    "torque_in_saturated": _row(
        "samples whose status says that the input torque was beyond its range", "samples", 0.0,
        record_gates.torque_in_saturated,
        "the input torque sensor was saturated", "check its range", configurable=False,
    ),
    "torque_out_saturated": _row(
        "samples whose status says that the output torque was beyond its range", "samples", 0.0,
        record_gates.torque_out_saturated,
        "the output torque sensor was saturated", "check its range", configurable=False,
    ),
    "not_ready": _row(
        "samples whose status says that the amplifier was not ready", "samples", 0.0, record_gates.not_ready,
        "the measuring amplifier said that it was not ready", "check its supply and its start-up, and measure again",
        configurable=False,
    ),
    "clipping": _row(
        "wind-up in which the torque stands exactly at its largest value, of the whole wind-up, or torque in which the "
        "angle of the loaded shaft stands, of the whole torque",
        "%", 1.0, figures.clipping,
        "the torque stands at its largest value while the unit is still turned: its channel is saturated",
        "choose a sensor or a range that reaches further than the cycles",
    ),
    "wrong_way": _row(
        "energy of the cycle that loses least: a loop gains none", "N·m·arcmin", 0.0, cycle_gates.wrong_way,
        "the loop gains energy", "torque or angle has the wrong sign, or the branches are exchanged", least=True,
        configurable=False,
    ),
    "loop_closure": _row(
        "wind-up between start and end of a cycle at the same torque, of the whole wind-up", "%", 2.0,
        cycle_gates.loop_closure,
        "the loop does not close: the unit, its lock or an angle has moved",
        "check lock, couplings and encoder, and measure again",
    ),
    "drift": _row(
        "drift of the wind-up in a cycle, corrected or not, of the whole wind-up", "%", 1.0, cycle_gates.drift,
        "the wind-up drifts", "let unit and bench warm up, or load faster",
    ),
    "repeat": _row(
        "deviation of a cycle from the mean of all cycles (rms), of the whole wind-up", "%", 2.0, cycle_gates.repeat,
        "the cycles do not repeat", "condition the unit by fatigue cycles, check the lock, and measure again",
    ),
    "copied_cycles": _row(
        "samples of a branch that another cycle has bit by bit in the same place, where noise is declared", "%", 50.0,
        cycle_gates.copied_cycles,
        "cycles are copies of each other", "measure again: a copy has no scatter, and shows nothing of how sure the "
        "values are", configurable=False,
    ),
    "repeated_samples": _row(
        "samples of a branch that are bit by bit the one before in torques and angles, where noise is declared",
        "%", 20.0, cycle_gates.repeated_samples,
        "samples are written more than once", "record each sample once, not faster than the amplifier gives them",
    ),
    "lag": _row(
        "change of the loop's width by torque and angle lagging differently, corrected or not, of the whole wind-up",
        "%", 1.0, figures.lag,
        "torque and angle lag differently",
        "load slower, set both channels to the same filter, or name the bench that knows them",
    ),
    "late_torque": _row(
        "torque by which a ramp runs on while the output torque is late or early behind the wind-up, by the ends of "
        "the ramps, of the reference torque",
        "%", 0.25, ramp_end_gates.late_torque,
        "torque and wind-up do not come to rest together at the ends of the ramps",
        "set the filters of torque and angles as in the bench file, or give their lags there",
    ),
    "noise_low": _row(
        "noise of a torque in the quietest 50 samples of the cycles over that declared of its sensor", "%", 33.0,
        noise_gates.noise_low,
        "the torque has less noise than its sensor, at least for a while",
        "measure without a filter behind the sensor, which takes from the play of the loop; where the sensor is better "
        "than the bench file says, mend its noise there", least=True, configurable=False,
    ),
    "noise_high": _row(
        "noise of a torque in all cycles over that declared of its sensor; the noisier one", "%", 300.0,
        noise_gates.noise_high,
        "the torque has more noise than its sensor", "check cables, earthing and the resolution of the channel",
        configurable=False,
    ),
    "ramp_rate": _row(
        "deviation from the steady rate that nine tenths of a branch stay within", "%", 50.0, figures.ramp_rate,
        "the load does not follow a steady ramp", "check the drive, or load slower",
    ),
    "points_per_bin": _row(
        "fewest samples of a branch in a bin of 2 % of the reference torque", "samples", 3.0, figures.points_per_bin,
        "too few samples for the torque that they cover", "sample faster or load slower", least=True,
    ),
    "monotone_loading": _row(
        "largest way that the torque goes back within a branch, of the reference torque", "%", 5.0,
        figures.monotone_loading,
        "the torque goes back within a branch", "check drive and torque sensor, and the segments of the trace",
    ),
    "torque_agreement": _row(
        "deviation of T_out / (ratio · T_in) under load from 1", "%", 60.0, torque_gates.torque_agreement,
        "input and output torque do not belong together",
        "check sign, range and calibration of both sensors, and the ratio in the recipe",
    ),
    "efficiency_low": _row(
        "efficiency while loading, slope of T_out over T_in over the ratio; the lower side", "%", 50.0,
        torque_gates.efficiency_low,
        "less torque arrives at the output than a unit of this ratio lets through", CHECK_RATIO, least=True,
    ),
    "efficiency_high": _row(
        "efficiency while loading, slope of T_out over T_in over the ratio; the higher side", "%", 102.0,
        torque_gates.efficiency_high,
        "more torque arrives at the output than a unit of this ratio can give", CHECK_RATIO,
    ),
    "ratio_agreement": _row(
        "deviation of the ratio that the torques show (harmonic mean of the slopes of loading and unloading) from that "
        "of the recipe",
        "%", 5.0, torque_gates.ratio_agreement,
        "the torques show another ratio than the recipe says", CHECK_RATIO,
    ),
    "temperature_change": _row(
        "range of the housing temperature", "K", 5.0, figures.temperature_change,
        "the housing changes its temperature", "let unit and bench warm up before measuring",
    ),
    "temperature_low": _row(
        "lowest housing temperature", "degC", 10.0, figures.temperature_low,
        "the unit is too cold", "let it come to room temperature; check the sensor", least=True,
    ),
    "temperature_high": _row(
        "highest housing temperature", "degC", 50.0, figures.temperature_high,
        "the unit is too hot", "let it cool down; check the sensor",
    ),
    "locked_angle": _row(
        "deflections of lock and couplings that are in the wind-up and not known", "1", 0.0, fixture_gates.locked_angle,
        "the angle of the locked shaft was not measured and the stiffness of the fixture is not known: their "
        "deflection is in the wind-up",
        "measure that angle, or name a bench with its fixture", configurable=False,
    ),
    "locked_motion": _row(
        "motion of the locked shaft that its torque does not explain, of the whole wind-up", "%", 2.0,
        fixture_gates.locked_motion,
        "the locked shaft moves", "check the lock, its encoder, and that both angles belong to this unit",
    ),
    "fixture_share": _row(
        "deflection of the fixture that is taken from the wind-up, of the wind-up with it", "%", 25.0,
        fixture_gates.fixture_share,
        "most of what is judged would be what the fixture leaves",
        "check stiffness and curve of the fixture in the bench file, or clamp the unit stiffer",
    ),
    "stiffness_low": _row(
        "stiffness of the loop (secant in the middle of each side) over unit_under_test.stiffness of the recipe; the "
        "softer side",
        "1", 0.5, loop_gates.stiffness_low,
        "the loop is softer than the recipe declares this unit, by more than any defect", CHECK_SCALES, least=True,
        configurable=False,
    ),
    "stiffness_high": _row(
        "stiffness of the loop (secant in the middle of each side) over unit_under_test.stiffness of the recipe; the "
        "stiffer side",
        "1", 1.5, loop_gates.stiffness_high,
        "the loop is stiffer than any unit of this kind", CHECK_SCALES, configurable=False,
    ),
    "loss": _row(
        "energy of the cycle that loses least, of the rectangle of torque and wind-up around its loop", "%", 1.0,
        loop_gates.loss,
        "the loop loses less than the friction of a reducer: rising and falling branch are nearly one curve",
        "check that both branches were measured, and the lag of torque against angle", least=True,
    ),
    "calibrated_turn": _row(
        "deviation of the input torque at the turns of the cycles from that at the turns of the calibration, where it "
        "converts the torque",
        "%", 0.4, calibration_gates.calibrated_turn,
        "cycles and calibration turn at different torques", "calibrate to the peak torque of the cycles",
    ),
    "calibrated_gap": _row(
        "largest torque without a sample in a branch of the calibration, of the reference torque, where it converts "
        "the torque",
        "%", 1.0, calibration_gates.calibrated_gap,
        "the calibration has a gap", "calibrate again, slower or with a higher sampling rate",
    ),
    "calibrated_zero": _row(
        "output torque at which the calibration finds no load, of the largest that is sought, where it converts the "
        "torque",
        "%", 95.0, calibration_gates.calibrated_zero,
        "the zero of the output torque was not found",
        "tare the output torque sensor at rest and without load, and calibrate again", configurable=False,
    ),
    "torque_out_zero": _row(
        "output torque at which the lines of loading and unloading meet, beyond the declared zero of its sensor "
        "(tared_zero), of the reference torque",
        "%", 0.5, torque_gates.torque_out_zero,
        "the output torque sensor does not read zero where no torque is",
        "tare it at rest and without load, and check its zero; then measure again",
    ),
    "torque_lines": _row(
        "what a straight line of T_out over T_in leaves of the loading branches (rms), of the reference torque", "%",
        0.5, torque_gates.torque_lines,
        "the torques of both shafts leave their straight lines",
        "check both torque channels for range, linearity and filters that lag",
    ),
    "drive_torque_agreement": _row(
        "deviation of the torque that the drive reports over that of the loaded shaft's sensor from 1", "%", 10.0,
        drive_gates.drive_torque_agreement,
        "drive and torque sensor of the loaded shaft do not agree",
        "check gain and calibration of both torque sensors, then the drive's rated torque and gear ratio",
    ),
    "drive_torque_gap": _row(
        "drive's torque less that of the loaded shaft's sensor, rising against falling branch, of the torque between "
        "the turning points",
        "%", 1.0, drive_gates.drive_torque_gap,
        "the torque sensor lags behind the drive, or friction lies between them",
        "set the filters of both torque channels as in the bench file, or load slower and see whether it stays",
    ),
    "locked_compliance": _row(
        "motion of the locked shaft with its torque, of what the declared fixture gives way by", "%", 30.0,
        fixture_gates.locked_compliance,
        "the locked shaft does not give way as its fixture does",
        "check the encoder of the locked shaft, its sign, and the stiffness of the fixture in the bench file",
        least=True,
    ),
}  # fmt: skip
"""All gates by id."""
