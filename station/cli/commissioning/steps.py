"""What the commands of `lostmotion bench` print: tables for a person, one JSON object for a program."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from definitions.commissioning import STEP_BY_ID, Step
from drivers.can.bus import open_can
from drivers.can.other_controller import refuse_other_controller
from drivers.config import WireBenchConfig
from drivers.modbus.part_fields import PART_FIELDS
from drivers.servo_drive.comparison import Compared
from drivers.servo_drive.emcy import emcy_sentence
from station.bench.commissioned import Change, protocol_path
from station.cli.say import Grid, say
from station.commissioning.on_wires import PERIOD_NS, ByHand, OnWires, on_wires
from station.commissioning.probe import Live
from station.commissioning.steps_done import how_it_stands, may_begin, write_down
from station.documents.commissioning import StepDone
from station.documents.entries import alongside, plain
from station.errors import StationError

if TYPE_CHECKING:
    from station.commissioning.watchdogs import Reaction, Trial

NOT_PASSED = 1
Block = str | Grid


class SaidOfProbe(NamedTuple):
    """What `probe` tells a program."""

    objects: list[Compared]
    live: list[Live]
    missing: list[str]


class FieldRow(NamedTuple):
    """A field of a device as `registers` shows it."""

    device: str
    register: str
    field: str
    type: str
    raw: str
    order_big: str
    little: str
    changes: str
    shows: str


class SaidOfRegisters(NamedTuple):
    """What `registers` tells a program."""

    fields: list[FieldRow]
    moved: Collection[str]


@dataclass(frozen=True, kw_only=True)
class TrialSaid:
    """What the drive did in a trial; its state stands there by its name."""

    reaction: Reaction = alongside()
    state: str


class SaidOfWatchdogs(NamedTuple):
    """What `watchdogs` tells a program: the reaction to each trial, with the drive's state by its name."""

    trials: list[TrialSaid]


def status(bench_name: str, *, as_json: bool) -> int:
    """Print how each step stands; 1 while one has not passed, or is due again."""
    bench = on_wires(bench_name)
    stands = how_it_stands(bench)
    rows = [
        (
            one.step.id,
            one.state,
            "" if one.done is None else one.done.when,
            "" if one.done is None else one.done.by,
            "" if one.done is None else one.done.bench_sha256[:8],
            _why(one.changes, one.waits_for, one.state),
        )
        for one in stands
    ]
    changes = [(one.step.id, *change) for one in stands for change in one.changes]
    document = {
        "bench": bench.bench.bench.name,
        "protocol": str(protocol_path(bench.path)),
        "steps": [
            {
                "step": row[0],
                "state": row[1],
                "when": row[2] or None,
                "by": row[3] or None,
                "bench_sha256": row[4] or None,
            }
            for row in rows
        ],
        "changes": [dict(zip(("step", "part", "was", "now"), row, strict=True)) for row in changes],
    }
    blocks: list[Block] = [Grid(("step", "state", "done", "by", "bench file", "why"), rows)]
    if changes:
        blocks += ["", Grid(("due again", "entry", "was", "is"), changes)]
    following = next((one for one in stands if one.state != "passed"), None)
    if following is not None:
        blocks += ["", *_next(bench, following.step)]
    say(document, blocks, as_json=as_json)
    return NOT_PASSED if following is not None else 0


def _why(changes: Sequence[Change], waits_for: Sequence[str], state: str) -> str:
    if state == "passed":
        return ""
    if changes:
        return f"{len(changes)} {'entry' if len(changes) == 1 else 'entries'} changed"
    return f"after {waits_for[0]}" if waits_for else ""


def probe(bench_name: str, seconds: float, by: str | None, *, as_json: bool) -> int:
    """Do the step `probe`."""
    from station.commissioning.probe import probe as look  # noqa: PLC0415 - each step brings its own part

    bench = on_wires(bench_name)
    may_begin(bench, "probe")
    with bench.alone():
        seen = look(bench, seconds)
    live = [
        (one.channel, one.value, one.unit, one.source, "never" if one.age_ms is None else f"{one.age_ms:.0f} ms")
        for one in seen.live
    ]
    objects = [(one.outcome, one.place, one.found, one.wanted, one.meaning) for one in seen.objects]
    blocks: list[Block] = [
        Grid(("", "object", "found", "wanted", "meaning"), objects),
        "",
        Grid(("value", "now", "", "from", "age"), live, right=(1, 4)),
    ]
    done = write_down(bench, "probe", by, seen.findings, seen.figures)
    return end(bench, done, blocks, SaidOfProbe(seen.objects, seen.live, seen.missing), as_json=as_json)


def registers(
    bench_name: str, part: str | None, seconds: float, without: Sequence[str], by: str | None, *, as_json: bool
) -> int:
    """Do the step `registers`; with a device that is named only look at it."""
    from station.commissioning.registers import SENSORS, Row, browse  # noqa: PLC0415 - as above

    for found in without:
        if found not in SENSORS:
            raise StationError(f"--without (a torque sensor): found '{found}'; allowed: {', '.join(SENSORS)}")
    bench = on_wires(bench_name)
    tell = teller(as_json=as_json)
    if part is None:
        may_begin(bench, "registers")

    def begun(least_nm: Mapping[str, float]) -> None:
        if part is None:
            each = ", ".join(f"{channel} by at least {by:g} N·m" for channel, by in least_nm.items())
            tell(f"Press on each torque sensor, one after the other: {each}. You have {seconds:g} s.")

    def pressed(row: Row, value: float) -> None:
        orders = f"as big-endian {_number(row.big)}, as little-endian {_number(row.little)}"
        tell(f"  {row.field}: {value:.6g} N·m   raw registers {row.raw}   {orders}")

    with bench.alone():
        seen = browse(bench, part, seconds, begun, pressed, without)
    rows = [
        FieldRow(
            row.part,
            row.address,
            row.field,
            row.kind,
            row.raw,
            _number(row.big),
            _number(row.little),
            str(row.changes),
            row.shows or "",
        )
        for row in seen.rows
    ]
    heads = [name.replace("_", " ") for name in FieldRow._fields]
    blocks: list[Block] = [Grid(heads, rows, right=(1, 5, 6, 7))]
    more = SaidOfRegisters(rows, seen.moved)
    if part is not None:
        say(more, [*blocks, *(f"{one.what} {one.cure}" for one in seen.findings)], as_json=as_json)
        return 0
    done = write_down(bench, "registers", by, seen.findings, seen.figures)
    return end(bench, done, blocks, more, as_json=as_json)


def _number(value: float | None) -> str:
    return "not a number" if value is None else f"{value:.6g}"


def contacts(bench_name: str, seconds: float, by: str | None, *, as_json: bool) -> int:
    """Do the step `io`."""
    from station.commissioning.contacts import guide  # noqa: PLC0415 - as above

    bench = on_wires(bench_name)
    may_begin(bench, "io")
    with bench.alone():
        guided = guide(bench, seconds, teller(as_json=as_json))
    done = write_down(bench, "io", by, guided.findings, guided.figures)
    return end(bench, done, [], as_json=as_json)


def watchdogs(bench_name: str, by: str | None, *, as_json: bool) -> int:
    """Do the step `watchdogs`."""
    from station.commissioning import watchdogs as trials  # noqa: PLC0415 - as above

    bench = on_wires(bench_name)
    may_begin(bench, "watchdogs")
    tell = teller(as_json=as_json)
    wires = bench.wires
    reactions = []
    with bench.alone(), ByHand(wires).opened("remote_io") as by_hand:
        for trial in trials.TRIALS:
            tell(f"{trial.title} ...")
            link = open_can(wires.can)
            try:
                refuse_other_controller(link, wires.drive)
                reactions.append(trials.measure(link, wires.drive, PERIOD_NS, trial, safety_chain(by_hand, wires)))
            finally:
                link.close()
    rows = [
        (
            trial.title,
            "yes" if one.acted else "no",
            "" if not one.acted else f"{one.seen_enabled_s * 1e3:.0f} to {one.after_s * 1e3:.0f} ms",
            "" if one.off_s is None else f"{one.off_s * 1e3:.0f} ms",
            _timeout(trial, one),
        )
        for trial, one in zip(trials.TRIALS, reactions, strict=True)
    ]
    heads = ("trial", "drive reacts", "after", "without torque after", "time-out")
    done = write_down(bench, "watchdogs", by, trials.judged(reactions), trials.figures(reactions))
    said = SaidOfWatchdogs([TrialSaid(reaction=one, state=one.state.name.lower()) for one in reactions])
    blocks: list[Block] = [Grid(heads, rows)]
    blocks += [
        f"{trial.title}: {emcy_sentence(one.emcy_code)}"
        for trial, one in zip(trials.TRIALS, reactions, strict=True)
        if one.emcy_code
    ]
    return end(bench, done, blocks, said, as_json=as_json)


def _timeout(trial: Trial, reaction: Reaction) -> str:
    """Return the time-out of a trial: the one that is tried, or the longest of those that may act."""
    if reaction.timeout_s is None:
        return "none"
    return f"{'' if trial.protection else 'at most '}{reaction.timeout_s * 1e3:g} ms"


STALE_MS = 500
"""Age of the contacts from which on they are not known."""

NOT_ASKED_MS = 100
"""Time between two looks from which on the contacts grew old because nobody asked, as while the drive is set up."""


def safety_chain(by_hand: ByHand, wires: WireBenchConfig) -> Callable[[], str]:
    """Return what looks at emergency stop and guard, and says what speaks against an enabled drive, '' for nothing."""
    device = by_hand.devices["remote_io"]
    names = PART_FIELDS["remote_io"]
    looked = asked_since = by_hand.scan

    def look() -> str:
        nonlocal looked, asked_since
        by_hand.step()
        if by_hand.scan - looked > NOT_ASKED_MS:
            asked_since = by_hand.scan
        looked = by_hand.scan
        if device.lost or (device.age_scans(by_hand.scan) > STALE_MS and by_hand.scan - asked_since > STALE_MS):
            return (
                f"{wires.remote_io.where} does not answer, so emergency stop and guard are not known. Check the cable "
                "of this device"
            )
        if not device.replies:
            return ""
        opened = [name for name in names if not device.values[device.place(name)]]
        return f"{' and '.join(opened)} reads 0" if opened else ""

    return look


def teller(*, as_json: bool) -> Callable[[str], None]:
    """Return what tells a person who is guided: on standard error where standard output is for a program."""
    stream = sys.stderr if as_json else sys.stdout

    def tell(text: str) -> None:
        stream.write(text + "\n")
        stream.flush()

    return tell


def end(bench: OnWires, done: StepDone, blocks: list[Block], said: tuple[object, ...] = (), *, as_json: bool) -> int:
    """Print what came of a step and which one is next; 1 when it has not passed.

    said: what the step has to say beside its protocol, a named tuple, for a program.
    """
    document = plain(done) | {"bench": bench.bench.bench.name, "protocol": str(protocol_path(bench.path))}
    document |= plain(said) if said else {}
    del document["parts"]
    step = STEP_BY_ID[done.step]
    for finding in done.findings:
        blocks += ["", f"{'WRONG' if finding.refuses else 'note'}  {finding.what}", f"       {finding.cure}"]
        named = [name for name in bench.profiles if f"profile {name}" in finding.cure]
        blocks += [f"       Profile {name}: {bench.profiles[name].path}" for name in named]
    following = next((one.step for one in how_it_stands(bench) if one.state != "passed"), None) if done.passed else None
    passed = f"passed{_with_notes(done)}" if done.passed else "NOT PASSED"
    blocks += ["", f"{step.id}: {passed}. Protocol: {protocol_path(bench.path)}"]
    if following is not None:
        blocks += _next(bench, following)
    elif not done.passed:
        blocks += [
            "Correct this. Then see which step is due first; a change may make an earlier one due:",
            f"  lostmotion bench status --bench {bench.path}",
        ]
    else:
        blocks.append(f"All steps have passed. Next: lostmotion run RECIPE --bench {bench.path} --serial SN")
    say(document, blocks, as_json=as_json)
    return 0 if done.passed else NOT_PASSED


def _with_notes(done: StepDone) -> str:
    """Say that there is something to read above, although the step has passed."""
    notes = len(done.findings)
    return f", with {notes} note{'s' if notes > 1 else ''} above" if notes else ""


def _next(bench: OnWires, step: Step) -> list[Block]:
    """Return the command of a step, with all that it needs, and what has to be there for it."""
    recipe = " --recipe RECIPE" if step.by_recipe else ""
    return [f"Next: lostmotion bench {step.id} --bench {bench.path}{recipe}", f"  {step.needs}."]
