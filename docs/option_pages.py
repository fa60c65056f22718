"""The pages of every option of a recipe and of a bench file, read off their schemas."""

from __future__ import annotations

from datetime import date
from typing import Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from docs.markdown import NOTE, table
from recipes.schema.bench_schema import BenchHeader, JogSection, MasterPart, PaceOfBench, TorqueControl
from recipes.schema.calibration_schema import (
    CalibratedUnit,
    Calibration,
    Fixture,
    FixtureCurve,
    FixtureParts,
    QuadrantLine,
    UnitLine,
)
from recipes.schema.channel_schema import CanSensor, Channels, ChannelSource
from recipes.schema.device_schema import BrakeDevice, DriveBrake, MeasuringDevice, ModbusDevice
from recipes.schema.drive_schema import CanBus, Drive
from recipes.schema.interlock_schema import Interlocks
from recipes.schema.metric_schema import MetricWanted
from recipes.schema.recipe_schema import (
    Decision,
    Header,
    LoadingTorqueRatio,
    Measurement,
    Sampling,
    UnitUnderTest,
    Validity,
    WhatToDo,
)
from recipes.schema.sensor_schema import AngleSensor, Sensors, TorqueSensor
from recipes.schema.sequence_schema import (
    Calibrate,
    FatigueCycles,
    Home,
    Lock,
    Release,
    SpeedCycles,
    StepCycles,
    TorqueCycles,
    TorqueSweep,
    Unload,
)
from recipes.text.quantity import show
from recipes.text.section import Quantity


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


RECIPE_SECTIONS = {
    "recipe": Header, "unit_under_test": UnitUnderTest, "unit_under_test.loading_torque_ratio": LoadingTorqueRatio,
    "measurement": Measurement, "sampling": Sampling, "interlocks": Interlocks, "metrics (each)": MetricWanted,
    "decision": Decision, "validity": Validity, "what_to_do": WhatToDo,
}  # fmt: skip
RECIPE_STEPS = {
    "home": Home, "lock": Lock, "calibrate": Calibrate, "torque_cycles": TorqueCycles, "speed_cycles": SpeedCycles,
    "step_cycles": StepCycles, "fatigue_cycles": FatigueCycles, "torque_sweep": TorqueSweep, "unload": Unload,
    "release": Release,
}  # fmt: skip
"""Sections of a recipe and its steps, by their names in the file; a test holds them against the schema."""

BENCH_SECTIONS = {
    "bench": BenchHeader, "can": CanBus, "drive": Drive, "amplifier, remote_io": ModbusDevice, "brake": BrakeDevice, "drive_brake": DriveBrake,
    "devices (each)": MeasuringDevice, "can_devices (each)": CanSensor, "channels": Channels, "channels: torque_in, torque_out, angle_in, angle_out": ChannelSource,
    "sensors": Sensors, "sensors: torque_in, torque_out": TorqueSensor, "sensors: angle_in, angle_out": AngleSensor,
    "jog": JogSection, "pace": PaceOfBench, "torque_control": TorqueControl, "fixture": Fixture, "fixture: parts": FixtureParts, "fixture: curve": FixtureCurve, "calibrations (each)": Calibration, "calibrations: lines (each)": QuadrantLine, "calibrations: units (each)": CalibratedUnit, "calibrations: units: lines (each)": UnitLine,
    "master_parts (each)": MasterPart,
}  # fmt: skip
"""Sections of a bench file, by their names there."""


def recipe_options() -> str:
    """The page of every option of a recipe."""
    text = "# Every option of a recipe\n\n" + NOTE
    text += "\n`loading` is `input` or `output`. `report` is `on_request`, the default, or `always`: then pictures and report are"
    text += " made after every run.\nTimes, ages and speeds without default must be given.\n"
    for name_of, model in RECIPE_SECTIONS.items():
        text += f"\n## {name_of}\n\n{_options(model)}"
    for name_of, model in RECIPE_STEPS.items():
        text += f"\n## sequence: {name_of}\n\n{(model.__doc__ or '').strip()}\n\n{_options(model)}"
    return text


def bench_options() -> str:
    """The page of every option of a bench file."""
    text = "# Every option of a bench file\n\n" + NOTE
    for name_of, model in BENCH_SECTIONS.items():
        about = " ".join((model.__doc__ or "").split())
        text += f"\n## {name_of}\n\n{about}\n\n{_options(model)}"
    return text
