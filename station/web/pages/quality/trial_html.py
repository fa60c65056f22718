"""What limits on trial come to, as words and tables of a page."""

from __future__ import annotations

import math
from html import escape
from urllib.parse import quote

from analysis.evaluation.guard_band import Risks
from definitions.metrics import METRICS
from station.counted import counted
from station.documents.result import Limits
from station.quality.limits_trial import SideRisks, Trial
from station.reports.result_text import limits_text, minus, unit_text
from station.run.screen.progress import clock
from station.store.quality.trial import Rule
from station.web.definition_trials import TrialState
from station.web.pages.quality_figures import title_of

LEAST_S = 5.0
"""From when on it is told how long a trial takes still: what starts takes a second or two."""

MOST_FAILED = 10

NONE = "none"
"""What takes a limit away."""


def trial_words(found: Trial) -> str:
    """Return what was tried, and how many verdicts flip."""
    unit = unit_text(found.metric.unit)
    name = title_of(found.metric.metric, found.metric.choices)
    defined = f"{found.definition}: " if found.definition else ""
    rules = f"{_rule(found.before, unit)} now, {defined}{_rule(found.after, unit)} on trial"
    return f"{name}: {rules}. {found.flips} of {found.runs} verdicts flip."


def definition_title(text: str) -> str:
    """Return how people call a definition: the title of another metric before its id; choices stand for themselves."""
    metric, _, choices = text.partition(" ")
    return choices or f"{METRICS[metric].title} · {metric}"


def progress_words(now: TrialState) -> str:
    """Return how far a definition on trial is, and how long it takes still."""
    far = f"{now.tried.definition}: {now.done} of {counted(now.of, 'run')} evaluated" if now.of else "Starting"
    new = now.done - now.known
    if new < 1 or now.seconds < LEAST_S:
        return f"{far}."
    return f"{far}, about {clock(now.seconds / new * (now.of - now.done))} left."


def _rule(rule: Rule, unit: str) -> str:
    guard = "simple rule" if rule.guard_factor is None else f"guard band {rule.guard_factor:g}·U"
    if rule.limit_min is None and rule.limit_max is None:
        return f"no limit ({guard})"
    return f"{limits_text(Limits(min=rule.limit_min, max=rule.limit_max))} {unit} ({guard})"


def failed_html(found: Trial) -> str:
    """Return the runs that could not be evaluated, with why; nothing where there are none."""
    if not found.not_evaluated:
        return ""
    rows = "".join(f"<li>{escape(run)}: {escape(why)}</li>" for run, why in found.not_evaluated[:MOST_FAILED])
    return f"<p>{counted(len(found.not_evaluated), 'run')} not evaluated:</p><ul>{rows}</ul>"


def verdicts_html(found: Trial) -> str:
    """Return how many runs have which verdict now and on trial."""
    rows = "".join(
        f'<tr><td>{escape(was)}</td><td>{escape(new)}</td><td class="n">{number}</td>'
        f"<td>{'' if was == new else '<b>flips</b>'}</td></tr>"
        for was, new, number in found.verdicts
    )
    return f'<table class="lm"><tr><th>now</th><th>on trial</th><th class="n">runs</th><th></th></tr>{rows}</table>'


def risks_html(found: Trial) -> str:
    """Return the risks of wrong decisions before and after, or why they cannot be told."""
    rows = ""
    for one in found.risks:
        side = "" if one.side == "both" else f"side {minus(one.side)}"
        rows += _moved_rows(side, one, unit_text(found.metric.unit))
        if one.before is None or one.after is None:
            rows += f'<tr><td>{escape(side)}</td><td colspan="5">no risks: {escape(one.why)}</td></tr>'
            continue
        rows += _risk_row(side, "now", one.before) + _risk_row("", "on trial", one.after)
    heads = "".join(f'<th class="{kind}">{head}</th>' for head, kind in (
        ("", ""), ("", ""), ("beyond the limits", "n"), ("accepted wrongly (PFA)", "n"),
        ("rejected wrongly (PFR)", "n"), ("NOT DECIDABLE", "n")))  # fmt: skip
    return f'<table class="lm"><tr>{heads}</tr>{rows}</table>'


def _moved_rows(side: str, one: SideRisks, unit: str) -> str:
    """Return the mean of a side by both definitions; nothing where only the rule is on trial."""
    if one.on_trial is None:
        return ""
    means = (("now", one.mean), ("on trial", one.on_trial.mean))
    told = "; ".join(f"{when} {'–' if math.isnan(mean) else minus(f'{mean:.4g}')} {unit}" for when, mean in means)
    return f'<tr><td>{escape(side)}</td><td colspan="5">mean {escape(told)}</td></tr>'


def _risk_row(side: str, when: str, found: Risks) -> str:
    shares = (found.outside, found.false_accept, found.false_reject, found.undecided)
    cells = "".join(f'<td class="n">{100 * one:.2f} %</td>' for one in shares)
    return f"<tr><td>{escape(side)}</td><td>{when}</td>{cells}</tr>"


def flips_html(found: Trial, most: int) -> str:
    """Return the runs that flip with links to them, newest first."""
    if not found.flipped:
        return ""
    rows = "".join(
        f'<tr><td><a href="/runs/{quote(one.run, safe="")}">{escape(one.run)}</a></td>'
        f"<td>{escape(one.before)} → {escape(one.after)}</td><td>{escape(minus(one.why))}</td></tr>"
        for one in found.flipped
    )
    more = f"<p>The newest {most} of {found.flips}.</p>" if found.flips > len(found.flipped) else ""
    return f'<table class="lm"><tr><th>run</th><th>flips</th><th>why</th></tr>{rows}</table>{more}'
