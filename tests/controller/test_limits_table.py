"""The limits of the fault table: each row is complete, and from it follow option, program and test in every scan."""

from __future__ import annotations

import dataclasses
import math

import pytest
from bench_model import READY
from programs import LIMITS as SHORT_LIMITS

from controller.beyond_limits import BeyondLimits
from controller.conditions import Measured
from definitions.faults import FAULTS, LIMITS, Beyond, Fault, bit_of
from definitions.image import AGE_NEVER, Image
from definitions.program import Limits
from definitions.units import NUMBER
from recipes.schema.recipe_schema import Interlocks

WATCHING = [fault for fault in FAULTS if fault.limit and fault.limit.channel]


def test_every_limit_has_an_option_and_a_place_in_the_program():
    options, of_program = set(Interlocks.model_fields), {one.name for one in dataclasses.fields(Limits)}
    assert {limit.option for limit in LIMITS} == options - {"torque_rate_nm_s"}
    assert {limit.in_program for limit in LIMITS} <= of_program
    assert len({limit.option for limit in LIMITS}) == len({limit.in_program for limit in LIMITS}) == len(LIMITS)


@pytest.mark.parametrize("limit", LIMITS, ids=lambda limit: limit.option)
def test_every_limit_names_what_there_is(limit):
    known = {*Measured.__slots__, *Image._fields}
    assert not limit.channel or limit.channel in known
    assert not limit.age or limit.age in Image._fields
    assert limit.range.least < limit.range.most
    assert limit.kind is NUMBER or limit.kind.unit


def test_only_interlocks_have_limits_and_debounce_times():
    assert all(fault.live_in for fault in FAULTS if fault.limit or fault.time)
    names = {one.name for one in dataclasses.fields(Limits)}
    assert {fault.time.limit for fault in FAULTS if fault.time} - {""} <= names


def _bits(channel: str, value: float, **image: float) -> int:
    measured, values = Measured(), dict(image)
    if channel in Measured.__slots__:
        setattr(measured, channel, value)
    else:
        values[channel] = value
    return BeyondLimits(SHORT_LIMITS).present(READY._replace(**values), measured)


@pytest.mark.parametrize("fault", WATCHING, ids=lambda fault: fault.id)
def test_a_channel_at_its_limit_is_borne_and_one_beyond_is_not(fault: Fault):
    limit = fault.limit
    assert limit is not None
    largest = getattr(SHORT_LIMITS, limit.in_program)
    beyond = largest + 1 if limit.whole else math.nextafter(largest, math.inf)
    assert not _bits(limit.channel, largest) & bit_of(fault.id)
    assert _bits(limit.channel, beyond) & bit_of(fault.id)
    assert bool(_bits(limit.channel, -beyond) & bit_of(fault.id)) == (limit.beyond is Beyond.MAGNITUDE)
    if limit.beyond is Beyond.AGE:
        assert not _bits(limit.channel, beyond, missed_periods=1) & bit_of(fault.id)
    if limit.age:
        assert not _bits(limit.channel, beyond, **{limit.age: AGE_NEVER}) & bit_of(fault.id)
