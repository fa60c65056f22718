"""The budget of a metric: every source's standard uncertainty, sensitivity, contribution and share; U with k = 2.

Sensitivities are central differences: the loop is moved by plus and minus one standard uncertainty of a source, and the
metric is evaluated as it always is. So a new metric needs nothing here. GUM 5.1.3, 5.1.4 note 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from analysis.branches import Branch
from analysis.errors import AnalysisError
from analysis.loop import Loop
from analysis.uncertainty.chain import Move, moves_of
from analysis.uncertainty.circumstances import Circumstances
from analysis.uncertainty.figures import SensorFigures
from analysis.uncertainty.lines import covariance_of, line_moves, quadrants_used, u_torque_nm
from analysis.uncertainty.monte_carlo import Drawn, MonteCarlo, drawn_loops, monte_carlo
from analysis.uncertainty.noise import noisy_loops
from analysis.uncertainty.repeatability import deviation, enlarged
from analysis.uncertainty.sources import SOURCES
from analysis.uncertainty.transfer import transfer_moves

COVERAGE_FACTOR = 2.0
"""k of the expanded uncertainty U = k·u."""

SMOOTH_POINTS = 400
"""Points per branch, about, of the loop that errors are tried on."""

MASKED_AGAIN = 0.5
"""Share of a masked stretch that is left out besides, to see what a fit that continues a branch owes to it.

On the virtual units that moves the spring constant and the wind-up by 1.4 to 1.6 times what the mask itself did.
"""

STUDENT = "Student's t"
NOISE = ("noise", "noise of the sensors, mean of the cycles", "normal")
SCATTER = ("repeatability", "scatter between cycles beyond the noise, enlarged for few cycles (Student)", STUDENT)
TRANSFER = ("transfer", "friction about zero torque and after reversals that the calibration leaves over")
MASKED = ("masked", "stretch after a reversal that is masked, which a fit continues", "rectangular")
ONLY_SCATTER = ("repeatability", "scatter between cycles, enlarged for few cycles (Student)", STUDENT)

Estimate = Callable[[Loop], float]


class BudgetRow(NamedTuple):
    """One quantity: its standard uncertainty in its unit, what a unit of it does to the metric, and its contribution.

    distribution: of `distributions`, or Student's t. contribution: standard uncertainty of the metric from it; share:
    its part of the variance, 0 to 1.
    """

    quantity: str
    text: str
    distribution: str
    u: float
    unit: str
    sensitivity: float
    contribution: float
    share: float


@dataclass(frozen=True)
class Budget:
    """Rows, largest first; combined standard uncertainty u; kind.

    kind: "budget" with every source, "untimed" with all but delay and drift, "repeatability" without figures.
    """

    rows: tuple[BudgetRow, ...]
    u: float
    kind: str
    monte_carlo: MonteCarlo | None = None

    @property
    def expanded(self) -> float:
        """U = k·u, k = 2."""
        return COVERAGE_FACTOR * self.u


class Entry(NamedTuple):
    """One quantity before it is combined: as in `BudgetRow`, its contribution with its sign."""

    quantity: str
    text: str
    distribution: str
    u: float
    unit: str
    contribution: float


class UsedSource(NamedTuple):
    """A source that enters a loop: its distribution, limit, standard uncertainty, and the moves of its components.

    A move is what one unit of `u` does: `scale` is the amount of it that one standard uncertainty stands for.
    """

    id: str
    text: str
    unit: str
    distribution: str
    limit: float
    u: float
    scale: float
    moves: tuple[Move, ...]


def used_sources(loop: Loop, circumstances: Circumstances, figures: SensorFigures) -> tuple[UsedSource, ...]:
    """Return the sources that enter a loop, in the order of their table, calibration lines last."""
    found = []
    for source in SOURCES:
        declared = source.declared(figures, circumstances)
        if declared is None:
            continue
        limit, distribution = declared
        moves = tuple(moves_of(source, loop, circumstances, figures))
        if any(move.moves_anything for move in moves):
            u = declared.u
            found.append(UsedSource(source.id, source.text, source.unit, distribution, limit, u, u, moves))
    for name in quadrants_used(circumstances):
        line = covariance_of(name, circumstances, figures)
        if line is not None:
            u = u_torque_nm(name, line, circumstances)
            moves = line_moves(name, line, loop, circumstances)
            text = f"calibration line, {name.replace('_', ' ')}, at the reference torque"
            found.append(UsedSource(f"calibration_{name}", text, "N·m", "normal", 1.0, u, 1.0, moves))
    u, moves = transfer_moves(loop, circumstances, figures)
    if u > 0.0:
        found.append(UsedSource(*TRANSFER, "N·m", "normal", 1.0, u, 1.0, moves))
    return tuple(found)


def _change(base: float, high: float, low: float) -> float:
    """Half the difference that an error of either sign makes; where both signs move a metric the same way, the larger.

    The wider of two sides does that where they are alike: it has a kink there, and half the difference is nothing.
    """
    if (high - base) * (low - base) <= 0.0:
        return (high - low) / 2.0
    return max(high - base, low - base, key=abs)


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
    """Uncertainty of whatever is read from the loops of one measurement. Perturbed loops are made once, for all."""

    def __init__(self, loop: Loop, circumstances: Circumstances, figures: SensorFigures, draws: int = 0) -> None:
        self.smooth = smoothed(loop)
        self.used = used_sources(self.smooth, circumstances, figures)
        self._pairs = [[(move.applied(self.smooth, one.scale), move.applied(self.smooth, -one.scale))
                        for move in one.moves] for one in self.used]  # fmt: skip
        self._shorter = _shorter(self.smooth, circumstances.masked_nm)
        self._noisy = noisy_loops(loop, circumstances, figures)
        drawn = [Drawn(one.distribution, one.limit, one.moves) for one in self.used]
        self._drawn = drawn_loops(self.smooth, drawn, draws) if draws else []

    def budget(self, estimate: Estimate, values: Sequence[float], unit: str) -> Budget:
        """Return the budget of a metric whose values per cycle are given; AnalysisError where a moved loop has none."""
        base = estimate(self.smooth)
        entries = self._of_masked(estimate, base, unit)
        for one, pairs in zip(self.used, self._pairs, strict=True):
            changes = [_change(base, estimate(high), estimate(low)) for high, low in pairs]
            # one component keeps its sign; of several with unknown phase only the size means something
            contribution = changes[0] if len(changes) == 1 else math.hypot(*changes)
            entries.append(Entry(one.id, one.text, one.distribution, one.u, one.unit, contribution))
        noise = self.noise(estimate)
        found = combined(entries, noise, values, unit)
        if not self._drawn:
            return found
        cycles = max(len(values), 1)
        drawn = monte_carlo(
            estimate,
            self.smooth,
            self._drawn,
            float(np.mean(values)),
            noise=noise / math.sqrt(cycles),
            scatter=_beyond(values, noise),
            freedom=cycles - 1,
        )
        return replace(found, monte_carlo=drawn)

    def _of_masked(self, estimate: Estimate, base: float, unit: str) -> list[Entry]:
        """Return what a metric owes to the masked stretch: at most what half as much again of it would change."""
        if self._shorter is None:
            return []
        try:
            u = abs(estimate(self._shorter) - base) / math.sqrt(3.0)
        except AnalysisError:
            return []  # it reads a branch where it was measured, and continues none
        return [Entry(*MASKED, u, unit, u)] if u else []

    def noise(self, estimate: Estimate) -> float:
        """Return the standard deviation of one cycle's value by the noise of the sensors."""
        return deviation([estimate(loop) for loop in self._noisy])


def combined(entries: Sequence[Entry], noise: float, values: Sequence[float], unit: str) -> Budget:
    """Combine systematic entries with the noise and scatter of the cycles."""
    cycles = max(len(values), 1)
    u_noise = noise / math.sqrt(cycles)
    known = math.hypot(u_noise, *(entry.contribution for entry in entries))
    rows = [*entries, Entry(*NOISE, u_noise, unit, u_noise)] if noise else [*entries]
    if cycles > 1:
        scatter = enlarged(known, _beyond(values, noise), cycles - 1)
        rows.append(Entry(*SCATTER, scatter, unit, scatter))
    return _budget(rows, "budget")


def _beyond(values: Sequence[float], noise: float) -> float:
    """Standard deviation of the mean by what scatters between cycles beyond the noise."""
    return math.sqrt(max(deviation(values) ** 2 - noise**2, 0.0) / max(len(values), 1))


def of_scatter(values: Sequence[float], unit: str) -> Budget | None:
    """Return what can be said without any figures: the scatter of the cycles. None for fewer than two cycles."""
    if len(values) < 2:
        return None
    u = enlarged(0.0, deviation(values) / math.sqrt(len(values)), len(values) - 1)
    return only(Entry(*ONLY_SCATTER, u, unit, u))


def only(entry: Entry) -> Budget:
    """Return the budget of a measurement of which nothing is declared: the one thing that its scatter shows."""
    return _budget([entry], "repeatability")


def _budget(entries: Sequence[Entry], kind: str) -> Budget:
    contributions = np.array([entry.contribution for entry in entries])
    if not np.isfinite(contributions).all():
        raise AnalysisError(
            "the uncertainty has no number: a metric of a loop moved by an error of its sensors has none"
        )
    variance = float(np.square(contributions).sum())
    rows = [
        BudgetRow(
            name, text, drawn, u, row_unit, part / u if u else 0.0, abs(part), part**2 / variance if variance else 0.0
        )
        for name, text, drawn, u, row_unit, part in entries
    ]
    return Budget(tuple(sorted(rows, key=lambda row: -row.contribution)), math.sqrt(variance), kind)
