"""The scenario file: faults to inject, what the operator does, and what must and must not happen.

A scenario names faults by target and verb (`fault_vocabulary`), each with the moment at which it starts:

    scenario: {name: heartbeat lost}
    faults:
      - {target: can.drive.heartbeat, verb: off, when: {state: ramp_pos, after_scans: 200}}
    expect:
      - {event: drive_heartbeat_lost, within_scans: 121}
      - {reaction: power_off, within_scans: 0}
      - {order: disable_voltage, within_scans: 0}
      - {torque_below_nm: 33, within_s: 1.0}
      - {final_state: fault}
      - {latched: true}
    never:
      - {state: complete}
      - {torque_above_nm: 500}

`lostmotion run --scenario` injects the faults; `lostmotion faults run` judges `expect` and `never` as well.
"""

from __future__ import annotations

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from virtual_bench.faults.names import (
    CommandName,
    EventName,
    OrderName,
    ReactionName,
    StateName,
    Target,
    refusal,
    verb_of,
    vocabulary_in,
)
from virtual_bench.faults.vocabulary import BY_STATION, ONCE

OF_THE_RECORD = ("found_as", "record", "verdict")
"""What can be expected of the kept record of a run over wires; a run in virtual time need not have one."""

EXPECT_KINDS = ("event", "reaction", "order", "torque_below_nm", "final_state", "latched", "refused", *OF_THE_RECORD)

TRIGGERS = ("torque_out_above_nm", "time_s", "state", "scan")
"""Conditions of which a moment has exactly one."""

COUNTED_IN_SCANS = ("event", "reaction", "order")
"""Kinds that need `within_scans`."""


class Strict(BaseModel):
    """Base of the file's models: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _one_kind(given: BaseModel, kinds: tuple[str, ...]) -> None:
    """Refuse a section that has none of `kinds`, or more than one."""
    found = [kind for kind in kinds if getattr(given, kind) is not None]
    if len(found) != 1:
        allowed = f"exactly one of {', '.join(kinds[:-1])} and {kinds[-1]}"
        raise refusal(" and ".join(found) or "none of them", allowed)


class When(Strict):
    """Moment at which something starts; exactly one of the four, and with a state the scans after it was entered."""

    torque_out_above_nm: float | None = None  # of the magnitude of the torque in the reducer
    time_s: float | None = None  # since the bench was started
    state: StateName | None = None  # of the controller, when it is entered
    after_scans: int = Field(default=0, ge=0)
    scan: int | None = Field(default=None, ge=0)

    @model_validator(mode="after")
    def _one_condition(self) -> Self:
        _one_kind(self, TRIGGERS)
        if self.after_scans and self.state is None:
            raise refusal(
                "no state", "after_scans together with a state", "Add the state: scans are counted from its entry."
            )
        return self

    @property
    def trigger(self) -> str:
        """Name of the condition that is given."""
        return next(name for name in TRIGGERS if getattr(self, name) is not None)

    @property
    def needs_controller(self) -> bool:
        """Whether only one who sees the controller's state can tell the moment."""
        return self.state is not None or self.scan is not None


class Fault(Strict):
    """One fault: what, how, by how much, when, and for how long (without `for_ms`: to the end)."""

    target: Target
    verb: str
    value: float | None = None
    when: When
    for_ms: float | None = Field(default=None, gt=0.0)

    @field_validator("verb")
    @classmethod
    def _of_target(cls, verb: str, info: ValidationInfo) -> str:
        target = info.data.get("target")  # missing where it is wrong itself, and reported there
        return verb if target is None else verb_of(target, verb, vocabulary_in(info))

    @model_validator(mode="after")
    def _known(self, info: ValidationInfo) -> Self:
        vocabulary, key = vocabulary_in(info), (self.target, self.verb)
        verb_of(self.target, self.verb, vocabulary)  # a fault of another bench that is put into a scenario of this one
        name, row = " ".join(key), vocabulary[key]
        if row.value and self.value is None:
            raise refusal("no value", f"{name} needs value: {row.value}", "Add it.")
        if self.value is not None and not row.value:
            raise refusal(f"value {self.value:g}", f"{name} takes no value", "Delete it.", at="value")
        if self.value is not None and not row.low <= self.value <= row.high:
            raise refusal(f"{self.value:g}", f"a number from {row.low:g} to {row.high:g} ({row.value})", at="value")
        if key in BY_STATION and not self.when.needs_controller:
            hint = f"{name} acts outside the bench, where its torque and time are not known."
            raise refusal(self.when.trigger, "state or scan", hint, at="when")
        if key in ONCE and self.for_ms is not None:
            allowed = f"{name} takes no for_ms: it happens once and is not undone"
            raise refusal(f"{self.for_ms:g}", allowed, "Delete it.", at="for_ms")
        return self


class Header(Strict):
    """Name of the scenario."""

    name: str
    description: str = ""


class Start(Strict):
    """What the scenario begins with: a recipe (a file, or a shipped one) and a unit on the virtual bench."""

    recipe: str = ""
    unit: str = ""


class Operator(Strict):
    """What the operator does in the middle of it."""

    command: CommandName
    when: When

    @model_validator(mode="after")
    def _seen(self) -> Self:
        if not self.when.needs_controller:
            hint = "The operator sees neither torque nor time of the bench."
            raise refusal(self.when.trigger, "state or scan", hint, at="when")
        return self


class Expect(Strict):
    """Something that must happen; exactly one kind per entry.

    `event` (fault id) within scans of the first fault's action; `reaction` (with the order, state and contacts that
    `reactions` gives it) and `order` (drive command) within scans of the first alarm; `torque_below_nm` within seconds
    of the first alarm, or `since` the first fault acted, and from then on; `final_state`; `latched`: nothing leaves the
    state fault by itself; `refused`: the bench is not opened, nothing moves, and the reason has this text. Over wires
    only, of what is kept of the run: `found_as`, its state; `record`: every scan that was recorded is on disk, in order
    and unchanged; `verdict`.
    """

    event: EventName | None = None
    reaction: ReactionName | None = None
    order: OrderName | None = None
    within_scans: int | None = Field(default=None, ge=0)
    torque_below_nm: float | None = Field(default=None, gt=0.0)
    within_s: float | None = Field(default=None, gt=0.0)
    since: Literal["alarm", "fault"] | None = None
    final_state: StateName | None = None
    latched: bool | None = None
    refused: str | None = None
    found_as: Literal["complete", "stopped", "fault", "interrupted"] | None = None
    record: Literal["complete"] | None = None
    verdict: Literal["PASS", "FAIL", "NOT DECIDABLE"] | None = None

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        _one_kind(self, EXPECT_KINDS)
        timed = next((kind for kind in COUNTED_IN_SCANS if getattr(self, kind) is not None), None)
        if timed is not None and self.within_scans is None:
            raise refusal("no within_scans", f"{timed} needs within_scans: whole scans from 0", "Add it.")
        if timed is None and self.within_scans is not None:
            raise refusal(
                f"{self.within_scans}", f"within_scans only with {', '.join(COUNTED_IN_SCANS)}", "Delete it.",
                at="within_scans",
            )  # fmt: skip
        if self.torque_below_nm is not None and self.within_s is None:
            raise refusal("no within_s", "torque_below_nm needs within_s: seconds above 0", "Add it.")
        if self.torque_below_nm is None and self.within_s is not None:
            raise refusal(f"{self.within_s:g}", "within_s only with torque_below_nm", "Delete it.", at="within_s")
        if self.since is not None and self.torque_below_nm is None:
            raise refusal(self.since, "since only with torque_below_nm", "Delete it.", at="since")
        return self


class Never(Strict):
    """Something that must not happen in any scan; exactly one kind per entry."""

    state: StateName | None = None
    event: EventName | None = None
    torque_above_nm: float | None = Field(default=None, gt=0.0)
    order_after_fault: OrderName | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        _one_kind(self, ("state", "event", "torque_above_nm", "order_after_fault"))
        return self


class Scenario(Strict):
    """A scenario file."""

    scenario: Header
    start: Start = Start()
    faults: tuple[Fault, ...]
    operator: tuple[Operator, ...] = ()
    expect: tuple[Expect, ...] = ()
    never: tuple[Never, ...] = ()
