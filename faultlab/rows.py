"""The rows of the fault matrix: what is injected, in which states, and the bound that its reaction must keep."""

from __future__ import annotations

from typing import NamedTuple

STATES = ("home", "lock", "calibrate", "ramp_pos", "reverse", "ramp_neg", "unload", "release")
LOADED = ("calibrate", "ramp_pos", "reverse", "ramp_neg")
LOCKED = ("lock", *LOADED, "unload")
BEFORE_RELEASE = ("home", *LOCKED)

AFTER_SCANS: dict[str, int] = {
    "home": 10, "lock": 300, "calibrate": 400, "ramp_pos": 300, "reverse": 20, "ramp_neg": 300, "unload": 100,
    "release": 20,
}  # fmt: skip
"""Scans after the entry into a state at which a fault starts: in the middle of what the state does."""

RUN = 40_000
"""Scans: longer than any run; for faults that show only when the run comes to where they matter."""


REST_SHARE_OF_RATED = 0.08
"""What friction may keep in a unit whose drive was switched off; it is unwound during the recovery."""

IN_THE_RESULT = "the controller does not notice this fault: the metrics show it"
CLOSED_LOOP = "the torque control compensates for this fault"
DRIVE_STOPS = ("drive_fault", "drive_emergency", "drive_dropped_out")
"""The drive's own protection acts and says so."""

GARBAGE = (
    "sensor_not_a_number", "sensor_saturated", "sample_not_ready", "torque_out_trip", "torque_in_trip", "over_travel",
    "overspeed", "lock_slip",
)  # fmt: skip
"""What chance in the registers may show as first."""


class Row(NamedTuple):
    """Row of the matrix.

    `causes`: fault ids that may come first, none when the run must go on to its end as if nothing had happened.
    `detect_scans`: from the fault's first effect to the alarm. `torque_s`: from the alarm until the torque in the
    reducer is low for good. `wires`: the state in which the row is run over wires as well. `rest`: share of rated
    torque that may be left for good. `note`: why a run that goes on is right.
    """

    target: str
    verb: str
    value: float | None
    causes: tuple[str, ...]
    detect_scans: int
    torque_s: float = 1.0
    states: tuple[str, ...] = STATES
    for_ms: float | None = None
    wires: str = ""
    rest: float = REST_SHARE_OF_RATED
    note: str = ""

    @property
    def name(self) -> str:
        """What the row is called: target, verb, value, duration."""
        value = "" if self.value is None else f" {self.value:g}"
        return f"{self.target} {self.verb}{value}" + ("" if self.for_ms is None else f" for {self.for_ms:g} ms")


UNLOADING_S = 4.0
"""A controlled unload from the peak, friction crossed several times."""

# fmt: off
ROWS: tuple[Row, ...] = (
    # CAN: heartbeat period 20 ms, time-out 100 ms; process data time-out 20 ms
    Row("can.drive.heartbeat", "off", None, ("drive_heartbeat_lost",), 122, states=BEFORE_RELEASE, wires="ramp_pos"),
    Row("can.drive.tpdo1", "off", None, ("drive_data_stale",), 22, wires="calibrate"),
    Row("can.drive.tpdo1", "drop", 0.2, (), 0),
    Row("can.drive.tpdo1", "drop_next", 15, (), 0),
    Row("can.drive.tpdo1", "drop_next", 35, ("drive_data_stale",), 22, wires="ramp_pos"),
    Row("can.drive.tpdo1", "delay", 35, ("drive_data_stale",), 22, wires="calibrate"),
    Row("can.drive.tpdo1", "duplicate", None, (), 0),
    Row("can.drive.node", "reset", None, ("drive_data_stale",), 12, wires="ramp_pos"),
    # drive
    Row("drive.statusword", "stuck", None, ("drive_enable_timeout", "unload_failed", "homing_failed"), RUN),
    Row("drive.mode", "refuse", None, ("drive_mode_refused", "drive_enable_timeout"), 2100, states=BEFORE_RELEASE,
        wires="calibrate"),
    Row("drive.internal_limit", "raise", None, ("drive_internal_limit",), 700, UNLOADING_S, states=BEFORE_RELEASE),
    Row("drive.torque", "scale", 10, (), 0, states=LOCKED),
    Row("drive.state", "drop", None, ("drive_dropped_out", "drive_enable_timeout"), 2200, states=BEFORE_RELEASE,
        wires="calibrate"),
    Row("drive.emcy", "raise", 0x2310, ("drive_fault",), 2, wires="ramp_pos"),
    Row("drive.emcy", "storm", 0x8130, ("drive_emergency",), 2, wires="calibrate"),
    # Modbus: amplifier time-out 20 ms, brake and remote I/O 100 ms
    Row("modbus.amplifier", "off", None, ("amplifier_lost",), 2, wires="ramp_pos"),
    Row("modbus.brake", "off", None, ("brake_link_lost",), 12, UNLOADING_S, wires="calibrate"),
    Row("modbus.remote_io", "off", None, ("remote_io_lost",), 12),
    Row("modbus.amplifier", "exception", None, ("amplifier_lost",), 2, wires="calibrate"),
    Row("modbus.brake", "exception", None, ("brake_link_lost",), 12, UNLOADING_S),
    Row("modbus.remote_io", "exception", None, ("remote_io_lost",), 12),
    Row("modbus.amplifier", "silence", None, ("sample_stale",), 22, wires="calibrate"),
    Row("modbus.brake", "silence", None, ("brake_link_lost",), 112, UNLOADING_S),
    Row("modbus.remote_io", "silence", None, ("remote_io_lost",), 112, states=BEFORE_RELEASE, wires="calibrate"),
    # one more answer may come, up to 35 ms after the fault began: the samples age from there
    Row("modbus.amplifier", "slow", 35, ("sample_stale",), 58),
    Row("modbus.amplifier", "slow", 14, ("sample_late",), 700, states=LOADED, for_ms=50),
    Row("modbus.brake", "slow", 300, ("brake_link_lost",), 312, UNLOADING_S),
    Row("modbus.remote_io", "slow", 300, ("remote_io_lost",), 312, states=BEFORE_RELEASE),
    Row("modbus.amplifier", "freeze", None, ("sample_frozen", "sample_stale"), 24, wires="calibrate"),
    Row("modbus.brake", "freeze", None, ("brake_link_lost",), 112, UNLOADING_S, wires="calibrate"),
    # sensors
    Row("sensor.torque_in", "stuck", None, ("torque_channels_disagree", "lock_unproven"), 6000,
        states=("home", "lock", "reverse", "ramp_neg")),
    Row("sensor.torque_out", "stuck", None, (
        "torque_channels_disagree", "torque_in_trip", "lock_unproven", "target_not_reached", "unload_failed",
        "drive_internal_limit"), 20_000, states=BEFORE_RELEASE),
    Row("sensor.torque_in", "offset", 6, ("torque_in_trip",), 3, wires="calibrate"),
    Row("sensor.torque_out", "offset", 600, ("torque_out_trip", "sensor_saturated"), 3),
    Row("sensor.torque_out", "drift", 200, (
        "torque_channels_disagree", "torque_out_alarm", "torque_out_trip", "tare_unsteady", "tare_out_of_range",
        "lock_unproven", "unload_failed", "target_not_reached"), 8000, UNLOADING_S),
    Row("sensor.torque_in", "spike", 10, ("torque_in_trip",), 3),
    Row("sensor.torque_out", "spike", 900, ("torque_out_trip",), 3),
    Row("sensor.torque_out", "saturate", None, ("sensor_saturated",), 5),
    Row("sensor.torque_out", "nan", None, ("sensor_not_a_number",), 2),
    Row("sensor.angle_in", "nan", None, ("sensor_not_a_number",), 2),
    Row("sensor.torque_out", "flip", None, (
        "torque_channels_disagree", "torque_in_trip", "torque_out_trip", "lock_unproven", "drive_internal_limit",
        "unload_failed", "target_not_reached", "over_travel"), 8000, UNLOADING_S, states=BEFORE_RELEASE),
    Row("sensor.angle_out", "offset", 0.01, ("lock_slip",), 5, UNLOADING_S, states=LOADED),
    Row("sensor.angle_in", "offset", 2.0, ("over_travel",), 3, states=LOCKED),
    # mechanics
    Row("lock", "slip", 0.02, ("lock_slip", "lock_unproven", "overspeed", "over_travel"), 8000, UNLOADING_S,
        states=("home", "lock", *LOADED), wires="ramp_pos"),
    Row("brake.current", "fade", 0.5, ("brake_current_lost", "lock_not_closed"), 3200, UNLOADING_S,
        states=BEFORE_RELEASE),
    Row("coupling", "break", None, (
        "overspeed", "over_travel", "lock_unproven", "target_not_reached", "torque_channels_disagree",
        "drive_internal_limit"), 15_000, states=("home", "lock", *LOADED)),
    # people, surroundings, computer
    Row("io.estop", "trip", None, ("estop", "drive_dropped_out"), 12, wires="ramp_pos"),
    Row("io.guard", "open", None, ("guard_open",), 12, wires="calibrate"),
    Row("io.enabling_device", "press", None, (), 0, states=("ramp_pos",), note="a run does not listen to it"),
    Row("io.housing_temp", "offset", 60, ("housing_temperature",), 32, UNLOADING_S),
    Row("scan.overrun", "miss", 45, ("missed_periods",), 3, UNLOADING_S),
    Row("scan.overrun", "miss", 20, (), 0),
    # the rest of the vocabulary, in the order of the parts; rows above are taken first where one is wanted
    Row("can.drive.heartbeat", "drop", 0.3, (), 0, states=("ramp_pos",)),
    Row("can.drive.tpdo1", "jitter", 3, (), 0, states=LOADED, wires="ramp_pos"),
    Row("can.drive.tpdo1", "reorder", None, (), 0, states=LOADED, wires="calibrate"),
    Row("can.drive.tpdo1", "truncate", 1, ("drive_data_stale",), 22, wires="ramp_pos"),
    Row("can.drive.tpdo1", "corrupt", None, ("drive_dropped_out",), 4, states=LOCKED, wires="calibrate"),
    Row("can.drive.tpdo1", "stuck", None, ("unload_failed",), RUN, states=LOADED),
    Row("can.drive.tpdo2", "off", None, ("drive_data_stale",), 22, states=LOADED, wires="calibrate"),
    Row("can.drive.tpdo2", "drop", 0.2, (), 0, states=("ramp_pos",)),
    Row("can.sync", "off", None, ("drive_data_stale",), 22, states=LOADED, wires="ramp_pos"),
    Row("can.sync", "drop", 0.2, (), 0, states=("ramp_pos",)),
    Row("can.setpoint", "off", None, DRIVE_STOPS, 60, states=LOADED, wires="ramp_pos"),
    Row("can.setpoint", "drop", 0.2, (), 0, states=("ramp_pos",)),
    Row("can.setpoint", "drop_next", 5, (), 0, states=("ramp_pos",)),
    Row("can.controller.heartbeat", "off", None, DRIVE_STOPS, 130, states=LOADED, wires="ramp_pos"),
    Row("can.controller.heartbeat", "drop", 0.2, (), 0, states=("ramp_pos",)),
    Row("can.bus", "off", None, ("drive_data_stale",), 22, states=LOADED, wires="ramp_pos"),
    Row("can.bus", "cut", None, ("can_lost",), 3, states=LOADED, wires="ramp_pos"),
    Row("can.bus", "command", None, ("other_controller",), 3, states=LOADED, wires="ramp_pos"),
    Row("can.bus", "errors", 5, (), 0, states=(), wires="calibrate"),
    Row("can.bus", "babble", 20, (), 0, states=(), wires="calibrate"),
    Row("clock", "step", 3600, (), 0, states=(), wires="calibrate"),
    Row("drive.controlword", "ignore", None, ("drive_enable_timeout", "unload_failed"), RUN),
    Row("drive.setpoint", "ignore", None, ("drive_not_following",), 22, states=LOADED, wires="ramp_pos"),
    Row("drive.setpoint", "scale", 3, ("drive_internal_limit",), 700, UNLOADING_S, states=("reverse", "ramp_neg")),
    Row("drive.setpoint", "scale", 2, (), 0, states=("calibrate", "ramp_pos"), note=CLOSED_LOOP),
    Row("drive.setpoint", "scale", 0.3, ("target_not_reached",), 20_000, 5.0, states=LOADED),
    Row("drive.mode", "stuck", None, ("drive_enable_timeout",), RUN, states=("home",)),
    Row("modbus.remote_io", "freeze", None, ("remote_io_lost",), 112, states=BEFORE_RELEASE, wires="calibrate"),
    Row("modbus.amplifier", "reset", None, ("amplifier_lost",), 2, states=LOADED, wires="calibrate"),
    Row("modbus.brake", "reset", None, ("brake_link_lost",), 12, UNLOADING_S, states=LOADED),
    Row("modbus.remote_io", "reset", None, ("remote_io_lost",), 12, states=LOADED),
    Row("modbus.amplifier", "truncate", None, ("sample_stale",), 22, states=LOADED, wires="calibrate"),
    Row("modbus.brake", "truncate", None, ("brake_link_lost",), 112, UNLOADING_S, states=LOADED),
    Row("modbus.remote_io", "truncate", None, ("remote_io_lost",), 112, states=LOADED),
    Row("modbus.amplifier", "wrong_id", None, ("sample_stale",), 22, states=LOADED, wires="calibrate"),
    Row("modbus.brake", "wrong_id", None, ("brake_link_lost",), 112, UNLOADING_S, states=LOADED),
    Row("modbus.remote_io", "wrong_id", None, ("remote_io_lost",), 112, states=LOADED),
    Row("modbus.amplifier", "wrong_unit", None, ("sample_stale",), 22, states=LOADED, wires="calibrate"),
    Row("modbus.brake", "wrong_unit", None, ("brake_link_lost",), 112, UNLOADING_S, states=LOADED),
    Row("modbus.remote_io", "wrong_unit", None, ("remote_io_lost",), 112, states=LOADED),
    Row("modbus.amplifier", "split", None, (), 0, states=(), wires="calibrate"),
    Row("modbus.amplifier", "jitter", 30, ("sample_stale", "sample_late"), 700, states=(), wires="calibrate"),
    Row("modbus.amplifier", "garbage", None, GARBAGE, 4, states=(), wires="calibrate"),
    Row("modbus.amplifier", "swap", None, GARBAGE, 30, states=(), wires="calibrate"),
    Row("modbus.amplifier.torque_out_nm", "freeze", None, ("torque_channels_disagree", "torque_in_trip"), 6000,
        states=(), wires="calibrate"),
    Row("modbus.amplifier.sample_counter", "freeze", None, ("sample_frozen", "sample_stale"), 24, states=(),
        wires="calibrate"),
    Row("modbus.brake.brake_current_a", "freeze", None, ("brake_stays_closed", "lock_not_closed"), RUN, states=(),
        wires="home"),
    Row("modbus.brake.life_counter", "freeze", None, ("brake_link_lost",), 112, UNLOADING_S, states=(),
        wires="ramp_pos"),
    Row("modbus.remote_io.life_counter", "freeze", None, ("remote_io_lost",), 112, states=(), wires="calibrate"),
    Row("sensor.torque_in", "scale", 2, ("torque_channels_disagree",), 3000, states=LOADED),
    Row("sensor.torque_out", "scale", 2, ("torque_channels_disagree",), 600, states=("reverse", "ramp_neg")),
    Row("sensor.torque_out", "scale", 1.5, (), 0, states=("calibrate", "ramp_pos"), note=IN_THE_RESULT),
    Row("sensor.torque_in", "drift", 2, ("torque_channels_disagree",), 3000, states=LOADED),
    Row("sensor.torque_in", "noise", 2, ("torque_in_trip",), 100, states=LOADED),
    Row("sensor.torque_out", "noise", 200, ("torque_out_trip",), 100, states=LOADED),
    Row("sensor.torque_in", "lag", 1, ("torque_channels_disagree",), 4000, states=LOADED),
    Row("sensor.torque_out", "lag", 1, ("torque_channels_disagree",), 4000, states=LOADED),
    Row("sensor.torque_in", "flip", None, ("torque_channels_disagree",), 24, states=LOADED),
    Row("sensor.torque_in", "nan", None, ("sensor_not_a_number",), 2, states=LOADED),
    Row("sensor.torque_in", "saturate", None, ("sensor_saturated",), 5, states=LOADED),
    # the shaft has to turn by 6 arcmin, and there is a dwell first at a turning point
    Row("sensor.angle_in", "stuck", None, ("angle_channels_disagree",), 1500, states=LOADED),
    Row("sensor.angle_in", "scale", 2, ("angle_channels_disagree",), 30, states=LOADED),
    Row("sensor.angle_in", "scale", 1.03, ("angle_channels_disagree",), 9000, states=("home",)),
    Row("sensor.angle_in", "lag", 1, ("angle_channels_disagree",), 1500, states=LOADED),
    Row("sensor.angle_in", "flip", None, ("angle_channels_disagree",), 30, states=LOADED),
    Row("sensor.angle_in", "drift", 0.001, ("angle_channels_disagree",), 4000, states=LOADED),
    Row("sensor.angle_in", "offset", 0.01, ("angle_channels_disagree",), 30, states=LOADED),
    Row("sensor.angle_in", "drift", 10, ("overspeed", "over_travel"), 120, states=LOADED),
    Row("sensor.angle_in", "spike", 2, ("over_travel",), 3, states=LOADED),
    Row("sensor.angle_in", "noise", 1, ("over_travel",), 20, states=LOADED),
    Row("sensor.angle_out", "stuck", None, (), 0, states=("ramp_pos",), note=IN_THE_RESULT),
    Row("sensor.angle_out", "lag", 1, (), 0, states=("ramp_pos",), note=IN_THE_RESULT),
    Row("sensor.angle_out", "spike", 0.01, (), 0, states=LOADED),
    Row("sensor.angle_out", "scale", 2, ("lock_slip",), 5, UNLOADING_S, states=LOADED),
    Row("sensor.angle_out", "drift", 0.01, ("lock_slip",), 30, UNLOADING_S, states=LOADED),
    Row("sensor.angle_out", "noise", 0.001, ("lock_slip",), 100, UNLOADING_S, states=LOADED),
    Row("sensor.angle_out", "flip", None, ("lock_slip",), 5, UNLOADING_S, states=LOADED),
    Row("sensor.angle_out", "nan", None, ("sensor_not_a_number",), 2, states=LOADED),
    Row("sensor.torque_out", "offset", 50, ("tare_out_of_range",), RUN, states=("home",)),
    Row("sensor.torque_out", "offset", 235, ("torque_out_alarm",), 300, states=("reverse",)),
    Row("sensor.torque_out", "noise", 40, ("tare_unsteady",), RUN, states=("home",)),
    Row("unit", "crack", 0.4, ("overspeed",), 20, states=("calibrate", "reverse", "ramp_neg")),
    Row("unit", "jam", 8, ("torque_in_trip", "torque_channels_disagree"), 5000, states=LOADED, rest=0.5),
    Row("process.scan", "stop", 45, ("missed_periods",), 50, UNLOADING_S, states=(), wires="calibrate"),
)
# fmt: on
