"""The drive on its motor: scales between the object dictionary's numbers and the plant's SI values."""

from __future__ import annotations

from collections.abc import Callable
from math import pi

from drivers.virtual.cia402_machine import Cia402Machine
from drivers.virtual.config import DriveConfig, Protections
from drivers.virtual.motor_stop import Demand, MotorView, view_of
from drivers.virtual.plant import Plant

LIMIT_SHOWN_NS = 2_000_000  # an internal limit stays visible this long, so that no status word misses it


class DriveAxis:
    """One machine, one motor. `tick` after the plant has been advanced; `apply` after anything was written."""

    def __init__(self, plant: Plant, config: DriveConfig, on_emcy: Callable[[int, int], None] | None = None) -> None:
        self.machine = Cia402Machine(config.profile.position_counts_per_motor_rev, on_emcy)
        self._plant = plant
        self._torque_unit_nm = config.rated_torque_nm / 1000.0
        self._counts_per_rad = config.profile.position_counts_per_motor_rev / (2.0 * pi)
        self._counts_per_rad_s = config.profile.velocity_counts_per_rad_s
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
                demand.torque_permille * self._torque_unit_nm,
                demand.velocity_counts_s / self._counts_per_rad_s,
            )

    def tick(self, now_ns: int) -> None:
        """Measure the motor, let the machine look at it and at the time, and apply what it then demands."""
        torque_nm, angle_rad, velocity_rad_s, limited = self._plant.motor()
        if limited:
            self._limit_until_ns = now_ns + LIMIT_SHOWN_NS
        view: MotorView = view_of(
            (
                round(torque_nm / self._torque_unit_nm),
                round(angle_rad * self._counts_per_rad),
                round(velocity_rad_s * self._counts_per_rad_s),
                now_ns <= self._limit_until_ns,
            )
        )
        self.machine.step(now_ns, view)
        self.apply()

    def protect(self, protections: Protections, controller_node_id: int) -> None:
        """Write a controller's protections as it would over SDO, rounded as the objects round them."""
        objects, unit = self.machine.objects, self._torque_unit_nm
        objects.max_torque_permille = round(protections.max_torque_nm / unit)
        objects.max_speed_rpm = round(protections.max_speed_rad_s * 60.0 / (2.0 * pi))
        objects.torque_slope_permille_s = round(protections.torque_slope_nm_s / unit)
        objects.setpoint_timeout_ms = round(protections.setpoint_timeout_s * 1e3)
        objects.abort_connection = protections.abort_connection_option
        objects.quick_stop_option = protections.quick_stop_option
        objects.fault_reaction_option = protections.fault_reaction_option
        timeout_ms = round(protections.controller_heartbeat_timeout_s * 1e3)
        self.machine.consume_heartbeats_of(controller_node_id, timeout_ms)
        self.apply_limits()
