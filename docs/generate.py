"""Writes the reference pages that are tables of the code: `make docs`. A test holds them up to date."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import date
from pathlib import Path
from typing import Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from analysis import GATES, METRICS, STAGES, Definition
from analysis.curves import FITS
from analysis.grades import GRADES
from controller.budgets import BUDGETS
from controller.debounce import debounce_text
from controller.faults import FAULTS
from controller.image import IMAGE_FIELDS, ORDERS_FIELDS, Field, State
from controller.interlocks import INTERLOCKS
from controller.program import ROLES
from controller.states import TRANSITIONS
from drivers.virtual.fault_vocabulary import FAULTS as INJECTED
from drivers.virtual.fault_vocabulary import ONLY_IN_VIRTUAL_TIME, ONLY_OVER_WIRES, on_the_wire
from recipes.bench_schema import (
    AngleSensor,
    BenchHeader,
    BrakeDevice,
    CanBus,
    Drive,
    ModbusDevice,
    Sensors,
    TorqueSensor,
)
from recipes.calibration_schema import Calibration, Fixture, FixtureCurve, QuadrantLine
from recipes.metric_presets import PRESETS, PresetMetric
from recipes.quantity import show
from recipes.recipe_schema import (
    Decision,
    Header,
    Interlocks,
    LoadingTorqueRatio,
    Measurement,
    MetricWanted,
    Sampling,
    UnitUnderTest,
    Validity,
)
from recipes.section import Quantity
from recipes.sequence_schema import (
    Calibrate,
    FatigueCycles,
    Home,
    Lock,
    Release,
    SpeedCycles,
    StepCycles,
    TorqueCycles,
    Unload,
)

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
            debounce_text(f),
            f"{f.text}. {f.cause}.",
            f.next_action,
            where(f.id),
        )
        for f in FAULTS
    )
    head = ("no.", "fault", "reaction", "debounce", "what happened and why", "what to do", "watched in")
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


def _choices(metric: Definition) -> str:
    """What can be chosen for a metric, the default first."""
    several = {"branch": metric.branches, "variant": metric.variants, "fit": metric.fits}
    found = [f"{key}: {', '.join(names)}" for key, names in several.items() if len(names) > 1]
    return "; ".join([*found, *(name.removesuffix("_nm") for name in metric.free)])


def _preset_metric(row: PresetMetric) -> str:
    """A metric of a preset with what is chosen for it."""
    band = "" if row.band is None else f"band {100 * row.band:g} %"
    chosen = ", ".join(part for part in (row.branch, band, row.variant, row.fit) if part)
    return f"`{row.id}`" + (f" ({chosen})" if chosen else "")


def metrics() -> str:
    """The page of metric definitions, fits, presets and grades."""
    rows = (
        (f"`{key}`", m.unit, m.text, m.estimator, ", ".join(m.sides), _choices(m), m.source)
        for key, m in METRICS.items()
    )
    head = ("metric", "unit", "definition", "estimator", "sides", "what can be chosen", "where it comes from")
    presets = (
        (f"`{key}`", p.text, ", ".join(map(_preset_metric, p.metrics)), p.reference, p.breaks)
        for key, p in PRESETS.items()
    )
    preset_head = ("preset", "whose definitions", "metrics", "percentages at the source refer to", "break torques")
    grades = ((row.grade, f"{row.most_arcmin:g} arcmin" if row.most_arcmin < 1e9 else "", row.text) for row in GRADES)
    return (
        "# Metrics\n\n" + NOTE + METRIC_WORDS + table(head, rows)
        + "\n## Fits of the stiffness curve\n\n" + FIT_WORDS
        + table(("fit", "what it does", "where it comes from"), ((f"`{k}`", f.text, f.source) for k, f in FITS.items()))
        + "\n## Presets\n\n" + PRESET_WORDS + table(preset_head, presets)
        + "\n## Precision grades\n\n" + GRADE_WORDS + table(("grade", "up to", "what it means"), grades)
    )  # fmt: skip


METRIC_WORDS = """
The same loop gives different numbers under the same word, so the definition is part of every number: results, reports
and `lostmotion metrics` give it beside the value, with the branch, the estimator, its break torques and the cycles.

T is the torque at the output, f(T) the forward branch (torque rising), r(T) the return branch (torque falling), and
m(T) = (f + r) / 2 the centreline, all as measured; F(T) is the centreline as fitted. Loading on the positive side is f,
on the negative side r. A recipe chooses with `branch`, `side`, `torque`, `band`, `variant` and `fit`; the first of the
names below is taken when it says nothing.

"""
FIT_WORDS = """`fit` chooses the curve for metrics that read one. With `branch: load` or `unload` the same fit is read
of that branch alone. Near the rated torque the fits differ on one and the same loop: the spring constant of unit
P1, loaded to ±480 N·m without noise, reads 115.17, 115.75 and 109.28 N·m/arcmin by the three fits; the unit's elastic
stiffness there is 109.34.

"""
PRESET_WORDS = """A preset asks for the definitions that belong together at one source. In a recipe, beside `metrics` or instead
of them: `presets: [inverse, nabtesco]`. For a trace: `lostmotion analyze TRACE --recipe R --preset nabtesco` reports
the preset's metrics instead of the recipe's. A preset has no limits; a limit in the recipe for the same
definition holds, and with `--preset` nothing passes while the recipe limits a definition that the preset leaves out.
A recipe that asks for one
metric in several ways has several series of it: `lostmotion capability --metric "spring_constant three_region"`.
Percentages are always of the recipe's `reference_torque`; Yaskawa's lost motion is `lost_motion` with `band: 5 %`.

"""
GRADE_WORDS = """`grade` is read off the mean backlash of the cycles. When the uncertainty of the backlash reaches into
another grade, the grade is uncertain by one: with a guard band it is not decidable then.

"""


def _quantity(field: FieldInfo) -> Quantity | None:
    """The kind of quantity that an option takes, None when it takes something else."""
    arguments = get_args(field.annotation)
    parts = [*field.metadata, *(part for item in arguments for part in getattr(item, "__metadata__", ()))]
    return next((part for part in parts if isinstance(part, Quantity)), None)


def _default(field: FieldInfo) -> str:
    """The default of an option, with its unit."""
    quantity = _quantity(field)
    if field.is_required() or field.default in (None, ""):
        return "required" if field.is_required() else ""
    if quantity is not None and isinstance(field.default, float):
        return f"default {show(field.default / quantity.scale, quantity.kind)}"
    return f"default `{field.default}`"


def _allowed(field: FieldInfo) -> str:
    """What an option takes, in words."""
    if field.description:
        return field.description
    quantity = _quantity(field)
    if quantity is not None:
        return quantity.allowed()
    arguments = [item for item in get_args(field.annotation) if item is not type(None)]
    for item in (field.annotation, *arguments):
        if get_origin(item) is Literal:
            return " or ".join(f"`{value}`" for value in get_args(item))
    limits = {
        key: value
        for part in field.metadata
        for key, value in ((key, getattr(part, key, None)) for key in ("ge", "gt", "le", "lt"))
        if value is not None
    }
    words = {"ge": "from", "gt": "above", "le": "up to", "lt": "below"}
    bounds = " ".join(f"{words[key]} {value:g}" for key, value in limits.items())
    plain = {int: "whole number", float: "number", str: "text", bool: "`true` or `false`", date: "date"}
    bare = [getattr(item, "__origin__", item) for item in (field.annotation, *arguments)]
    kind = next((plain[item] for item in bare if item in plain), "section or list, see there")
    return f"{kind} {bounds}".strip()


def _options(model: type[BaseModel]) -> str:
    """Table of the options of a section."""
    options = ((field.alias or key, field) for key, field in model.model_fields.items() if key != "kind")
    rows = ((f"`{option}`", _allowed(field), _default(field)) for option, field in options)
    return table(("option", "what it takes", ""), rows)


def recipe_options() -> str:
    """The page of every option of a recipe."""
    sections = {
        "recipe": Header, "unit_under_test": UnitUnderTest, "unit_under_test.loading_torque_ratio": LoadingTorqueRatio,
        "measurement": Measurement, "sampling": Sampling, "interlocks": Interlocks, "metrics (each)": MetricWanted,
        "decision": Decision, "validity": Validity,
    }  # fmt: skip
    steps = {
        "home": Home, "lock": Lock, "calibrate": Calibrate, "torque_cycles": TorqueCycles, "speed_cycles": SpeedCycles,
        "step_cycles": StepCycles, "fatigue_cycles": FatigueCycles, "unload": Unload, "release": Release,
    }  # fmt: skip
    text = "# Every option of a recipe\n\n" + NOTE
    text += "\n`loading` is `input` or `output`. Times, ages and speeds without default must be given.\n"
    for name_of, model in sections.items():
        text += f"\n## {name_of}\n\n{_options(model)}"
    for name_of, model in steps.items():
        text += f"\n## sequence: {name_of}\n\n{(model.__doc__ or '').strip()}\n\n{_options(model)}"
    return text


def fault_vocabulary() -> str:
    """The page of the faults that can be injected."""

    def where(key: tuple[str, str]) -> str:
        clocks = ["virtual time"] * (key not in ONLY_OVER_WIRES) + ["wires"] * (key not in ONLY_IN_VIRTUAL_TIME)
        return ", ".join(clocks + ["gateway"] * (on_the_wire(*key) and key not in ONLY_IN_VIRTUAL_TIME))

    rows = (
        (f"`{target}`", f"`{verb}`", row.value, row.acts_on, where((target, verb)))
        for (target, verb), row in INJECTED.items()
    )
    return (
        "# Faults that can be injected\n\n"
        + NOTE
        + "\nA scenario names target and verb, gives the value where there is "
        "one, and says when; see [Fault injection](fault-injection.md). *Virtual time*: `faults run` and `faults matrix`. "
        "*Wires*: the same with `--wires`. *Gateway*: against a real bench.\n\n"
        + table(("target", "verb", "value", "what a controller finds changed", "where it acts"), rows)
    )


def bench_options() -> str:
    """The page of every option of a bench file."""
    sections = {
        "bench": BenchHeader, "can": CanBus, "drive": Drive, "amplifier, remote_io": ModbusDevice, "brake": BrakeDevice,
        "sensors": Sensors, "sensors: torque_in, torque_out": TorqueSensor, "sensors: angle_in, angle_out": AngleSensor,
        "fixture": Fixture, "fixture: curve": FixtureCurve, "calibrations (each)": Calibration, "calibrations: lines (each)": QuadrantLine,
    }  # fmt: skip
    text = "# Every option of a bench file\n\n" + NOTE
    for name_of, model in sections.items():
        about = " ".join((model.__doc__ or "").split())
        text += f"\n## {name_of}\n\n{about}\n\n{_options(model)}"
    return text


def gates() -> str:
    """The page of the stages and the validity gates of the analysis."""

    def limit(key: str) -> str:
        gate = GATES[key]
        unit = "" if gate.unit == "1" else f" {gate.unit}"
        return f"{'at least' if gate.least else 'at most'} {gate.limit:g}{unit}"

    rows = (
        (f"`{key}`", gate.what, limit(key), f"`validity.{key}`" if gate.configurable else "", gate.failed, gate.action)
        for key, gate in GATES.items()
    )
    head = ("gate", "figure", "limit", "option of the recipe", "when it fails", "what to do")
    return (
        "# Stages and validity gates\n\n" + NOTE + "\nWhat they are for: [the pipeline](pipeline.md).\n"
        "\n## Stages\n\n" + table(("stage", "what it does"), STAGES.items())
        + "\n## Gates\n\nA gate that fails makes the verdict NOT DECIDABLE, whatever the metrics say. A gate whose figure cannot be had"
        " says why, and decides nothing. Shares of the wind-up are of the angle between the turning points.\n\n"
        + table(head, rows)
    )  # fmt: skip


PAGES: dict[str, Callable[[], str]] = {
    "states.md": states,
    "faults.md": faults,
    "process-image.md": process_image,
    "metrics.md": metrics,
    "recipe-options.md": recipe_options,
    "fault-vocabulary.md": fault_vocabulary,
    "bench-options.md": bench_options,
    "gates.md": gates,
}

if __name__ == "__main__":
    for page, text in PAGES.items():
        (FOLDER / page).write_text(text(), encoding="utf-8")
