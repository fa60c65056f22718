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


class Row(NamedTuple):
    """Row of the matrix.

    `causes`: fault ids that may come first, none when the run must go on to its end as if nothing had happened.
    `detect_scans`: from the fault's first effect to the alarm. `torque_s`: from the alarm until the torque in the
    reducer is low for good. `wires`: the state in which the row is run over wires as well.
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

    @property
    def name(self) -> str:
        """What the row is called: target, verb, value, duration."""
        value = "" if self.value is None else f" {self.value:g}"
        return f"{self.target} {self.verb}{value}" + ("" if self.for_ms is None else f" for {self.for_ms:g} ms")


UNLOADING_S = 4.0
"""A controlled unload from the peak, friction crossed several times."""

# fmt: off
ROWS: tuple[Row, ...] = (
    # CAN: heartbeat period 20 ms, time-out 100 ms; process data time-out 10 ms
    Row("can.drive.heartbeat", "off", None, ("drive_heartbeat_lost",), 122, states=BEFORE_RELEASE, wires="ramp_pos"),
    Row("can.drive.tpdo1", "off", None, ("drive_data_stale",), 12, wires="calibrate"),
    Row("can.drive.tpdo1", "drop", 0.2, (), 0),
    Row("can.drive.tpdo1", "drop_next", 5, (), 0),
    Row("can.drive.tpdo1", "drop_next", 30, ("drive_data_stale",), 12, wires="ramp_pos"),
    Row("can.drive.tpdo1", "delay", 30, ("drive_data_stale",), 12, wires="calibrate"),
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
    # Modbus: amplifier time-out 10 ms, brake and remote I/O 100 ms
    Row("modbus.amplifier", "off", None, ("amplifier_lost",), 2, wires="ramp_pos"),
    Row("modbus.brake", "off", None, ("brake_link_lost",), 12, UNLOADING_S, wires="calibrate"),
    Row("modbus.remote_io", "off", None, ("remote_io_lost",), 12),
    Row("modbus.amplifier", "exception", None, ("amplifier_lost",), 2, wires="calibrate"),
    Row("modbus.brake", "exception", None, ("brake_link_lost",), 12, UNLOADING_S),
    Row("modbus.remote_io", "exception", None, ("remote_io_lost",), 12),
    Row("modbus.amplifier", "silence", None, ("sample_stale",), 12, wires="calibrate"),
    Row("modbus.brake", "silence", None, ("brake_link_lost",), 112, UNLOADING_S),
    Row("modbus.remote_io", "silence", None, ("remote_io_lost",), 112, states=BEFORE_RELEASE, wires="calibrate"),
    Row("modbus.amplifier", "slow", 30, ("sample_stale",), 32),
    Row("modbus.amplifier", "slow", 7, ("sample_late",), 700, states=LOADED, for_ms=50),
    Row("modbus.brake", "slow", 300, ("brake_link_lost",), 312, UNLOADING_S),
    Row("modbus.remote_io", "slow", 300, ("remote_io_lost",), 312, states=BEFORE_RELEASE),
    Row("modbus.amplifier", "freeze", None, ("sample_frozen", "sample_stale"), 24, wires="calibrate"),
    Row("modbus.brake", "freeze", None, ("lock_not_closed", "brake_stays_closed"), RUN),
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
    Row("io.housing_temp", "offset", 60, ("housing_temperature",), 32, UNLOADING_S),
    Row("scan.overrun", "miss", 45, ("missed_periods",), 3, UNLOADING_S),
    Row("scan.overrun", "miss", 20, (), 0),
)
# fmt: on
