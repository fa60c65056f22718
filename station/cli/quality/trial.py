"""`lostmotion quality trial`: what other limits or another decision rule would do to a lot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from station.cli.line.line_statistics import figure
from station.cli.quality.quality import lot_note, percent
from station.cli.say import Grid, say
from station.documents.entries import plain
from station.documents.result import Limits
from station.quality.limits_trial import SideRisks, Tried, draft_of, limits_trial
from station.reports.result_text import limits_text, unit_text
from station.store.quality.lot import Lot, production
from station.store.quality.trial import Rule


def print_trial(data: Path, lot: Lot, tried: Tried, person: str | None, *, as_json: bool) -> int:
    """Print what flips, save the draft of a person that is named, return 0; raises as `limits_trial`, `draft_of`."""
    with production(data) as look:
        found = limits_trial(look, lot, tried)
        notes = lot_note(look, lot)
    saved = None if person is None else draft_of(data, found, person)
    unit = unit_text(found.metric.unit)
    rows = [(was, new, str(number), "" if was == new else "flips") for was, new, number in found.verdicts]
    blocks: list[str | Grid] = [
        f"{found.metric.name}: {_rule(found.before, unit)} now, {_rule(found.after, unit)} on trial",
        Grid(("now", "on trial", "runs", ""), rows, right=(2,)),
        f"{found.flips} of {found.runs} verdicts flip",
    ]
    known = [one for one in found.risks if not one.why]
    if known:
        heads = ("side", "", "beyond the limits", "accepted wrongly (PFA)", "rejected wrongly (PFR)", "NOT DECIDABLE")
        blocks.append(Grid(heads, [row for one in known for row in _risk_rows(one)], right=(2, 3, 4, 5)))
        notes.append(f"risks: of a normal process, its spread that of the values less u; u is {_us(known)} {unit}")
    blocks += [f"{one.before} → {one.after}  {one.run}" for one in found.flipped]
    blocks += [f"side {one.side}: no risks: {one.why}" for one in found.risks if one.why]
    blocks += [] if saved is None else [f"saved as draft: {saved.title}, by {person}"]
    document = {**plain(found), "draft": None if saved is None else saved.title}
    return say(document, [*blocks, *notes], as_json=as_json)


def _rule(rule: Rule, unit: str) -> str:
    guard = "simple" if rule.guard_factor is None else f"guard band {rule.guard_factor:g}·U"
    return f"{limits_text(Limits(min=rule.limit_min, max=rule.limit_max))} {unit} ({guard})"


def _us(risks: Sequence[SideRisks]) -> str:
    return ", ".join(f"{figure(one.u, '', 3)} on side {one.side}" for one in risks)


def _risk_rows(one: SideRisks) -> list[tuple[str, ...]]:
    return [
        (one.side, name, *(percent(share) for share in (r.outside, r.false_accept, r.false_reject, r.undecided)))
        for name, r in (("now", one.before), ("on trial", one.after))
        if r is not None
    ]
