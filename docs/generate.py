"""Writes the reference pages that are tables of the code: `make docs`. A test holds them up to date."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from analysis import METRICS
from controller.budgets import BUDGETS
from controller.faults import FAULTS
from controller.image import IMAGE_FIELDS, ORDERS_FIELDS, Field, State
from controller.interlocks import INTERLOCKS
from controller.program import ROLES
from controller.states import TRANSITIONS

FOLDER = Path(__file__).parent
NOTE = "This page is made from the tables of the code by `make docs`.\n"


def table(head: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    lines += ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def name(state: State) -> str:
    """State as it stands in records."""
    return state.name.lower()


def states() -> str:
    """The page of states and transitions, with the diagram."""
    arrows: dict[tuple[State, State], list[str]] = {}
    for row in TRANSITIONS:
        if row.trigger != "trip":
            arrows.setdefault((row.source, row.dest), []).append(row.trigger)
    drawn = "\n".join(f"    {name(a)} --> {name(b)}: {', '.join(t)}" for (a, b), t in arrows.items())
    return (
        "# States\n\n" + NOTE + "\nFrom every state but `fault` itself the trigger `trip` leads to `fault`; these arrows are"
        " left out of the picture.\n\n```mermaid\nstateDiagram-v2\n    [*] --> idle\n" + drawn + "\n```\n\n"
        + table(("trigger", "from", "to"), ((f"`{r.trigger}`", name(r.source), name(r.dest)) for r in TRANSITIONS))
        + "\n## Roles of the segments\n\nEvery sample carries the number of its segment; a segment has one of these roles.\n\n"
        + table(("role", "what it is"), ((f"`{role}`", text) for role, text in ROLES.items()))
        + "\n## Budgets\n\nTimes and shares that a recipe does not set.\n\n"
        + table(("budget", "value", "reason"), ((f"`{n}`", f"{v:g}", why) for n, (v, why) in BUDGETS.items()))
    )  # fmt: skip


def faults() -> str:
    """The page of faults: reaction, wording, and where each is watched."""
    live = {row.fault: row.live_in for row in INTERLOCKS}

    def where(fault_id: str) -> str:
        return ", ".join(name(s) for s in State if s in live[fault_id]) if fault_id in live else "a step that waits"

    rows = (
        (
            f.number,
            f"`{f.id}`",
            f.reaction.name.lower(),
            f.debounce_scans,
            f"{f.text}. {f.cause}.",
            f.next_action,
            where(f.id),
        )
        for f in FAULTS
    )
    head = ("no.", "fault", "reaction", "debounce [scans]", "what happened and why", "what to do", "watched in")
    return (
        "# Faults\n\n" + NOTE + "\nReactions by severity: warn < hold < unload < quick stop < power off; the strongest of all"
        " active faults wins. From unload upwards a fault is latched: it stays until its cause is gone **and** a person has"
        " acknowledged it and asked for the reset.\n\n" + table(head, rows)
    )  # fmt: skip


def process_image() -> str:
    """The page of the process image and the record."""

    def rows(fields: tuple[Field, ...]) -> Iterable[tuple[object, ...]]:
        return ((f"`{f.name}`", f"`{f.format}`", f.unit, f.meaning) for f in fields)

    head = ("field", "format", "unit", "meaning")
    return (
        "# Process image\n\n" + NOTE + "\nFormats are letters of Python's `struct`, little-endian without padding.\n"
        "\n## Inputs of a scan\n\n" + table(head, rows(IMAGE_FIELDS))
        + "\n## Orders of a scan\n\n" + table(head, rows(ORDERS_FIELDS))
    )  # fmt: skip


def metrics() -> str:
    """The page of metric definitions."""
    rows = ((f"`{key}`", m.unit, m.text, m.estimator, ", ".join(m.sides), m.source) for key, m in METRICS.items())
    return (
        "# Metrics\n\n" + NOTE + "\nThe same loop gives different numbers under the same word, so the definition is part of"
        " every number.\n\n" + table(("metric", "unit", "definition", "estimator", "sides", "where it comes from"), rows)
    )  # fmt: skip


PAGES: dict[str, Callable[[], str]] = {
    "states.md": states,
    "faults.md": faults,
    "process-image.md": process_image,
    "metrics.md": metrics,
}

if __name__ == "__main__":
    for page, text in PAGES.items():
        (FOLDER / page).write_text(text(), encoding="utf-8")
