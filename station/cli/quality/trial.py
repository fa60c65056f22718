"""`lostmotion quality trial`: other limits, another rule or another definition of a metric on trial over a lot."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from station.cli.line.line_statistics import figure
from station.cli.quality.quality import lot_note, percent
from station.cli.say import Grid, say
from station.counted import counted
from station.documents.entries import plain
from station.documents.result import Limits
from station.quality.limits_trial import SideRisks, Trial, Tried, draft_of, limits_trial
from station.reevaluation.definition_trial import definition_trial
from station.reports.result_text import limits_text, unit_text
from station.store.quality.lot import Lot, production
from station.store.quality.trial import Rule

EXIT_FAILED = 1
SAID_EVERY = 20
MOST_FAILED = 5


def print_trial(data: Path, lot: Lot, tried: Tried, workers: int | None, person: str | None, *, as_json: bool) -> int:
    """Print what flips, save the draft of a person that is named; return 0, or 1 where a run could not be evaluated.

    Raises as `limits_trial`, or `definition_trial` where another definition is tried, and `draft_of`.
    """
    if tried.definition:
        found = definition_trial(data, lot, tried, workers or os.cpu_count() or 1, told=_tell)
    with production(data) as look:
        if not tried.definition:
            found = limits_trial(look, lot, tried)
        notes = lot_note(look, lot)
    saved = None if person is None else draft_of(data, found, person)
    unit = unit_text(found.metric.unit)
    rows = [(was, new, str(number), "" if was == new else "flips") for was, new, number in found.verdicts]
    blocks: list[str | Grid] = [
        f"{found.metric.name}: {_rule(found.before, unit)} now, {_on_trial(found, unit)} on trial",
        Grid(("now", "on trial", "runs", ""), rows, right=(2,)),
        f"{found.flips} of {found.runs} verdicts flip",
    ]
    moved = [row for one in found.risks for row in _moved_rows(one, found.metric.unit)]
    blocks += [Grid(("side", "", "mean", "standard deviation of the units"), moved, right=(2, 3))] if moved else []
    known = [one for one in found.risks if not one.why]
    if known:
        heads = ("side", "", "beyond the limits", "accepted wrongly (PFA)", "rejected wrongly (PFR)", "NOT DECIDABLE")
        blocks.append(Grid(heads, [row for one in known for row in _risk_rows(one)], right=(2, 3, 4, 5)))
        notes.append(
            "risks: calculated for a normal distribution with the standard deviation of these values, after the "
            f"measurement uncertainty u = {_us(known)} {unit} is subtracted"
        )
    if found.flipped:
        flips = [(one.run, f"{one.before} → {one.after}", one.why) for one in found.flipped]
        blocks.append(Grid(("run", "flips", "why"), flips))
    blocks += [f"side {one.side}: no risks: {one.why}" for one in found.risks if one.why]
    if found.definition:
        notes.append(
            f"{found.evaluated} evaluated now, {found.known} known before; each by its own recipe with this one change"
        )
    failed = [f"not evaluated: {run}: {why}" for run, why in found.not_evaluated]
    blocks += failed[:MOST_FAILED]
    blocks += [f"not evaluated: {counted(len(failed), 'run')} in all"] if len(failed) > MOST_FAILED else []
    blocks += [] if saved is None else [f"saved as draft: {saved.title}, by {person}"]
    document = {**plain(found), "draft": None if saved is None else saved.title}
    say(document, [*blocks, *notes], as_json=as_json)
    return EXIT_FAILED if found.not_evaluated else 0


def _rule(rule: Rule, unit: str) -> str:
    guard = "simple" if rule.guard_factor is None else f"guard band {rule.guard_factor:g}·U"
    return f"{limits_text(Limits(min=rule.limit_min, max=rule.limit_max))} {unit} ({guard})"


def _on_trial(found: Trial, unit: str) -> str:
    defined = f"'{found.definition}': " if found.definition else ""
    return f"{defined}{_rule(found.after, unit)}"


def _tell(done: int, there: int) -> None:
    if done and done % SAID_EVERY == 0:
        sys.stderr.write(f"{done} of {there} runs\n")


def _moved_rows(one: SideRisks, unit: str) -> list[tuple[str, ...]]:
    """Return mean and spread of a side by both definitions; none where only the rule is on trial."""
    if one.on_trial is None:
        return []
    spreads = (("now", one.mean, one.sd_process), ("on trial", one.on_trial.mean, one.on_trial.sd_process))
    return [(one.side, name, _known(mean, unit, 4), _known(sd, unit, 3)) for name, mean, sd in spreads]


def _known(value: float, unit: str, digits: int) -> str:
    return "–" if math.isnan(value) else figure(value, unit, digits)


def _us(risks: Sequence[SideRisks]) -> str:
    return ", ".join(f"{figure(one.u, '', 3)} on side {one.side}" for one in risks)


def _risk_rows(one: SideRisks) -> list[tuple[str, ...]]:
    return [
        (one.side, name, *(percent(share) for share in (r.outside, r.false_accept, r.false_reject, r.undecided)))
        for name, r in (("now", one.before), ("on trial", one.after))
        if r is not None
    ]
