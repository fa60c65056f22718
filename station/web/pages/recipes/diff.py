"""The difference between two texts, as a person reads it: what was taken out, what came in, and a little around it."""

from __future__ import annotations

from difflib import SequenceMatcher
from html import escape

from station.web.languages import Words

CONTEXT = 3
"""Lines that are shown around a change."""

NOTHING = "The texts are the same."


def diff_html(before: str, now: str, say: Words) -> str:
    """Return the difference as HTML; each changed line by sign, word for a screen reader, and colour."""
    old, new = before.splitlines(), now.splitlines()
    rows: list[str] = []
    for number, group in enumerate(SequenceMatcher(None, old, new, autojunk=False).get_grouped_opcodes(CONTEXT)):
        rows += ['<tr class="lm-gap"><td colspan="4">…</td></tr>'] if number else []
        for kind, a, b, c, d in group:
            if kind == "equal":
                rows += [_row("", a + line, c + line, new[c + line], say) for line in range(d - c)]
                continue
            rows += [_row("−", line, None, old[line], say) for line in range(a, b)]
            rows += [_row("+", None, line, new[line], say) for line in range(c, d)]
    if not rows:
        return f'<p class="lm-same">{say(NOTHING)}</p>'
    return f'<table class="lm-diff"><tbody>{"".join(rows)}</tbody></table>'


KINDS = {"−": ("lm-removed", "removed"), "+": ("lm-added", "added"), "": ("", "")}
"""Style of a line and its word, by its sign."""


def _row(sign: str, before: int | None, now: int | None, text: str, say: Words) -> str:
    style, word = KINDS[sign]
    numbers = "".join(f"<td>{'' if one is None else one + 1}</td>" for one in (before, now))
    label = f' aria-label="{say(word)}"' if word else ""
    return f'<tr class="{style}">{numbers}<td{label}>{sign}</td><td><code>{escape(text) or "&nbsp;"}</code></td></tr>'
