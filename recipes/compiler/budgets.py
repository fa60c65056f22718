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
}


def budget(name: str) -> float:
    """Value of a budget: seconds, or a share without unit; `KeyError` for a name that is not in the table."""
    return BUDGETS[name][0]
