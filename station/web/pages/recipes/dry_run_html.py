"""What the page of a recipe shows of a dry run: its verdict, what that proves, and its limits on trial."""

from __future__ import annotations

from html import escape
from urllib.parse import urlencode

from station.documents.result import Limits
from station.quality.text_on_trial import TextTrial, TextTried
from station.reports.headline import remaining_reasons
from station.reports.result_text import limits_text, unit_text
from station.web.languages import Words
from station.web.pages.operator_text import metrics_table
from station.web.pages.quality.trial_html import NONE
from station.web.pages.quality_figures import title_of
from station.web.pages.words import NOT_BELIEVED, VERDICTS, reason_said
from station.web.recipe_text.dry_run import FAILED, IDLE, TRYING, DryRun

TRIAL_UNIT = (
    "The trial unit is made from the limits and the catalogue values of this text and moves with them. The dry run "
    "proves that the recipe runs, not that its limits are right."
)

NOT_TRIED = "{metric}: not tried: the runs have another definition of it, or its spread has a limit too."

ON_TRIAL = {
    False: (
        "{metric}, limit {limits}: of the newest {count} first attempt {would} would fail, {fail} fail now ({see}).",
        "{metric}, limit {limits}: of the newest {count} first attempts {would} would fail, {fail} fail now ({see}).",
    ),
    True: (
        (
            "{metric}, limit {limits}: on the virtual bench {would} of {count} first attempt would fail, "
            "{fail} fail now ({see})."
        ),
        (
            "{metric}, limit {limits}: on the virtual bench {would} of the newest {count} first attempts would fail, "
            "{fail} fail now ({see})."
        ),
    ),
}
"""What is said of a metric on trial, of one run and of several; by whether the virtual bench made them."""


def dry_run_html(now: DryRun, stage: str, say: Words) -> str:
    """Return where a dry run is, and its result; stage: as it is for the text that is shown."""
    if stage == IDLE:
        said = say("Runs this text with a virtual unit that has the catalogue values of the model. Nothing is stored.")
        return f"<p>{escape(said)}</p>"
    if stage == TRYING:
        return f"<p>{escape(say('{title} is being tried. {said}', title=say(now.title), said=now.said))}</p>"
    if stage == FAILED or now.result is None:
        return f'<p class="lm-problem">{escape(say(now.said))}</p>'
    result = now.result
    shown = VERDICTS[result.verdict] if result.state == "complete" else NOT_BELIEVED
    word = shown.word if result.state == "complete" else result.state.upper()
    reasons = "".join(f"<p>{escape(reason_said(one, say))}</p>" for one in remaining_reasons(result)[:4])
    tile = f'<div class="lm-tile lm-small {shown.style}">{shown.shape}<b>{escape(say(word))}</b></div>'
    proves = f'<p class="lm-warning" id="trial-unit">{escape(say(TRIAL_UNIT))}</p>'
    took = f"<p>{escape(say('The dry run took {seconds} s.', seconds=f'{now.took_s:.0f}'))}</p>"
    return f"{tile}{proves}{reasons}{metrics_table(result, say)}{took}"


def text_trial_html(found: TextTrial, say: Words) -> str:
    """Return what the limits of a text do to the runs of its recipe that are there, each metric with its trial."""
    if found.lot is None:
        said = say("No valid run of this recipe is there that its limits could be tried on.")
    elif not (found.tried or found.left):
        said = say("The newest run of this recipe was judged by the same limits.")
    else:
        said = ""
    rows = "".join(f"<li>{_tried(one, found, say)}</li>" for one in found.tried)
    rows += "".join(f"<li>{escape(say(NOT_TRIED, metric=name))}</li>" for name in found.left)
    parts = (f"<p>{escape(said)}</p>" if said else "", f"<ul>{rows}</ul>" if rows else "")
    return f'<div class="lm-trial" id="text-trial">{"".join(parts)}</div>'


def _tried(one: TextTried, found: TextTrial, say: Words) -> str:
    what, lot = one.metric, found.lot
    limits = f"{limits_text(Limits(min=one.limit_min, max=one.limit_max))} {unit_text(what.unit)}".strip()
    virtual = lot is not None and lot.virtual
    fields = {"recipe": lot.recipe if lot else "", "virtual": "1" if virtual else "", "metric": what.name}
    new = {"min": (one.limit_min, what.limit_min), "max": (one.limit_max, what.limit_max)}
    fields |= {name: NONE if now is None else f"{now:g}" for name, (now, before) in new.items() if now != before}
    address = urlencode({name: text for name, text in fields.items() if text})
    told = {"metric": escape(title_of(what.metric, what.choices)), "limits": escape(limits), "fail": str(one.fail_now)}
    told |= {"would": f"<b>{one.would_fail}</b>"}
    told |= {"see": f'<a href="/quality?{escape(address)}">{escape(say("see which"))}</a>'}
    return say.counted(one.runs, *ON_TRIAL[virtual], **told)
