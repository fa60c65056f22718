"""Sections of a bench file that say where each measured channel comes from: devices on Modbus, sensors on CAN."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from definitions.units import PERIOD
from recipes.text.quantity import show
from recipes.text.section import Age, Name, Section, refusal

CHANNELS = ("torque_in", "torque_out", "angle_in", "angle_out")
"""Measured channels, by the names of their sensors."""


SHORTEST_HEARTBEAT_S = 0.002
"""0x1017 counts milliseconds; every millisecond would be a frame more than the sensor's values."""


class ChannelSource(Section):
    """Where a channel comes from: device and field of its profile; value = field × scale + offset, in N·m or rad.

    alive: what shows that a value is new. counter, time_stamp: `alive_field` of the same block has changed. noise: that
    field, by default the value itself, has changed within `still`; a sensor without noise at rest cannot be proven so.
    arrival: every answer or frame counts as new, and each result says that this is not proven.
    """

    device: Name
    field: Name
    scale: Annotated[float, Field(ge=-1e9, le=1e9)] = 1.0
    offset: Annotated[float, Field(ge=-1e9, le=1e9)] = 0.0
    alive: Literal["counter", "time_stamp", "noise", "arrival"]
    alive_field: Name | None = None
    still_s: Age | None = None

    @model_validator(mode="after")
    def _proof_fits(self) -> ChannelSource:
        if self.scale == 0.0:
            raise refusal("scale: 0", "any other number; a negative scale reverses the sign of the channel", at="scale")
        named = self.alive_field is not None
        if self.alive in ("counter", "time_stamp") and not named:
            hint = "Add, for example, 'alive_field: sample_counter', with the name of this field in the device profile."
            allowed = f"alive: {self.alive} with the field of the counter or time stamp"
            raise refusal(f"alive: {self.alive} without alive_field", allowed, hint, at="alive")
        if self.alive == "arrival" and named:
            raise refusal("alive: arrival with alive_field", "one of the two", "Delete one of them.", at="alive_field")
        if self.alive == "noise" and self.still_s is None:
            hint = "'still' is the longest time for which a healthy sensor shows the same number, such as '50 ms'."
            raise refusal("alive: noise without still", "alive: noise with still", hint, at="alive")
        if self.alive != "noise" and self.still_s is not None:
            raise refusal(f"alive: {self.alive} with still", "still with alive: noise only", "Delete it.", at="still")
        return self

    @property
    def proof_field(self) -> str:
        """Field whose change shows that a value is new; empty where nothing does."""
        if self.alive == "arrival":
            return ""
        return self.alive_field or self.field


class CanSensor(Section):
    """A sensor on the CAN bus of the drive that `channels` name; its profile is a YAML file or a DBC file.

    node_id: of a CANopen node, which is started by NMT. update_every: how often it sends by itself; left out for one
    that sends with every SYNC, which is every scan. heartbeat: how often a CANopen node says that it is operational;
    written into it (0x1017), and watched in every scan.
    """

    name: Name
    profile: Name
    node_id: Annotated[int, Field(ge=1, le=127)] | None = None
    update_every_s: Age | None = None
    heartbeat_s: Age | None = None

    @model_validator(mode="after")
    def _a_node_has_a_heartbeat(self) -> CanSensor:
        if self.heartbeat_s is not None and self.node_id is None:
            hint = "Add the node id of a CANopen sensor; a sensor of raw frames has no heartbeat."
            raise refusal("heartbeat without node_id", "both, or no heartbeat", hint, at="heartbeat")
        if self.heartbeat_s is not None and self.heartbeat_s < SHORTEST_HEARTBEAT_S:
            raise refusal(
                f"a heartbeat of {show(self.heartbeat_s, PERIOD)}",
                f"at least {show(SHORTEST_HEARTBEAT_S, PERIOD)}",
                at="heartbeat",
            )
        return self


class Channels(Section):
    """Sources of the measured channels: of all sensors, or of none, where all are the amplifier's."""

    torque_in: ChannelSource | None = None
    torque_out: ChannelSource | None = None
    angle_in: ChannelSource | None = None
    angle_out: ChannelSource | None = None

    @property
    def by_name(self) -> dict[str, ChannelSource]:
        """The sources that there are, by the names of their sensors."""
        named = {name: getattr(self, name) for name in CHANNELS}
        return {name: source for name, source in named.items() if source is not None}
