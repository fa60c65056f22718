"""Rules by which a control chart says that a process has changed, and how often they say so of one that has not.

Every rule is a row. What a choice of rules costs is their average run length (ARL): how many points pass on average
until a steady process raises a false alarm. Rules that look at zones alone are a Markov chain, whose ARL is exact
(C. Champ and W. Woodall 1987, "Exact results for Shewhart control charts with supplementary runs rules", Technometrics
29); rules that compare a point with the one before it are simulated, with the error stated. Points are in standard
deviations of the plotted statistic from the centre, normal and independent, with known limits. What the chart of the
spread beside it adds stands in `chart_run_length`.

Sources: Western Electric, Statistical Quality Control Handbook (1956); L. Nelson (1984), "The Shewhart control chart:
tests for special causes", Journal of Quality Technology 16.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import scipy  # loads special where it is used

from analysis.trace.errors import AnalysisError
from analysis.trace.units import BoolArray, FloatArray

Kind = Literal["beyond", "within", "outside", "rising", "alternating"]


@dataclass(frozen=True)
class Rule:
    """A rule: `count` of the last `of` points are `kind`.

    kind: `beyond` sigma on one and the same side; `within` sigma on either side; `outside` sigma on either side;
    `rising`: each point above the one before it, or each below; `alternating`: up and down in turn. sigma: in standard
    deviations of the plotted statistic, of no meaning for the last two.
    """

    kind: Kind
    count: int
    of: int
    sigma: float
    text: str


RULES: dict[str, Rule] = {
    "limit": Rule("beyond", 1, 1, 3.0, "one point beyond 3 σ"),
    "two-of-three": Rule("beyond", 2, 3, 2.0, "two of three points beyond 2 σ on one side"),
    "four-of-five": Rule("beyond", 4, 5, 1.0, "four of five points beyond 1 σ on one side"),
    "eight-on-a-side": Rule("beyond", 8, 8, 0.0, "eight points in a row on one side of the centre"),
    "nine-on-a-side": Rule("beyond", 9, 9, 0.0, "nine points in a row on one side of the centre"),
    "six-rising": Rule("rising", 6, 6, 0.0, "six points in a row, all rising or all falling"),
    "fourteen-alternating": Rule("alternating", 14, 14, 0.0, "fourteen points in a row, up and down in turn"),
    "fifteen-within": Rule("within", 15, 15, 1.0, "fifteen points in a row within 1 σ of the centre"),
    "eight-outside": Rule("outside", 8, 8, 1.0, "eight points in a row beyond 1 σ on either side"),
}
"""Rules by their names."""

RULE_SETS: dict[str, tuple[str, ...]] = {
    "shewhart": ("limit",),
    "western-electric": ("limit", "two-of-three", "four-of-five", "eight-on-a-side"),
    "nelson": (
        "limit", "nine-on-a-side", "six-rising", "fourteen-alternating", "two-of-three", "four-of-five",
        "fifteen-within", "eight-outside",
    ),
}  # fmt: skip
"""Sets of rules by the names under which they were published; `shewhart`, 3 σ alone, is the default of a chart."""

BY_ZONE = ("beyond", "within", "outside")
"""Kinds that a Markov chain over zones describes."""

SERIES = 4000
BLOCK = 250
"""Simulated processes, and the points by which each of them is carried on at a time."""

MOST_POINTS = 40_000
"""Points after which a simulated process counts as ended: no set of rules that is simulated lasts as long."""

SEED = 19_840_708
"""A simulated run length repeats to the last digit."""


class Signal(NamedTuple):
    """A rule and the point, counted from 1, that completed it."""

    rule: str
    point: int


class RunLength(NamedTuple):
    """Average run length in points, and its standard error: 0 where it was computed exactly."""

    points: float
    standard_error: float


def rules_of(names: str | Sequence[str]) -> tuple[str, ...]:
    """Return rules by the name of a set or of single rules; AnalysisError names what there is."""
    asked = [names] if isinstance(names, str) else list(names)
    found: dict[str, None] = {}
    for name in asked:
        if name not in RULES and name not in RULE_SETS:
            raise AnalysisError(
                f"rules: found '{name:.40}'; allowed: the rule sets {', '.join(RULE_SETS)} or the rules "
                f"{', '.join(RULES)}"
            )
        found |= dict.fromkeys(RULE_SETS.get(name, (name,)))
    if not found:
        raise AnalysisError(f"rules: none is named; choose one of the rule sets {', '.join(RULE_SETS)}")
    return tuple(found)


def signals(points: FloatArray, rules: Sequence[str]) -> tuple[Signal, ...]:
    """Return every point that completes a rule, in order; points in standard deviations from the centre."""
    found = [
        Signal(name, int(place) + 1) for name in rules for place in np.flatnonzero(_completed(points, RULES[name]))
    ]
    return tuple(sorted(found, key=lambda one: (one.point, rules.index(one.rule))))


def average_run_length(
    rules: Sequence[str], shift: float = 0.0, *, beside: float = 0.0, most_step: float = math.inf
) -> RunLength:
    """Return the average run length of rules together.

    rules: names of `RULES`. shift: by how many standard deviations of the plotted statistic the process stands off its
    centre; 0 is a process without change, of which every signal is a false alarm. beside: probability with which each
    point is signalled by something else, whatever the points are. most_step: distance of a point from the one before
    it, in the same standard deviations, beyond which it is signalled too; inf for none.
    """
    return _run_length(tuple(rules), shift, beside, most_step)


@functools.cache
def _run_length(rules: tuple[str, ...], shift: float, beside: float, most_step: float) -> RunLength:
    if most_step == math.inf and all(RULES[name].kind in BY_ZONE for name in rules):
        return RunLength(_exact(rules, shift, beside), 0.0)
    return _simulated(rules, shift, beside, most_step)


def _completed(points: FloatArray, rule: Rule) -> BoolArray:
    """Return which points complete a rule; the last axis is the order of the points."""
    if rule.kind == "beyond":
        return _filled(points > rule.sigma, rule) | _filled(points < -rule.sigma, rule)
    if rule.kind == "within":
        return _filled(np.abs(points) < rule.sigma, rule)
    if rule.kind == "outside":
        return _filled(np.abs(points) > rule.sigma, rule)
    steps = np.diff(points, axis=-1)
    if rule.kind == "rising":
        inner = Rule(rule.kind, rule.count - 1, rule.of - 1, 0.0, rule.text)
        found = _filled(steps > 0.0, inner) | _filled(steps < 0.0, inner)
        return np.concatenate([np.zeros_like(found[..., :1]), found], axis=-1)
    inner = Rule(rule.kind, rule.count - 2, rule.of - 2, 0.0, rule.text)
    found = _filled(steps[..., 1:] * steps[..., :-1] < 0.0, inner)
    return np.concatenate([np.zeros_like(points[..., :2], dtype=np.bool_), found], axis=-1)[..., : points.shape[-1]]


def _filled(hits: BoolArray, rule: Rule) -> BoolArray:
    """Return the points at which so many of the last ones are hits; the last of them is one."""
    sums = np.cumsum(hits, axis=-1, dtype=np.int32)
    window = sums.copy()
    window[..., rule.of :] -= sums[..., : -rule.of] if hits.shape[-1] > rule.of else 0
    found: BoolArray = (window >= rule.count) & hits
    return found


_History = tuple[tuple[bool, ...], ...]


def _exact(rules: Sequence[str], shift: float, beside: float = 0.0) -> float:
    """Run length of rules of zones, as the mean time to absorption of a Markov chain over what a rule remembers.

    A signal from beside absorbs it from every state alike, so each step goes on with 1 − beside of its probability.
    """
    chosen = [RULES[name] for name in rules]
    zones = _zones(chosen, shift)
    numbers: dict[_History, int] = {}
    rows: list[dict[int, float]] = []
    start: _History = tuple(() for _ in _watches(chosen))
    waiting = [start]
    numbers[start] = 0
    while waiting:
        state = waiting.pop()
        row: dict[int, float] = {}
        for hits, probability in zones:
            after = _after(state, hits, chosen)
            if after is None:
                continue
            if after not in numbers:
                numbers[after] = len(numbers)
                waiting.append(after)
            row[numbers[after]] = row.get(numbers[after], 0.0) + (1.0 - beside) * probability
        while len(rows) <= numbers[state]:
            rows.append({})
        rows[numbers[state]] = row
    size = len(numbers)
    matrix = np.eye(size)
    for number, row in enumerate(rows):
        for to, probability in row.items():
            matrix[number, to] -= probability
    return float(np.linalg.solve(matrix, np.ones(size))[0])


def _watches(chosen: Sequence[Rule]) -> list[tuple[Rule, float]]:
    """Return what is remembered: each rule once, and a rule of one side once for each."""
    found = []
    for rule in chosen:
        found += [(rule, 1.0), (rule, -1.0)] if rule.kind == "beyond" else [(rule, 0.0)]
    return found


def _zones(chosen: Sequence[Rule], shift: float) -> list[tuple[tuple[bool, ...], float]]:
    """Return the zones between all lines of the rules: what a point there is a hit of, and how probable it is."""
    lines = sorted({side * rule.sigma for rule in chosen for side in (-1.0, 1.0)})
    edges = [-math.inf, *lines, math.inf]
    found = []
    for low, high in itertools.pairwise(edges):
        inside = 0.5 * (max(low, lines[0] - 1.0) + min(high, lines[-1] + 1.0))
        hits = tuple(_hit(inside, rule, side) for rule, side in _watches(chosen))
        found.append((hits, float(scipy.special.ndtr(high - shift) - scipy.special.ndtr(low - shift))))
    return found


def _hit(point: float, rule: Rule, side: float) -> bool:
    if rule.kind == "beyond":
        return point * side > rule.sigma
    return abs(point) < rule.sigma if rule.kind == "within" else abs(point) > rule.sigma


def _after(state: _History, hits: Sequence[bool], chosen: Sequence[Rule]) -> _History | None:
    """Return what is remembered after a point; None where a rule is complete.

    Of the last points only those count from which a rule can still be completed: leading misses are forgotten, so
    that as few states as possible differ.
    """
    found = []
    for (rule, _), history, hit in zip(_watches(chosen), state, hits, strict=True):
        window = (*history, hit)[-rule.of :]
        if hit and sum(window) >= rule.count:
            return None
        kept = window[-(rule.of - 1) :] if rule.of > 1 else ()
        while kept and (not kept[0] or sum(kept) + rule.of - len(kept) < rule.count):
            kept = kept[1:]
        found.append(kept)
    return tuple(found)


def _simulated(rules: Sequence[str], shift: float, beside: float = 0.0, most_step: float = math.inf) -> RunLength:
    """Run length by simulation, with the functions that judge a chart.

    Signals from beside are not drawn: a run that ends at point N by the rules ends with them after the sum of
    (1 − beside)^t for t from 0 to N − 1 on average, which is (1 − (1 − beside)^N) / beside.
    """
    random = np.random.default_rng(SEED)
    memory = max(RULES[name].of for name in rules)
    before = np.empty((SERIES, 0))
    lengths = np.full(SERIES, float(MOST_POINTS))
    alive = np.arange(SERIES)
    for begin in range(0, MOST_POINTS, BLOCK):
        new = random.standard_normal((alive.size, BLOCK)) + shift
        points = np.concatenate([before, new], axis=1)
        hit = np.zeros(points.shape, dtype=np.bool_)
        for name in rules:
            hit |= _completed(points, RULES[name])
        hit[:, 1:] |= np.abs(np.diff(points, axis=1)) > most_step
        hit = hit[:, before.shape[1] :]
        ended = hit.any(axis=1)
        lengths[alive[ended]] = begin + 1 + np.argmax(hit[ended], axis=1)
        alive, before = alive[~ended], points[~ended, -memory:]
        if not alive.size:
            break
    if beside > 0.0:
        lengths = -np.expm1(lengths * math.log1p(-beside)) / beside
    return RunLength(float(lengths.mean()), float(lengths.std(ddof=1)) / math.sqrt(SERIES))
