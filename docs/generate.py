"""Writes the reference pages that are tables of the code: `make docs`. A test holds them up to date."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from functools import partial
from pathlib import Path

from analysis.loop.stages import STAGES
from controller.debounce import debounce_text
from controller.interlocks import INTERLOCKS
from controller.states import TRANSITIONS
from definitions.checks import CHECKS, Check
from definitions.device_proofs import DEVICE_PROOFS
from definitions.faults import FAULTS
from definitions.image import IMAGE_FIELDS, ORDERS_FIELDS, DriveCommand, Field, State
from definitions.jog import PHASES, PROTECTIONS
from definitions.program import ROLES
from definitions.protections import DRIVE_PROTECTIONS, WITHOUT_INTERLOCK
from definitions.states import STATES
from docs.interface_pages import command_options, record_files, rest
from docs.markdown import NOTE, table
from docs.metric_page import metrics
from docs.option_pages import bench_options, recipe_options
from docs.profile_page import profile_options
from docs.schemas import FILES, schema_of
from drivers.servo_drive.cia402 import CONTROL_WORDS
from faultlab.rows import ROWS
from recipes.compiler.budgets import BUDGETS
from recipes.text.section import option_name
from virtual_bench.faults.names import Vocabulary
from virtual_bench.faults.reactions import REACTIONS
from virtual_bench.faults.vocabulary import BY_NAME, NOT_BY_WALL_CLOCK, on_the_wire, only_over_wires
from virtual_bench.faults.vocabulary import FAULTS as INJECTED

FOLDER = Path(__file__).parent
SHOWN = 3
"""Faults that bring an interlock up on purpose, on the page; the fault matrix has them all."""


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
        + "\n## What holds in them\n\n"
        + table(
            ("state", "what an operator reads", "run goes on", "lock closed or being verified", "recipe's torque on the unit"),
            (
                (f"`{name(r.state)}`", r.words, *("yes" if holds else "" for holds in (r.running, r.locked, r.loaded)))
                for r in STATES
            ),
        )
        + "\n## Phases of a jog\n\nThe drive is off in the first three, and they wait for a person.\n\n"
        + table(("phase", "what happens", "what to do"), ((r.phase.name.lower(), r.words, r.next_action) for r in PHASES))
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
            f"`{option_name(f.limit.option)}`" if f.limit else "",
            debounce_text(f),
            f"{f.text}. {f.cause}.",
            f.next_action,
            where(f.id),
        )
        for f in FAULTS
    )
    head = ("no.", "fault", "reaction", "limit", "debounce", "what happened and why", "what to do", "watched in")
    return (
        "# Faults\n\n" + NOTE + "\nReactions by severity: warn < hold < unload < quick stop < power off; the strongest of all"
        " active faults wins. From unload upwards a fault is latched: it stays until its cause is gone **and** a person has"
        " acknowledged it and asked for the reset.\n\nA limit is the option of that name in the recipe's section"
        " `interlocks`.\n\nA debounce in scans starts anew with the first good scan. One in time"
        " counts up with each bad scan and down with each good one, so that what is wrong most of the time is seen too;"
        " only `sample_frozen` starts anew, for one new sample disproves it.\n\n" + table(head, rows)
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


def reactions() -> Iterable[tuple[object, ...]]:
    """The rows of the table of reactions."""

    def written(command: DriveCommand) -> str:
        return f"`{command.name.lower()}` (0x{CONTROL_WORDS[command]:02X})"

    for reaction, row in REACTIONS.items():
        yield (
            f"`{reaction.name.lower()}`",
            " or ".join(map(written, row.orders)) or "as before",
            "as before" if row.then is None else written(row.then),
            "stays" if row.state is None else f"`{name(row.state)}`",
            ", ".join(f"`{target}`" for target in row.contacts),
            row.what,
        )


def fault_vocabulary() -> str:
    """The page of the faults that can be injected."""

    def where(key: tuple[str, str]) -> str:
        wires = "wires, by the scan clock" if key in NOT_BY_WALL_CLOCK else "wires"
        clocks = ["virtual time"] * (not only_over_wires(*key)) + [wires]
        return ", ".join(clocks + ["gateway"] * (on_the_wire(*key) and key not in NOT_BY_WALL_CLOCK))

    def rows(vocabulary: Vocabulary) -> Iterable[tuple[object, ...]]:
        return (
            (f"`{target}`", f"`{verb}`", row.value, row.acts_on, where((target, verb)))
            for (target, verb), row in vocabulary.items()
        )

    return (
        "# Faults that can be injected\n\n"
        + NOTE
        + "\nA scenario names target and verb, gives the value where there is "
        "one, and says when; see [Fault injection](fault-injection.md). *Virtual time*: `faults run` and `faults matrix`. "
        "*Wires*: the same with `--wires`. *Gateway*: against a real bench.\n\n"
        + table(("target", "verb", "value", "what a controller finds changed", "where it acts"), rows(INJECTED))
        + "\n## Of the devices of a bench\n\nA bench whose channels come from `devices` and `can_devices` has these besides, by the names in "
        "its file: NAME is that of a device, FIELD one of its profile. A CAN sensor without `node_id` has no heartbeat and no node. What a "
        "sensor itself does wrong (`sensor.torque_out offset`) is above, whatever device measures it.\n\n"
        + table(("target", "verb", "value", "what a controller finds changed", "where it acts"), rows(BY_NAME))
        + "\n## Reactions\n\nWhat comes of an alarm, from the mildest reaction to the strongest; [Faults](faults.md) says which alarm has "
        "which. A drive command is shown with its control word (0x6040). The lock's contact, the output of the brake supply, is kept "
        "by every reaction: it opens during the recovery only. `expect: {reaction: ...}` is held against this table, and so is the "
        "[fault matrix](fault-matrix.md).\n\n"
        + table(
            (
                "reaction",
                "order in the scan of the alarm",
                "order after that",
                "state",
                "contact that brings it about",
                "what happens",
            ),
            reactions(),
        )
    )


def checks() -> str:
    """The page of the stages and the validity checks of the analysis."""

    def limit(check: Check) -> str:
        unit = "" if check.unit == "1" else f" {check.unit}"
        return f"{'at least' if check.at_least else 'at most'} {check.limit:g}{unit}"

    rows = (
        (c.title, f"`{key}`", c.figure, limit(c), f"`validity.{key}`" if c.settable else "", c.failed, c.action)
        for key, c in CHECKS.items()
    )
    head = ("check", "id", "figure", "limit", "option of the recipe", "when it fails", "what to do")
    return (
        "# Stages and validity checks\n\n" + NOTE + "\nWhat they are for: [the pipeline](pipeline.md).\n"
        "\n## Stages\n\n" + table(("stage", "what it does"), STAGES.items())
        + "\n## Validity checks\n\nA check that fails makes the verdict NOT DECIDABLE, whatever the metrics say. A check whose figure"
        " cannot be had says why, and decides nothing. Shares of the wind-up are of the angle between the turning points.\n\n"
        + table(head, rows)
    )  # fmt: skip


def provoked_by(fault: str) -> str:
    """What brings an interlock up on purpose: the rows of the fault matrix, or else its row of the exits."""
    rows = [f"`{row.name}`" for row in ROWS if fault in row.causes]
    more = f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
    return ", ".join(rows[:SHOWN]) + more if rows else "its row in [exits](exits.md)"


def in_states(live_in: Collection[State]) -> str:
    """States by their names: those, or all but the others, whichever is shorter."""
    others = [name(state) for state in State if state not in live_in]
    listed = [name(state) for state in State if state in live_in]
    return ", ".join(listed) if len(listed) <= len(others) else f"all but {', '.join(others)}"


def safety() -> str:
    """The page of what protects: each protection, what proves it, what happens without it."""
    watched = [
        (
            f"`{fault.id}`: {fault.text}",
            in_states(fault.live_in),
            fault.reaction.name.lower().replace("_", " "),
            provoked_by(fault.id),
            WITHOUT_INTERLOCK[fault.id],
        )
        for fault in FAULTS
        if fault.live_in
    ]
    return (
        "# Protections, their proof, and what happens without them\n\n" + NOTE +
        "\n**This software is not a safety function.** Emergency stop, guard switch and safe torque off are wired in hardware. The software"
        " watches them and reacts, nothing more. Without that wiring nothing on this page protects a person.\n"
        "\n## Of the drive\n\nWhat the drive enforces or tells by itself, also when this program is dead. A profile names the way in which its"
        " drive has each, or `none`; what a drive lacks stands in the verified list of a run, in its result and on its report. *Read back* proves that"
        " the object holds the value, not that the drive acts on it.\n\n"
        + table(
            ("protection", "objects", "in a profile", "what proves it", "what happens without it"),
            (
                (row.meaning, row.objects, ", ".join(f"`{way}`" for way, _ in row.ways), row.proof, row.without)
                for row in DRIVE_PROTECTIONS
            ),
        )
        + "\n## Of brake, sensors and I/O\n\nWhat a device may lack, and what is left then. Each result on a bench that lacks it says so.\n\n"
        + table(
            ("the bench has", "what is not proven", "what remains"),
            ((row.lacking, row.unproven, row.remains) for row in DEVICE_PROOFS),
        )
        + "\n## Of the controller\n\nInterlocks, looked at in every scan of the states named. Each is proven by the faults that bring it up on purpose, in each of these"
        " states: [fault matrix](fault-matrix.md), times in [exits](exits.md). Without the program none of them acts; then the drive's own protections"
        " are what is left.\n\n"
        + table(("interlock", "in the states", "reaction", "what proves it", "what happens without it"), watched)
        + "\n**A contact that is welded, or a wire that is bridged, reads closed for ever**: no program can see that. It is found by"
        " `lostmotion bench io`, and by pressing the emergency stop and opening the guard at the times that the bench's risk assessment sets.\n"
        + "\n## Of a jog\n\nA technician turns the shaft with people near it. Key first, then the enabling device: each movement takes both.\n\n"
        + table(("protection", "what proves it", "what happens without it"), PROTECTIONS)
    )  # fmt: skip


PAGES: dict[str, Callable[[], str]] = {
    "states.md": states,
    "faults.md": faults,
    "process-image.md": process_image,
    "metrics.md": metrics,
    "recipe-options.md": recipe_options,
    "fault-vocabulary.md": fault_vocabulary,
    "bench-options.md": bench_options,
    "profile-options.md": profile_options,
    "safety.md": safety,
    "checks.md": checks,
    "command-options.md": command_options,
    "rest.md": rest,
    "record-files.md": record_files,
} | {f"schema/{file}": partial(schema_of, file) for file in FILES}

if __name__ == "__main__":
    for page, text in PAGES.items():
        (FOLDER / page).parent.mkdir(exist_ok=True)
        (FOLDER / page).write_text(text(), encoding="utf-8")
