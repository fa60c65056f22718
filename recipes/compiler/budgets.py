"""Times and shares that a recipe does not set, one row each, with the reason."""

from __future__ import annotations

BUDGETS: dict[str, tuple[float, str]] = {
    "ready_s": (3.0, "devices answer within this time after the start"),
    "enable_s": (2.0, "the drive walks from switch on disabled to operation enabled"),
    "homing_s": (10.0, "longest homing"),
    "mode_s": (0.5, "the drive shows the ordered mode of operation"),
    "release_s": (3.0, "brake current gone and drive off"),
    "settle_s": (0.3, "least tail that is recorded after the last step, and the rest after a reaction"),
    "proof_s": (1.0, "a ramp to the proof torque takes this long"),
    "lock_current_s": (3.0, "brake supply reaches its current"),
    "ramp_limit_factor": (3.0, "a ramp may take this many times its planned duration"),
    "ramp_limit_extra_s": (10.0, "and this long on top: friction is crossed at each reversal"),
    "reversal_s": (1.3, "planned time to cross the friction at a reversal of a ramp by torque"),
    "window_of_rated": (0.02, "the reference runs ahead of the torque by no more than this"),
    "tolerance_of_rated": (0.005, "a target counts as reached within this"),
    "rate_acceleration_s": (0.15, "a ramp by torque comes to its full rate in this time"),
    "tare_spread_of_full_scale": (0.01, "noise of a healthy channel is a fiftieth of its full scale or less"),
    "agreement_of_rated": (0.25, "input and output torque fit together within this"),
    "agreement_ratio": (1.7, "and within this factor of the gear ratio: an unloading reducer multiplies by 1.4"),
    "brake_tolerance_of_current": (0.05, "brake current counts as reached within this"),
    "settle_of_time_constant": (5.0, "the brake's torque has settled after this many time constants"),
    "slew_of_peak_per_s": (0.5, "the drive's torque never changes faster than this share of its limit per second"),
    "jog_token_s": (0.1, "a token of a jog counts for this long: two of them may be lost on the way"),
    "jog_speed_of_largest": (0.1, "speed of a jog where the bench file sets none, of the shaft's largest"),
    "jog_torque_of_rated": (0.2, "torque of a jog where the bench file sets none: a unit's friction, and some more"),
    "jog_start_s": (0.5, "a jog comes to its speed in this time"),
    "jog_ramp_down_s": (0.1, "and from it to standstill in this time, when key or enabling device is let go"),
    "jog_stop_s": (0.3, "the shaft stands by then, or the power of the drive goes"),
    "jog_speed_over_limit": (2.0, "overspeed of a jog, of its largest speed: a shaft that breaks loose runs ahead"),
    "jog_drive_speed_over_limit": (1.5, "and what the drive itself is limited to, 0x6080"),
    "jog_torque_over_limit": (1.5, "input torque that ends a jog, of its largest: sensors are not zeroed before it"),
    "jog_torque_out_of_full_scale": (0.05, "output torque that ends a jog: something holds the output"),
    "jog_brake_current": (0.01, "the lock counts as open below this share of its largest current"),
}


def budget(name: str) -> float:
    """Value of a budget: seconds, or a share without unit; `KeyError` for a name that is not in the table."""
    return BUDGETS[name][0]
