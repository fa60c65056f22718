"""What limits on trial come to, as words and tables of a page."""

from __future__ import annotations

import math
from html import escape
from urllib.parse import quote

from analysis.evaluation.guard_band import Risks
from definitions.metrics import METRICS
from station.documents.result import Limits
from station.quality.limits_trial import SideRisks, Trial
from station.reports.result_text import limits_text, minus, unit_text
from station.run.screen.progress import clock
from station.store.quality.trial import Rule
from station.web.definition_trials import TrialState
from station.web.languages import Words
from station.web.pages.quality_figures import title_of
from station.web.pages.words import FURTHER_REASONS, reason_said

LEAST_S = 5.0
"""From when on it is told how long a trial takes still: what starts takes a second or two."""

MOST_FAILED = 10

NONE = "none"
"""What takes a limit away."""


FLIP = (
    "{metric}: {before} so far, {after} on trial. {count} of {runs} verdicts flips.",
    "{metric}: {before} so far, {after} on trial. {count} of {runs} verdicts flip.",
)
FLIP_BY_DEFINITION = (
    "{metric}: {before} so far, {definition}: {after} on trial. {count} of {runs} verdicts flips.",
    "{metric}: {before} so far, {definition}: {after} on trial. {count} of {runs} verdicts flip.",
)
"""What is said of one verdict that flips, and of several."""

NOT_EVALUATED = ("{count} run not evaluated:", "{count} runs not evaluated:")


def trial_words(found: Trial, say: Words) -> str:
    """Return what was tried, and how many verdicts flip."""
    unit = unit_text(found.metric.unit)
    return say.counted(
        found.flips,
        *(FLIP_BY_DEFINITION if found.definition else FLIP),
        metric=title_of(found.metric.metric, found.metric.choices),
        before=_rule(found.before, unit, say),
        definition=found.definition,
        after=_rule(found.after, unit, say),
        runs=found.runs,
    )


def definition_title(text: str) -> str:
    """Return how people call a definition: the title of another metric before its id; choices stand for themselves."""
    metric, _, choices = text.partition(" ")
    return choices or f"{METRICS[metric].title} · {metric}"


FAR = ("{definition}: {done} of {count} run evaluated.", "{definition}: {done} of {count} runs evaluated.")
FAR_AND_LEFT = (
    "{definition}: {done} of {count} run evaluated, about {left} left.",
    "{definition}: {done} of {count} runs evaluated, about {left} left.",
)
"""How far a trial is, of one run and of several."""


def progress_words(now: TrialState, say: Words) -> str:
    """Return how far a definition on trial is, and how long it takes still."""
    if not now.of:
        return say("Starting.")
    told = {"definition": now.tried.definition, "done": str(now.done)}
    new = now.done - now.known
    if new < 1 or now.seconds < LEAST_S:
        return say.counted(now.of, *FAR, **told)
    return say.counted(now.of, *FAR_AND_LEFT, **told, left=clock(now.seconds / new * (now.of - now.done)))


def _rule(rule: Rule, unit: str, say: Words) -> str:
    factor = rule.guard_factor
    guard = say("simple rule") if factor is None else say("guard band {factor}·U", factor=f"{factor:g}")
    if rule.limit_min is None and rule.limit_max is None:
        return say("no limit ({guard})", guard=guard)
    return f"{limits_text(Limits(min=rule.limit_min, max=rule.limit_max))} {unit} ({guard})"


def failed_html(found: Trial, say: Words) -> str:
    """Return the runs that could not be evaluated, with why; nothing where there are none."""
    if not found.not_evaluated:
        return ""
    rows = "".join(f"<li>{escape(run)}: {escape(say(why))}</li>" for run, why in found.not_evaluated[:MOST_FAILED])
    return f"<p>{escape(say.counted(len(found.not_evaluated), *NOT_EVALUATED))}</p><ul>{rows}</ul>"


def verdicts_html(found: Trial, say: Words) -> str:
    """Return how many runs have which verdict now and on trial."""
    flips = escape(say("flips"))
    rows = "".join(
        f'<tr><td>{escape(say(was))}</td><td>{escape(say(new))}</td><td class="n">{number}</td>'
        f"<td>{'' if was == new else f'<b>{flips}</b>'}</td></tr>"
        for was, new, number in found.verdicts
    )
    heads = f'<th>{say("so far")}</th><th>{say("on trial")}</th><th class="n">{say("runs")}</th><th></th>'
    return f'<table class="lm"><tr>{heads}</tr>{rows}</table>'


RISKS = ("beyond the limits", "accepted wrongly (PFA)", "rejected wrongly (PFR)", "NOT DECIDABLE")
"""Heads of the table of risks."""


def risks_html(found: Trial, say: Words) -> str:
    """Return the risks of wrong decisions before and after, or why they cannot be told."""
    rows = ""
    for one in found.risks:
        side = "" if one.side == "both" else say("side {side}", side=minus(one.side))
        rows += _moved_rows(side, one, unit_text(found.metric.unit), say)
        if one.before is None or one.after is None:
            why = say("no risks: {why}", why=say(one.why))
            rows += f'<tr><td>{escape(side)}</td><td colspan="5">{escape(why)}</td></tr>'
            continue
        rows += _risk_row(side, say("so far"), one.before) + _risk_row("", say("on trial"), one.after)
    heads = "".join(f'<th class="n">{escape(say(head))}</th>' for head in RISKS)
    return f'<table class="lm"><tr><th></th><th></th>{heads}</tr>{rows}</table>'


def _moved_rows(side: str, one: SideRisks, unit: str, say: Words) -> str:
    """Return the mean of a side by both definitions; nothing where only the rule is on trial."""
    if one.on_trial is None:
        return ""
    means = (one.mean, one.on_trial.mean)
    now, tried = (f"{'–' if math.isnan(mean) else minus(f'{mean:.4g}')} {unit}" for mean in means)
    told = say("mean so far {now}; on trial {tried}", now=now, tried=tried)
    return f'<tr><td>{escape(side)}</td><td colspan="5">{escape(told)}</td></tr>'


def _risk_row(side: str, when: str, found: Risks) -> str:
    shares = (found.outside, found.false_accept, found.false_reject, found.undecided)
    cells = "".join(f'<td class="n">{100 * one:.2f} %</td>' for one in shares)
    return f"<tr><td>{escape(side)}</td><td>{escape(when)}</td>{cells}</tr>"


def flips_html(found: Trial, most: int, say: Words) -> str:
    """Return the runs that flip with links to them, newest first."""
    if not found.flipped:
        return ""
    rows = "".join(
        f'<tr><td><a href="/runs/{quote(one.run, safe="")}">{escape(one.run)}</a></td>'
        f"<td>{escape(say(one.before))} → {escape(say(one.after))}</td><td>{escape(why_said(one.why, say))}</td></tr>"
        for one in found.flipped
    )
    newest = escape(say("The newest {most} of {flips}.", most=most, flips=found.flips))
    more = f"<p>{newest}</p>" if found.flips > len(found.flipped) else ""
    heads = "".join(f"<th>{escape(head)}</th>" for head in (say("run"), say("flips"), say("why")))
    return f'<table class="lm"><tr>{heads}</tr>{rows}</table>{more}'


def why_said(why: str, say: Words) -> str:
    """Return what decides the verdict of a run: each side that does, and what the other metrics say, or its reason."""
    first, *further = FURTHER_REASONS.split(why)
    parts = [(one, say(one)) for one in first.split("; ")]
    whole = reason_said(first, say)
    # A reason of an evaluation is looked up in one piece: a semicolon is part of it.
    pieces = [whole] if whole != first and any(one == said for one, said in parts) else [said for _, said in parts]
    return say.whole(minus("; ".join([*pieces, *(say(one) for one in further)])))
