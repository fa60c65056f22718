"""What the page of a recipe shows of a dry run: its verdict, what that proves, and its limits on trial."""

from __future__ import annotations

from html import escape
from urllib.parse import urlencode

from station.counted import counted
from station.documents.result import Limits
from station.quality.text_on_trial import TextTrial, TextTried
from station.reports.headline import remaining_reasons
from station.reports.result_text import limits_text, unit_text
from station.web.languages import ENGLISH, words_of
from station.web.pages.operator_text import metrics_table
from station.web.pages.quality.trial_html import NONE
from station.web.pages.quality_figures import title_of
from station.web.pages.words import NOT_BELIEVED, VERDICTS
from station.web.recipe_text.dry_run import FAILED, IDLE, TRYING, DryRun

TRIAL_UNIT = (
    '<p class="lm-warning" id="trial-unit">The trial unit is made from the limits and the catalogue values of this '
    "text and moves with them. The dry run proves that the recipe runs, not that its limits are right.</p>"
)


def dry_run_html(now: DryRun, stage: str) -> str:
    """Return where a dry run is, and its result; stage: as it is for the text that is shown."""
    if stage == IDLE:
        return (
            "<p>Runs this text with a virtual unit that has the catalogue values of the model. Nothing is stored.</p>"
        )
    if stage == TRYING:
        return f"<p>{escape(now.title)} is being tried. {escape(now.said)}</p>"
    if stage == FAILED or now.result is None:
        return f'<p class="lm-problem">{escape(now.said)}</p>'
    result = now.result
    shown = VERDICTS[result.verdict] if result.state == "complete" else NOT_BELIEVED
    word = shown.word if result.state == "complete" else result.state.upper()
    reasons = "".join(f"<p>{escape(one)}</p>" for one in remaining_reasons(result)[:4])
    tile = f'<div class="lm-tile lm-small {shown.style}">{shown.shape}<b>{escape(word)}</b></div>'
    table = metrics_table(result, words_of(ENGLISH))
    return f"{tile}{TRIAL_UNIT}{reasons}{table}<p>The dry run took {now.took_s:.0f} s.</p>"


def text_trial_html(found: TextTrial) -> str:
    """Return what the limits of a text do to the runs of its recipe that are there, each metric with its trial."""
    if found.lot is None:
        said = "No valid run of this recipe is there that its limits could be tried on."
    elif not (found.tried or found.left):
        said = "The newest run of this recipe was judged by the same limits."
    else:
        said = ""
    rows = "".join(f"<li>{_tried(one, found)}</li>" for one in found.tried)
    rows += "".join(
        f"<li>{escape(name)}: not tried: the runs have another definition of it, or its spread has a limit too.</li>"
        for name in found.left
    )
    parts = (f"<p>{said}</p>" if said else "", f"<ul>{rows}</ul>" if rows else "")
    return f'<div class="lm-trial" id="text-trial">{"".join(parts)}</div>'


def _tried(one: TextTried, found: TextTrial) -> str:
    what, lot = one.metric, found.lot
    limits = f"{limits_text(Limits(min=one.limit_min, max=one.limit_max))} {unit_text(what.unit)}".strip()
    virtual = lot is not None and lot.virtual
    fields = {"recipe": lot.recipe if lot else "", "virtual": "1" if virtual else "", "metric": what.name}
    new = {"min": (one.limit_min, what.limit_min), "max": (one.limit_max, what.limit_max)}
    fields |= {name: NONE if now is None else f"{now:g}" for name, (now, before) in new.items() if now != before}
    address = urlencode({name: text for name, text in fields.items() if text})
    units = " on the virtual bench" if virtual else ""
    return (
        f"{escape(title_of(what.metric, what.choices))}, limit {escape(limits)}: of the newest "
        f"{counted(one.runs, 'first attempt')}{units} <b>{one.would_fail} would fail</b>, {one.fail_now} fail now "
        f'(<a href="/quality?{escape(address)}">see which</a>).'
    )
