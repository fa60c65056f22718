"""The load profile: the steps of a recipe as segments, each knowing where the torque comes from and where it goes."""

from __future__ import annotations

import math

from definitions.image import State
from definitions.program import Segment, Sweep
from recipes import Bench, Recipe
from recipes.compiler.budgets import budget
from recipes.schema.sequence_schema import (
    Calibrate,
    FatigueCycles,
    Lock,
    SpeedCycles,
    StepCycles,
    TorqueCycles,
    TorqueSweep,
    Unload,
)

ARCMIN_PER_RAD = 10800.0 / math.pi


class LoadProfile:
    """Collects segments and keeps where the torque stands."""

    def __init__(self, recipe: Recipe, bench: Bench, period_s: float) -> None:
        self.recipe, self.bench, self.period_s = recipe, bench, period_s
        self.segments: list[Segment] = [
            Segment(0, State.IDLE, "none", 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0),
        ]
        self.level_nm = 0.0
        self.block = 0

    def scans(self, seconds: float) -> int:
        """Whole scans that a time takes, rounded up."""
        return max(0, math.ceil(seconds / self.period_s - 1e-9))

    def ramp(
        self,
        state: State,
        role: str,
        target_nm: float,
        *,
        cycle: int = 0,
        rate_nm_s: float = 0.0,
        speed: SpeedCycles | None = None,
    ) -> None:
        """Add a ramp from the present level: by torque rate, or at the constant speed of `speed`."""
        span_nm = abs(target_nm - self.level_nm)
        speed_rad_s = acceleration_rad_s2 = 0.0
        if speed is not None:
            speed_rad_s = speed.speed_rad_s / self.bench.drive.gear_ratio
            acceleration_rad_s2 = speed.acceleration_rad_s2 / self.bench.drive.gear_ratio
            span_rad = span_nm / self.stiffness_nm_per_rad()
            planned_s = span_rad / speed_rad_s + speed_rad_s / acceleration_rad_s2
            limit_s = speed.time_limit_s
        else:
            reversing = self.level_nm != 0.0 and (target_nm - self.level_nm) * self.level_nm < 0
            planned_s = span_nm / rate_nm_s + budget("rate_acceleration_s")
            planned_s += budget("reversal_s") if reversing and self.recipe.loading == "input" else 0.0
            limit_s = planned_s * budget("ramp_limit_factor") + budget("ramp_limit_extra_s")
        direction = 1 if target_nm > self.level_nm else -1
        self.segments.append(
            Segment(
                len(self.segments),
                state,
                role,
                direction,
                cycle,
                self.block,
                self.level_nm,
                target_nm,
                rate_nm_s,
                speed_rad_s,
                acceleration_rad_s2,
                0,
                self.scans(limit_s),
                self.scans(planned_s),
            ),
        )
        self.level_nm = target_nm

    def dwell(self, state: State, seconds: float, cycle: int = 0, role: str = "dwell", direction: int = 0) -> None:
        """Add a rest of at least one scan at the present level."""
        scans = max(1, self.scans(seconds))
        self.segments.append(
            Segment(
                len(self.segments),
                state,
                role,
                direction,
                cycle,
                self.block,
                self.level_nm,
                self.level_nm,
                0.0,
                0.0,
                0.0,
                scans,
                scans,
                scans,
            ),
        )

    def sweep(self, step: TorqueSweep) -> None:
        """Go to the mean torque, swing about it, and rest."""
        self.block += 1
        role = "virgin" if self.level_nm == 0.0 else "approach"
        mean_nm = step.mean_torque_nm
        state = State.RAMP_POS if mean_nm > self.level_nm else State.RAMP_NEG
        self.ramp(state, role, mean_nm, rate_nm_s=step.torque_rate_nm_s)
        self.dwell(State.REVERSE, step.dwell_s)
        period_scans = max(1, round(step.period_s / self.period_s))
        seconds = period_scans * self.period_s
        # Cycles of a period are whole: the highest frequency gives way, and only downwards, for it was checked.
        cycles = max(1, math.floor((step.from_frequency_hz + step.to_frequency_hz) / 2.0 * seconds + 1e-6))
        to_hz = 2.0 * cycles / seconds - step.from_frequency_hz
        sweep = Sweep(step.amplitude_nm, step.from_frequency_hz, to_hz, period_scans, step.periods)
        limit = self.scans(sweep.scans * self.period_s * budget("ramp_limit_factor") + budget("ramp_limit_extra_s"))
        self.segments.append(
            Segment(
                len(self.segments), State.REVERSE, "sweep", 0, 0, self.block, mean_nm, mean_nm, step.torque_rate_nm_s,
                0.0, 0.0, 0, limit, sweep.scans, sweep,
            ),
        )  # fmt: skip
        self.dwell(State.REVERSE, step.dwell_s)

    def stiffness_nm_per_rad(self) -> float:
        """Planned torque per angle of the loaded shaft."""
        unit = self.recipe.unit_under_test
        at_output = unit.stiffness_nm_per_arcmin * ARCMIN_PER_RAD
        return at_output / unit.ratio if self.recipe.loading == "input" else at_output

    def swing(self, role: str, target_nm: float, cycle: int, step: TorqueCycles | SpeedCycles | FatigueCycles) -> None:
        """Add one ramp to the target and the dwell at its end."""
        state = State.RAMP_POS if target_nm > self.level_nm else State.RAMP_NEG
        if isinstance(step, SpeedCycles):
            self.ramp(state, role, target_nm, cycle=cycle, speed=step)
        else:
            self.ramp(state, role, target_nm, cycle=cycle, rate_nm_s=step.torque_rate_nm_s)
        self.dwell(State.REVERSE, 0.0 if isinstance(step, FatigueCycles) else step.dwell_s, cycle)

    def stairs(self, role: str, target_nm: float, cycle: int, step: StepCycles) -> None:
        """Add equal steps to the target, with a dwell on each."""
        state = State.RAMP_POS if target_nm > self.level_nm else State.RAMP_NEG
        direction = 1 if target_nm > self.level_nm else -1
        height_nm = step.peak_torque_nm / step.steps
        count = round(abs(target_nm - self.level_nm) / height_nm)
        start_nm = self.level_nm
        for number in range(1, count + 1):
            level_nm = start_nm + direction * number * height_nm if number < count else target_nm
            self.ramp(state, role, level_nm, cycle=cycle, rate_nm_s=step.torque_rate_nm_s)
            if number < count:
                self.dwell(state, step.dwell_s, cycle, role, direction)
        self.dwell(State.REVERSE, step.dwell_s, cycle)

    def cycles(self, step: TorqueCycles | SpeedCycles | StepCycles | FatigueCycles) -> None:
        """From wherever the torque stands to +peak, then `count` times to -peak and back to +peak."""
        self.block += 1
        peak_nm = step.peak_torque_nm
        role = "fatigue" if isinstance(step, FatigueCycles) else "measure"
        move = self.stairs if isinstance(step, StepCycles) else self.swing
        if self.level_nm != peak_nm:
            # from zero or from another block's peak: not a closed loop yet
            move("virgin" if self.level_nm == 0.0 else "approach", peak_nm, 0, step)  # type: ignore[arg-type]
        for cycle in range(1, step.count + 1):
            move(role, -peak_nm, cycle, step)  # type: ignore[arg-type]
            move(role, peak_nm, cycle, step)  # type: ignore[arg-type]


def segments_of(recipe: Recipe, bench: Bench, period_s: float) -> tuple[Segment, ...]:
    """All segments of a recipe on a bench, from the proof of the lock to the unloading."""
    profile = LoadProfile(recipe, bench, period_s)
    for step in recipe.sequence:
        if isinstance(step, Lock):
            rate_nm_s = step.proof_torque_nm / budget("proof_s")
            for target_nm in (step.proof_torque_nm, -step.proof_torque_nm):
                profile.ramp(State.LOCK, "proof", target_nm, rate_nm_s=rate_nm_s)
                profile.dwell(State.LOCK, step.proof_time_s)
            profile.ramp(State.LOCK, "proof", 0.0, rate_nm_s=rate_nm_s)
        elif isinstance(step, Calibrate):
            for target_nm in (step.peak_torque_nm, -step.peak_torque_nm):
                profile.ramp(State.CALIBRATE, "calibrate", target_nm, rate_nm_s=step.torque_rate_nm_s)
                profile.dwell(State.CALIBRATE, step.dwell_s)
            profile.ramp(State.CALIBRATE, "calibrate", 0.0, rate_nm_s=step.torque_rate_nm_s)
        elif isinstance(step, TorqueCycles | SpeedCycles | StepCycles | FatigueCycles):
            profile.cycles(step)
        elif isinstance(step, TorqueSweep):
            profile.sweep(step)
        elif isinstance(step, Unload):
            profile.ramp(State.UNLOAD, "unload", 0.0, rate_nm_s=step.torque_rate_nm_s)
    return tuple(profile.segments)
