"""The drive on its motor: scales between the object dictionary's numbers and the plant's SI values."""

from __future__ import annotations

from collections.abc import Callable
from math import pi

from drivers.config import DriveConfig
from virtual_bench.config import sign, torque_unit_nm
from virtual_bench.drive.cia402_machine import Cia402Machine
from virtual_bench.physics.motor_stop import Demand
from virtual_bench.physics.plant import Plant

LIMIT_SHOWN_NS = 2_000_000  # an internal limit stays visible this long, so that no status word misses it


class DriveAxis:
    """One machine, one motor. `tick` after the plant has been advanced; `apply` after anything was written."""

    def __init__(self, plant: Plant, config: DriveConfig, on_emcy: Callable[[int, int], None] | None = None) -> None:
        self.machine = Cia402Machine(config.profile.scaling.position_counts_per_motor_rev, on_emcy)
        self._plant = plant
        self._torque_unit_nm = torque_unit_nm(config)
        self._sign = sign(config)
        self._counts_per_rad_s = self._sign * config.profile.scaling.velocity_counts_per_rad_s
        self._limit_until_ns = -1
        self._applied: Demand | None = None
        self.apply_limits()

    def apply_limits(self) -> None:
        """Pass 0x6072, 0x6080 and 0x6087 on to the motor's loops; call after they were written."""
        objects, unit = self.machine.objects, self._torque_unit_nm
        self._plant.set_drive_limits(
            objects.max_torque_permille * unit,
            objects.max_speed_rpm * 2.0 * pi / 60.0,
            objects.torque_slope_permille_s * unit,
        )

    def apply(self) -> None:
        """Pass the machine's demand on to the motor's loops."""
        demand = self.machine.motion.demand
        if demand is not self._applied:
            self._applied = demand
            self._plant.set_drive(
                demand.loop,
                self._sign * demand.torque_permille * self._torque_unit_nm,
                demand.velocity_counts_s / self._counts_per_rad_s,
            )

    def tick(self, now_ns: int) -> None:
        """Let the machine look at the motor and at the time, and apply what it then demands."""
        plant = self._plant
        motor = plant.motor
        if plant.take_limited():
            self._limit_until_ns = now_ns + LIMIT_SHOWN_NS
        motor.limited = now_ns <= self._limit_until_ns
        self.machine.step(now_ns, motor)
        if self.machine.motion.demand is not self._applied:
            self.apply()

    def protect(self, config: DriveConfig) -> None:
        """Write a controller's protections as it would over SDO, rounded as the objects round them."""
        objects, unit = self.machine.objects, self._torque_unit_nm
        objects.max_torque_permille = round(config.max_torque_nm / unit)
        objects.max_speed_rpm = round(config.max_speed_rad_s * 60.0 / (2.0 * pi))
        objects.torque_slope_permille_s = round(config.torque_slope_nm_s / unit)
        objects.setpoint_timeout_ms = round(config.setpoint_timeout_s * 1e3)
        objects.abort_connection = config.abort_connection_option
        objects.quick_stop_option = config.quick_stop_option
        objects.fault_reaction_option = config.fault_reaction_option
        timeout_ms = round(config.controller_heartbeat_timeout_s * 1e3)
        self.machine.consume_heartbeats_of(config.controller_node_id, timeout_ms)
        self.apply_limits()
