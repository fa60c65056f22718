"""Settings of the virtual drive: the objects that its machine, its motion and its watch obey."""

from __future__ import annotations

from dataclasses import dataclass

from virtual_bench.drive.cia402_tables import AbortConnection


@dataclass
class DriveObjects:
    """Objects that set the drive up, as after power-on: a vendor's defaults, which protect nothing."""

    max_torque_permille: int = 3000  # 0x6072
    max_speed_rpm: int = 6000  # 0x6080
    torque_slope_permille_s: int = 1_000_000  # 0x6087
    slow_down_counts_s2: int = 10_485_760  # 0x6084
    quick_stop_counts_s2: int = 104_857_600  # 0x6085
    home_offset_counts: int = 0  # 0x607C
    homing_method: int = 37  # 0x6098
    abort_connection: int = AbortConnection.FAULT  # 0x6007
    quick_stop_option: int = 2  # 0x605A
    shutdown_option: int = 0  # 0x605B
    disable_option: int = 1  # 0x605C
    halt_option: int = 1  # 0x605D
    fault_reaction_option: int = 2  # 0x605E
    setpoint_timeout_ms: int = 0  # 0x1400:5
    digital_outputs: int = 0  # 0x60FE:1
    output_mask: int = 0  # 0x60FE:2, of the outputs that 0x60FE:1 sets
