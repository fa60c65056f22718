"""Channels beyond their limits: the conditions that the fault table describes entirely, by a limit and a channel.

Each scan compares all channels of a kind with their limits at once; which of them it was is asked only when one is.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter, gt
from typing import Any, NamedTuple

from controller.conditions import Measured
from definitions.faults import FAULTS, Beyond, bit_of
from definitions.image import AGE_NEVER, Image
from definitions.program import Limits


class Channel(NamedTuple):
    """A channel that is held against a limit, and the bit of the fault that it raises."""

    name: str
    bit: int
    limit: float
    beyond: Beyond
    age: str

    @property
    def of_image(self) -> bool:
        """Whether its value is one of the image, as it came; what was measured from the image goes before."""
        return self.name not in Measured.__slots__


class Group(NamedTuple):
    """Channels that are compared at once: of one object, and all by magnitude or none."""

    of_image: bool
    by_magnitude: bool
    channels: tuple[Channel, ...]
    limits: tuple[float, ...]
    values: Callable[[object], tuple[Any, ...]]


class BeyondLimits:
    """The channels of the fault table's limits against the limits of a program."""

    def __init__(self, limits: Limits) -> None:
        channels = [
            Channel(fault.limit.channel, bit_of(fault.id), getattr(limits, fault.limit.in_program), *fault.limit[-2:])
            for fault in FAULTS
            if fault.limit and fault.limit.channel
        ]
        kinds = sorted({(one.of_image, one.beyond is Beyond.MAGNITUDE) for one in channels})
        self._groups = tuple(_group(kind, channels) for kind in kinds)

    def present(self, image: Image, measured: Measured) -> int:
        """Return the bits of the faults whose channel is beyond its limit, whether an interlock is live or not."""
        bits = 0
        for of_image, by_magnitude, channels, limits, values_of in self._groups:
            values = values_of(image if of_image else measured)
            if any(map(gt, map(abs, values) if by_magnitude else values, limits)):
                bits |= _beyond(channels, values, image)
        return bits


def _group(kind: tuple[bool, bool], channels: list[Channel]) -> Group:
    mine = tuple(one for one in channels if (one.of_image, one.beyond is Beyond.MAGNITUDE) == kind)
    names = [one.name for one in mine]
    # the last one twice: the getter of a single name would return a value, no tuple; comparing ends with the limits
    return Group(*kind, mine, tuple(one.limit for one in mine), attrgetter(*names, names[-1]))


def _beyond(channels: tuple[Channel, ...], values: tuple[Any, ...], image: Image) -> int:
    """Return the bits of those that are beyond their limits."""
    bits = 0
    for channel, found in zip(channels, values, strict=False):
        value = found
        if channel.beyond is Beyond.MAGNITUDE:
            value = abs(found)
        elif channel.beyond is Beyond.AGE:
            value = found - image.missed_periods
        if value > channel.limit and not (channel.age and getattr(image, channel.age) == AGE_NEVER):
            bits |= channel.bit
    return bits
