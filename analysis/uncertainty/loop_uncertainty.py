"""Uncertainty of whatever is read from the loops of one measurement: the loop moved by each error, and read again.

Sensitivities are central differences: the loop is moved by plus and minus one standard uncertainty of a source, and the
metric is evaluated as it always is. So a new metric needs nothing here. GUM 5.1.4 note 2.

Noise of the sensors is another matter: what averaging in blocks and monotone regression leave of it is no formula, so
it is tried. The branch is laid out evenly in time, as it was measured, noise as declared and as seen is added, and it
is reduced again, many times.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from analysis.loop.branches import MOST_BLOCKS, Branch, made_rising
from analysis.loop.interruptions import after
from analysis.loop.loop import Loop
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray
from analysis.uncertainty.budget import Budget, Entry, beyond, combined
from analysis.uncertainty.chain import Move, covariance_moves, covariance_of, moves_of, quadrants_used, u_torque_nm
from analysis.uncertainty.conditions import MeasurementConditions
from analysis.uncertainty.distributions import DISTRIBUTIONS
from analysis.uncertainty.figures import SensorFigures
from analysis.uncertainty.left_open import OPEN_SOURCES, TRIAL
from analysis.uncertainty.monte_carlo import Drawn, drawn_loops, monte_carlo
from analysis.uncertainty.scatter import deviation
from analysis.uncertainty.seen_in_run import SlowNoise
from analysis.uncertainty.sources import SOURCES, ErrorSource
from analysis.uncertainty.transfer import transfer_moves, unit_moves
from definitions.units import ARCMIN_PER_RAD

SMOOTH_POINTS = 400
"""Points per branch, about, of the loop that errors are tried on."""

MASKED_AGAIN = 0.5
"""Share of a masked stretch that is left out besides, to see what a fit that continues a branch owes to it.

On the virtual units that moves the spring constant and the wind-up by 1.4 to 1.6 times what the mask itself did.
"""

LEAST_MOVE = 1e-9
"""Change of a metric, of its value, from which an error moves it and not the rounding of its numbers."""

LINE = "calibration_"
"""How the quantities of calibration lines begin."""

OTHER_UNIT = ("other_unit", "spread between the units of the stored calibration, at the reference torque")
TRANSFER = ("transfer", "friction near zero torque and after reversals that the calibration does not describe")
INTERRUPTED = ("interrupted", "steps of the wind-up where a ramp was interrupted")
MASKED = ("masked", "masked part after a reversal, replaced by the fit", "rectangular")
CONVERSION = (
    "conversion", "converted torque against the measured output torque, beyond the other contributions", "normal"
)  # fmt: skip

CONVERTS = (OTHER_UNIT[0], TRANSFER[0], MASKED[0])
"""Quantities beside the calibration lines that say how wrong a converted torque may be."""

Estimate = Callable[[Loop], float]


class UsedSource(NamedTuple):
    """A source that enters a loop: its distribution, limit, standard uncertainty, and the moves of its components.

    A move is what one unit of `u` does: `scale` is the amount of it that is tried, one standard uncertainty, or of a
    source with `whole` the limit.
    """

    id: str
    text: str
    unit: str
    distribution: str
    limit: float
    u: float
    scale: float
    moves: tuple[Move, ...]
    whole: bool = False

    def pairs(self, loop: Loop) -> list[tuple[Loop, Loop]]:
        """Return the loop with so much of each component as is tried, and with as much against it."""
        return [(move.applied(loop, self.scale), move.applied(loop, -self.scale)) for move in self.moves]

    def contribution(self, estimate: Estimate, base: float, pairs: Sequence[tuple[Loop, Loop]]) -> float:
        """Return what it contributes to a metric, of which the loop itself has the value `base`."""
        if self.whole:
            share = self.u / self.scale
            changes = [_largest(base, estimate(high), estimate(low)) * share for high, low in pairs]
        else:
            changes = [_change(base, estimate(high), estimate(low)) for high, low in pairs]
        # one component keeps its sign; of several with unknown phase only the size means something
        return changes[0] if len(changes) == 1 else math.hypot(*changes)


def used_sources(loop: Loop, conditions: MeasurementConditions, figures: SensorFigures) -> tuple[UsedSource, ...]:
    """Return the sources that enter a loop, in the order of their tables, calibration lines last."""
    found = _used([*SOURCES, *chain.from_iterable(OPEN_SOURCES.values())], loop, conditions, figures)
    for name in quadrants_used(conditions):
        line = covariance_of(name, conditions, figures)
        if line is not None:
            u = u_torque_nm(name, line, conditions)
            moves = covariance_moves(name, line, loop, conditions)
            text = f"calibration line, {name.replace('_', ' ')}, at the reference torque"
            found.append(UsedSource(f"{LINE}{name}", text, "N·m", "normal", 1.0, u, 1.0, moves))
    u, moves = unit_moves(loop, conditions, figures)
    if u > 0.0:
        found.append(UsedSource(*OTHER_UNIT, "N·m", "normal", 1.0, u, 1.0, moves))
    u, moves = transfer_moves(loop, conditions, figures)
    if u > 0.0:
        found.append(UsedSource(*TRANSFER, "N·m", "normal", 1.0, u, 1.0, moves))
    u, moves = interruption_moves(loop, conditions)
    if u > 0.0:
        found.append(UsedSource(*INTERRUPTED, "arcmin", "normal", 1.0, u, 1.0, moves))
    return tuple(found)


def _used(
    sources: Sequence[ErrorSource], loop: Loop, conditions: MeasurementConditions, figures: SensorFigures
) -> list[UsedSource]:
    """Return those of some sources that enter a loop."""
    found = []
    for source in sources:
        declared = source.declared(figures, conditions)
        if declared is None:
            continue
        limit, distribution = declared
        moves = tuple(moves_of(source, loop, conditions, figures))
        if any(move.moves_anything for move in moves):
            u = declared.u
            scale = limit if source.whole else u
            found.append(
                UsedSource(source.id, source.text, source.unit, distribution, limit, u, scale, moves, source.whole)
            )
    return found


def interruption_moves(loop: Loop, conditions: MeasurementConditions) -> tuple[float, tuple[Move, ...]]:
    """Return the standard uncertainty [arcmin] of the steps that interruptions leave in the mean cycle, and its moves.

    A step that is known and not corrected counts as it is (GUM F.2.4.5, note): whether the unit keeps it, or goes back
    to its branch, the rest of that branch does not say. Nor whether the other branch of its cycle is moved by it.
    """
    still = (0.0, 0.0)
    sizes, moves = [], []
    for one in conditions.interruptions:
        size = math.hypot(one.step_arcmin or 0.0, one.u_arcmin) / conditions.cycles
        branch = loop.forward if one.direction > 0 else loop.backward
        step, all_of_it = (0.0, size * after(branch.torque_nm, one, one.direction)), (0.0, size)
        moves += [Move(step, still), Move(still, all_of_it)] if one.direction > 0 else [
            Move(still, step), Move(all_of_it, still),
        ]  # fmt: skip
        sizes.append(size)
    return math.hypot(*sizes), tuple(moves)


def _change(base: float, high: float, low: float) -> float:
    """Half the difference that an error of either sign makes; where both signs move a metric the same way, the larger.

    The wider of two sides does that where they are alike: it has a kink there, and half the difference is nothing.
    """
    if (high - base) * (low - base) <= 0.0:
        return (high - low) / 2.0
    return max(high - base, low - base, key=abs)


def _largest(base: float, high: float, low: float) -> float:
    """Return the larger of the changes that an error of either sign makes."""
    return max(high - base, base - low, key=abs)


def smoothed(loop: Loop) -> Loop:
    """Return a loop of few points per branch, means of neighbours: it shows its slope in spite of the noise."""
    return Loop(_smoothed(loop.forward), _smoothed(loop.backward), loop.method)


def _smoothed(branch: Branch) -> Branch:
    size = branch.torque_nm.size // SMOOTH_POINTS
    if size < 2:
        return branch
    edges = np.arange(0, branch.torque_nm.size, size)
    counts = np.diff(np.append(edges, branch.torque_nm.size))
    torque, angle = (np.add.reduceat(values, edges) / counts for values in (branch.torque_nm, branch.angle_arcmin))
    first, last = ((branch.torque_nm[end], branch.angle_arcmin[end]) for end in (0, -1))
    torque = np.concatenate(([first[0]], torque, [last[0]]))
    angle = np.concatenate(([first[1]], angle, [last[1]]))
    return Branch(torque, angle)


def _shorter(loop: Loop, masked_nm: tuple[float, float]) -> Loop | None:
    """Return a loop of which more is masked, by `MASKED_AGAIN`; None where nothing is."""
    below, above = (MASKED_AGAIN * masked for masked in masked_nm)
    if not below + above > 0.0:
        return None
    rising, falling = loop.forward, loop.backward
    kept = rising.torque_nm >= rising.torque_nm[0] + below
    left = falling.torque_nm <= falling.torque_nm[-1] - above
    return Loop(
        Branch(rising.torque_nm[kept], rising.angle_arcmin[kept]),
        Branch(falling.torque_nm[left], falling.angle_arcmin[left]),
        loop.method,
    )


class LoopUncertainty:
    """Uncertainty of whatever is read from the loops of one measurement. Perturbed loops are made once, for all.

    by_output: where the torque is converted, the loops of the same cycles by the torque at the output, if it was
    measured too.
    """

    def __init__(
        self, loop: Loop, conditions: MeasurementConditions, figures: SensorFigures, *,
        by_output: Sequence[Loop] = (), draws: int = 0,
    ) -> None:  # fmt: skip
        self.smooth = smoothed(loop)
        self.used = used_sources(self.smooth, conditions, figures)
        self._pairs = [one.pairs(self.smooth) for one in self.used]
        self._shorter = _shorter(self.smooth, conditions.masked_nm)
        self._noisy = noisy_loops(loop, conditions, figures)
        self._by_output = by_output
        self._conditions, self._figures = conditions, figures
        self._tried: dict[str, list[tuple[Loop, Loop]]] = {}
        drawn = [Drawn(one.distribution, one.limit, one.moves) for one in self.used]
        self._drawn = drawn_loops(self.smooth, drawn, draws) if draws else []

    def budget(self, estimate: Estimate, values: Sequence[float], unit: str) -> Budget:
        """Return the budget of a metric whose values per cycle are given; AnalysisError where a moved loop has none."""
        base, noise = estimate(self.smooth), self.noise(estimate)
        of_sources = [
            Entry(one.id, one.text, one.distribution, one.u, one.unit, one.contribution(estimate, base, pairs))
            for one, pairs in zip(self.used, self._pairs, strict=True)
        ]
        of_conversion = self._of_masked(estimate, base, unit)
        of_conversion += self._beyond_conversion(estimate, values, [*of_sources, *of_conversion], noise, unit)
        found = combined([*of_sources, *of_conversion], noise, values, unit, self._conditions.coverage)
        if not self._drawn:
            return found
        cycles = max(len(values), 1)
        besides = [(one.distribution, one.u * DISTRIBUTIONS[one.distribution].divisor) for one in of_conversion]
        drawn = monte_carlo(
            estimate,
            self.smooth,
            self._drawn,
            float(np.mean(values)),
            besides=[("normal", noise / math.sqrt(cycles)), *besides],
            scatter=beyond(values, noise),
            freedom=cycles - 1,
        )
        return replace(found, monte_carlo=drawn)

    def is_moved_by(self, check: str, estimate: Estimate) -> bool:
        """Say whether an error that a check leaves open moves a metric, by a trial of it."""
        if check not in self._tried:
            trial = replace(self._conditions, left_open={check: TRIAL})
            used = _used(OPEN_SOURCES[check], self.smooth, trial, self._figures)
            self._tried[check] = [pair for one in used for pair in one.pairs(self.smooth)]
        base = estimate(self.smooth)
        try:
            return any(
                abs(estimate(loop) - base) > LEAST_MOVE * abs(base) for pair in self._tried[check] for loop in pair
            )
        except (AnalysisError, ArithmeticError, ValueError, np.linalg.LinAlgError):
            return True  # so much of the error leaves the metric without a value

    def _of_masked(self, estimate: Estimate, base: float, unit: str) -> list[Entry]:
        """Return what a metric owes to the masked stretch: at most what half as much again of it would change."""
        if self._shorter is None:
            return []
        try:
            u = abs(estimate(self._shorter) - base) / math.sqrt(3.0)
        except AnalysisError:
            return []  # it reads a branch where it was measured, and continues none
        return [Entry(*MASKED, u, unit, u)] if u else []

    def _beyond_conversion(
        self, estimate: Estimate, values: Sequence[float], known: Sequence[Entry], noise: float, unit: str
    ) -> list[Entry]:
        """Return what the torque at the output shows of the conversion beyond what is known of it.

        A deviation that is known and not corrected counts as it is (GUM F.2.4.5, note). Noise is in both torques.
        """
        if not self._by_output:
            return []
        try:
            measured = [estimate(loop) for loop in self._by_output]
        except (AnalysisError, ArithmeticError, ValueError, np.linalg.LinAlgError):
            return []  # a metric that the output torque does not carry says nothing of the conversion
        deviation_shown = float(np.mean(values)) - float(np.mean(measured))
        rows = [one.contribution for one in known if one.quantity in CONVERTS or one.quantity.startswith(LINE)]
        u_known = math.hypot(noise * math.sqrt(2.0 / max(len(values), 1)), *rows)
        u = math.sqrt(max(deviation_shown**2 - u_known**2, 0.0))
        return [Entry(*CONVERSION, u, unit, u)] if u else []

    def noise(self, estimate: Estimate) -> float:
        """Return the standard deviation of one cycle's value by the noise of the sensors."""
        return deviation([estimate(loop) for loop in self._noisy])


NOISY_LOOPS = 40
"""Loops that are tried: their scatter is then known to 11 %."""

SEED = 1
"""The same loop has the same uncertainty whenever it is evaluated."""


def noisy_loops(loop: Loop, conditions: MeasurementConditions, figures: SensorFigures) -> list[Loop]:
    """Return the loop as one cycle might have shown it with other noise; empty when none is declared or seen."""
    random = np.random.default_rng(SEED)
    angle_sd = _angle_noise(conditions, figures)
    sensor = figures.torque_in if conditions.converted else figures.torque_out
    torque_sd = 0.0 if sensor is None else sensor.noise_fraction * sensor.full_scale_nm
    slow = conditions.slow_noise
    if torque_sd == 0.0 and angle_sd == 0.0 and slow.sd_nm == 0.0:
        return []
    laid_out = [
        _even(loop.forward, conditions, 1, torque_sd, angle_sd),
        _even(loop.backward, conditions, -1, torque_sd, angle_sd),
    ]
    found = []
    for _ in range(NOISY_LOOPS):
        forward, backward = (
            made_rising(
                branch.torque_nm
                + torque * random.standard_normal(branch.torque_nm.size)
                + _drawn(slow, branch, random),
                branch.angle_arcmin + angle * random.standard_normal(branch.torque_nm.size),
                np.ones(branch.torque_nm.size),
            )
            for branch, torque, angle in laid_out
        )
        found.append(Loop(forward, backward, loop.method))
    return found


def _drawn(slow: SlowNoise, branch: Branch, random: np.random.Generator) -> FloatArray | float:
    """Draw slow noise along a branch that is laid out evenly: means of as many neighbours as err alike."""
    if slow.sd_nm == 0.0:
        return 0.0
    points = branch.torque_nm.size
    together = max(1, round(slow.along_nm * points / float(np.ptp(branch.torque_nm))))
    sums = np.cumsum(np.append(0.0, random.standard_normal(points + together - 1)))
    drawn: FloatArray = slow.sd_nm / math.sqrt(together) * (sums[together:] - sums[:-together])
    return drawn


def _even(
    branch: Branch, conditions: MeasurementConditions, direction: int, torque_sd: float, angle_sd: float
) -> tuple[Branch, FloatArray | float, float]:
    """Lay a branch out in blocks evenly in time; return it with the noise of a block's torque and wind-up."""
    samples = (conditions.forward if direction > 0 else conditions.backward).samples
    size = -(-samples // MOST_BLOCKS)
    torque = np.linspace(branch.torque_nm[0], branch.torque_nm[-1], -(-samples // size))
    even = Branch(torque, np.interp(torque, branch.torque_nm, branch.angle_arcmin))
    slope = conditions.points(even, direction).slope if conditions.converted else 1.0
    return even, slope * torque_sd / math.sqrt(size), angle_sd / math.sqrt(size)


def _angle_noise(conditions: MeasurementConditions, figures: SensorFigures) -> float:
    """Standard deviation of one sample of the wind-up, arcmin: as declared or, where that is more, as seen."""
    variance = 0.0
    for name, encoder, scale in (
        ("angle_in", figures.angle_in, conditions.method.ratio),
        ("angle_out", figures.angle_out, 1.0),
    ):
        if encoder is not None and name in conditions.encoders:
            variance += (encoder.noise_rad * ARCMIN_PER_RAD / scale) ** 2
    return max(math.sqrt(variance), conditions.noise_seen_arcmin)
