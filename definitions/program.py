"""The program: a recipe on a bench, turned into what the controller steps through. Plain numbers, times in scans.

A program is a list of segments. Each belongs to one state, and the state machine moves when the next segment's state
differs. Segment indices are recorded with every sample, so that the analysis takes turning points from the command and
never from the sign of a noisy difference.
"""

from __future__ import annotations

from dataclasses import dataclass, make_dataclass
from typing import TYPE_CHECKING, Any

from definitions.faults import LIMITS
from definitions.image import State


@dataclass(frozen=True, slots=True)
class Sweep:
    """A sine about the segment's torque: amplitude [N·m] and how its frequency goes up and down in each period.

    A period is a whole number of cycles; the torque's amplitude is the whole one from the second cycle on.
    """

    amplitude_nm: float
    from_hz: float
    to_hz: float
    period_scans: int
    periods: int

    @property
    def scans(self) -> int:
        """Scans that the whole sweep takes."""
        return self.periods * self.period_scans


@dataclass(frozen=True, slots=True)
class Segment:
    """One piece of the load profile.

    A ramp goes from `start_nm` to `target_nm` (controlled torque) at `rate_nm_s`, or, when `speed_rad_s` is not 0, at
    that constant speed of the loaded shaft. A segment with rate and speed 0 is a dwell of `dwell_scans` at `target_nm`.
    One with a `sweep` swings about `target_nm`.
    `role` is one of `ROLES`, `direction` +1 rising, -1 falling, 0 dwell; `cycle` counts from 1 inside a block.
    """

    index: int
    state: State
    role: str
    direction: int
    cycle: int
    block: int
    start_nm: float
    target_nm: float
    rate_nm_s: float
    speed_rad_s: float
    acceleration_rad_s2: float
    dwell_scans: int
    limit_scans: int
    planned_scans: int
    sweep: Sweep | None = None

    @property
    def peak_nm(self) -> float:
        """Largest commanded torque, without sign."""
        return abs(self.target_nm) + (self.sweep.amplitude_nm if self.sweep else 0.0)


ROLES: dict[str, str] = {
    "none": "time before the first and after the last torque segment",
    "proof": "small torque that verifies the lock",
    "calibrate": "load cycle that measures the output torque against the input torque; gives the torque ratio",
    "virgin": "first torque rise from zero; never evaluated",
    "approach": "change from the peak torque of one block of cycles to that of the next; never evaluated",
    "measure": "loading or unloading branch that is evaluated",
    "fatigue": "load cycle that conditions the unit; not evaluated",
    "dwell": "torque held at a turning point",
    "sweep": "sinusoidal torque with rising and falling frequency; not evaluated as a hysteresis loop",
    "unload": "torque to zero",
}


@dataclass(frozen=True, slots=True)
class OtherLimits:
    """Limits that no single option of a recipe's `interlocks` gives: half an age, a step's, the bench's, and budgets.

    `angle_agreement_rad` and `coupling_rad_per_nm` are at the loaded shaft: how far drive and angle sensor may differ
    at rest, and what the coupling between them adds to that under torque.
    """

    lock_proof_motion_rad: float
    sample_late_scans: int
    torque_agreement_nm: float
    torque_agreement_ratio: float
    angle_agreement_rad: float
    angle_lag_scans: float
    coupling_rad_per_nm: float


if TYPE_CHECKING:

    class Limits(OtherLimits):
        """What `make_dataclass` below makes, for the type checker, which cannot know the rows."""

        def __init__(self, **limits: float) -> None: ...
        def __getattr__(self, name: str) -> Any: ...

else:
    Limits = make_dataclass(
        "Limits",
        [(limit.in_program, int if limit.whole else float) for limit in LIMITS],
        bases=(OtherLimits,),
        namespace={
            "__module__": __name__,
            "__doc__": "Interlock limits in SI units, those of the fault table and the others; ages and times in scans."
            " `inf` only where a sensor is absent, or nothing is limited.",
        },
        frozen=True,
        slots=True,
    )


@dataclass(frozen=True, slots=True)
class Tare:
    """How the zeroes are taken: number of fresh samples, largest zero and largest spread accepted."""

    samples: int
    torque_in_zero_nm: float
    torque_out_zero_nm: float
    torque_in_spread_nm: float
    torque_out_spread_nm: float


@dataclass(frozen=True, slots=True)
class Lock:
    """The lock brake: current that holds, tolerance on it, time to settle, and the longest time to get there."""

    current_a: float
    tolerance_a: float
    settle_scans: int
    limit_scans: int


@dataclass(frozen=True, slots=True)
class TorqueControl:
    """How ramps by torque are followed.

    `controlled_from_input`: the controlled torque is `slope * T_in` instead of the output sensor's. `slope` is the
    output torque per drive torque (loading line), `offset_nm` its intercept. `gain_per_s` is the integral gain,
    `window_nm` how far the reference may run ahead, `tolerance_nm` when a target counts as reached,
    `rate_acceleration_s` the time in which a ramp gets to its full rate, `slew_nm_s` the largest rate of the drive's
    torque and `torque_limit_nm` the largest drive torque (both at the loaded shaft).
    """

    controlled_from_input: bool
    measure_ratio: bool
    slope: float
    offset_nm: float
    gain_per_s: float
    window_nm: float
    tolerance_nm: float
    rate_acceleration_s: float
    slew_nm_s: float
    torque_limit_nm: float
    stiffness_nm_per_rad: float


@dataclass(frozen=True, slots=True)
class Jog:
    """Limits of a jog, at the loaded shaft: largest speed, how it is reached and left again; times in scans.

    `token_scans`: age above which a token counts no more. `longest_press_scans`: a contact of the enabling device that
    is closed for longer is stuck. `stop_scans`: the shaft stands by then, or the drive's power goes.
    """

    speed_rad_s: float
    acceleration_rad_s2: float
    deceleration_rad_s2: float
    token_scans: int
    longest_press_scans: int
    stop_scans: int


@dataclass(frozen=True, slots=True)
class Program:
    """Everything that `controller.Controller` needs to know, as plain numbers.

    With a `jog` it is no run: the start leads to the state JOG, and its limits are those of a jog.
    """

    name: str
    period_s: float
    loading_input: bool
    ratio: float
    has_torque_in: bool
    has_torque_out: bool
    segments: tuple[Segment, ...]
    unload_segment: int
    limits: Limits
    tare: Tare
    lock: Lock
    control: TorqueControl
    release_torque_nm: float
    ready_scans: int
    enable_scans: int
    homing_scans: int
    mode_scans: int
    release_scans: int
    unload_limit_scans: int
    settle_scans: int
    jog: Jog | None = None

    @property
    def let_go_scans(self) -> int:
        """Scans until the lock has let go: its torque falls from what holds the unit to a friction of its bearings."""
        return max(self.settle_scans, 2 * self.lock.settle_scans)

    @property
    def rest_scans(self) -> int:
        """Scans recorded behind the last step of a complete run: until the zeroes have been read again."""
        return self.let_go_scans + self.tare.samples

    @property
    def planned_scans(self) -> int:
        """Scans from start to complete if nothing holds the run up."""
        preparation = self.tare.samples + self.lock.settle_scans
        return preparation + self.rest_scans + sum(segment.planned_scans for segment in self.segments)

    @property
    def peak_torque_nm(self) -> float:
        """Largest commanded torque at the output [N·m], without sign."""
        return max(segment.peak_nm for segment in self.segments)

    def load_profile(self) -> list[tuple[float, float]]:
        """Corner points (time in s from the first ramp, output torque in N·m) of the commanded load."""
        time_s, points = 0.0, [(0.0, 0.0)]
        for segment in self.segments:
            if segment.sweep is not None:  # two turns in a period show how far it swings; its cycles would be too many
                turns = 2 * segment.sweep.periods
                for turn in range(turns):
                    share = (turn + 0.5) / turns
                    swing_nm = segment.sweep.amplitude_nm * (-1.0 if turn % 2 else 1.0)
                    points.append(
                        (time_s + share * segment.planned_scans * self.period_s, segment.target_nm + swing_nm)
                    )
            time_s += segment.planned_scans * self.period_s
            points.append((time_s, segment.target_nm))
        return points
