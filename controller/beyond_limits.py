"""Channels beyond their limits: the conditions that the fault table describes entirely, by a limit and a channel.

Each scan compares the magnitudes of all channels with their limits at once; which one it was, and whether its magnitude
counts, is asked only when one is beyond.
"""

from __future__ import annotations

from functools import reduce
from operator import attrgetter, gt, or_
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


class BeyondLimits:
    """The channels of the fault table's limits against the limits of a program."""

    def __init__(self, limits: Limits) -> None:
        channels = [
            Channel(fault.limit.channel, bit_of(fault.id), getattr(limits, fault.limit.in_program), *fault.limit[-2:])
            for fault in FAULTS
            if fault.limit and fault.limit.channel
        ]
        self.bits = reduce(or_, (one.bit for one in channels))
        """Bits of all faults that `present` may answer with."""
        self._of_image = tuple(one for one in channels if one.of_image)
        self._measured = tuple(one for one in channels if not one.of_image)
        self._image_limits = tuple(one.limit for one in self._of_image)
        self._measured_limits = tuple(one.limit for one in self._measured)
        self._image_values = attrgetter(*(one.name for one in self._of_image))
        self._measured_values = attrgetter(*(one.name for one in self._measured))

    def present(self, image: Image, measured: Measured, *_: object) -> int:
        """Return the bits of the faults whose channel is beyond its limit, whether an interlock is live or not."""
        # A magnitude is no smaller than the value or the age that counts: where none is beyond, nothing is looked at.
        bits = 0
        values = self._image_values(image)
        if any(map(gt, map(abs, values), self._image_limits)):
            bits = _beyond(self._of_image, values, image)
        values = self._measured_values(measured)
        if any(map(gt, map(abs, values), self._measured_limits)):
            bits |= _beyond(self._measured, values, image)
        return bits


def _beyond(channels: tuple[Channel, ...], values: tuple[Any, ...], image: Image) -> int:
    """Return the bits of those that are beyond their limits."""
    bits = 0
    for channel, found in zip(channels, values, strict=True):
        value = found
        if channel.beyond is Beyond.MAGNITUDE:
            value = abs(found)
        elif channel.beyond is Beyond.AGE:
            value = found - image.missed_periods
        if value > channel.limit and not (channel.age and getattr(image, channel.age) == AGE_NEVER):
            bits |= channel.bit
    return bits
