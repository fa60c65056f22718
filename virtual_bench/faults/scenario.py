"""The scenario file: faults to inject, what the operator does, and what must and must not happen.

A scenario names faults by target and verb (`fault_vocabulary`), each with the moment at which it starts:

    scenario: {name: heartbeat lost}
    faults:
      - {target: can.drive.heartbeat, verb: off, when: {state: ramp_pos, after_scans: 200}}
    expect:
      - {event: drive_heartbeat_lost, within_scans: 121}
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

from pydantic import BaseModel, ConfigDict, Field, model_validator

from definitions.image import Command, DriveCommand, State
from virtual_bench.faults.vocabulary import BY_STATION, FAULTS, ONCE

STATE_NAMES = tuple(state.name.lower() for state in State)
ORDER_NAMES = tuple(command.name.lower() for command in DriveCommand)
COMMAND_NAMES = tuple(command.name.lower() for command in Command if command)


OF_THE_RECORD = ("found_as", "record", "verdict")
"""What can be expected of the kept record of a run over wires; a run in virtual time need not have one."""

EXPECT_KINDS = ("event", "order", "torque_below_nm", "final_state", "latched", "refused", *OF_THE_RECORD)


class Strict(BaseModel):
    """Base of the file's models: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _one_of(name: str, found: str | None, allowed: tuple[str, ...]) -> None:
    if found is not None and found not in allowed:
        raise ValueError(f"{name}: found {found!r}, allowed {', '.join(allowed)}")


class When(Strict):
    """Moment at which something starts; exactly one of the four, and with a state the scans after it was entered."""

    torque_out_above_nm: float | None = None  # of the magnitude of the torque in the reducer
    time_s: float | None = None  # since the bench was started
    state: str | None = None  # of the controller, when it is entered
    after_scans: int = Field(default=0, ge=0)
    scan: int | None = Field(default=None, ge=0)

    @model_validator(mode="after")
    def _one_condition(self) -> Self:
        given = [self.torque_out_above_nm, self.time_s, self.state, self.scan]
        if sum(item is not None for item in given) != 1:
            raise ValueError("give exactly one of torque_out_above_nm, time_s, state and scan")
        if self.after_scans and self.state is None:
            raise ValueError("after_scans counts from the entry into a state: give the state too")
        _one_of("state", self.state, STATE_NAMES)
        return self

    @property
    def needs_controller(self) -> bool:
        """Whether only one who sees the controller's state can tell the moment."""
        return self.state is not None or self.scan is not None


class Fault(Strict):
    """One fault: what, how, by how much, when, and for how long (without `for_ms`: to the end)."""

    target: str
    verb: str
    value: float | None = None
    when: When
    for_ms: float | None = Field(default=None, gt=0.0)

    @model_validator(mode="after")
    def _known(self) -> Self:
        key = (self.target, self.verb)
        if key not in FAULTS:
            verbs = sorted(verb for target, verb in FAULTS if target == self.target)
            if verbs:
                raise ValueError(f"found verb {self.verb!r} for {self.target}, allowed {', '.join(verbs)}")
            targets = ", ".join(sorted({target for target, _ in FAULTS}))
            raise ValueError(f"found target {self.target!r}, allowed {targets}")
        row = FAULTS[key]
        if bool(row.value) != (self.value is not None):
            needed = f"needs value: {row.value}" if row.value else "takes no value"
            raise ValueError(f"{self.target} {self.verb} {needed}")
        if self.value is not None and not row.low <= self.value <= row.high:
            raise ValueError(
                f"{self.target} {self.verb}: found value {self.value:g}, allowed {row.low:g} to {row.high:g}"
            )
        if key in BY_STATION and not self.when.needs_controller:
            raise ValueError(f"{self.target} {self.verb} happens outside the bench: give state or scan")
        if key in ONCE and self.for_ms is not None:
            raise ValueError(f"{self.target} {self.verb} takes no for_ms: it happens once and is not undone")
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

    command: Literal["stop", "quick_stop", "acknowledge", "reset", "start"]
    when: When

    @model_validator(mode="after")
    def _seen(self) -> Self:
        if not self.when.needs_controller:
            raise ValueError("an operator's action has no torque or time trigger: give state or scan")
        return self


class Expect(Strict):
    """Something that must happen; exactly one kind per entry.

    `event` (fault id) within scans of the first fault's action; `order` (drive command) within scans of the first
    alarm; `torque_below_nm` within seconds of the first alarm, or `since` the first fault acted, and from then on;
    `final_state`; `latched`: nothing leaves the state fault by itself; `refused`: the bench is not opened, nothing
    moves, and the reason has this text. Over wires only, of what is kept of the run: `found_as`, its state;
    `record`: every scan that was recorded is on disk, in order and unchanged; `verdict`.
    """

    event: str | None = None
    order: str | None = None
    within_scans: int | None = Field(default=None, ge=0)
    torque_below_nm: float | None = Field(default=None, gt=0.0)
    within_s: float | None = Field(default=None, gt=0.0)
    since: Literal["alarm", "fault"] | None = None
    final_state: str | None = None
    latched: bool | None = None
    refused: str | None = None
    found_as: Literal["complete", "stopped", "fault", "interrupted"] | None = None
    record: Literal["complete"] | None = None
    verdict: Literal["PASS", "FAIL", "NOT DECIDABLE"] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if sum(getattr(self, kind) is not None for kind in EXPECT_KINDS) != 1:
            raise ValueError(f"give exactly one of {', '.join(EXPECT_KINDS[:-1])} and {EXPECT_KINDS[-1]}")
        if (self.event is None and self.order is None) != (self.within_scans is None):
            raise ValueError("within_scans belongs to event and order, and they need it")
        if (self.torque_below_nm is None) != (self.within_s is None):
            raise ValueError("within_s belongs to torque_below_nm, which needs it")
        if self.since is not None and self.torque_below_nm is None:
            raise ValueError("since belongs to torque_below_nm")
        _one_of("final_state", self.final_state, STATE_NAMES)
        _one_of("order", self.order, ORDER_NAMES)
        return self


class Never(Strict):
    """Something that must not happen in any scan; exactly one kind per entry."""

    state: str | None = None
    event: str | None = None
    torque_above_nm: float | None = Field(default=None, gt=0.0)
    order_after_fault: str | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = [self.state, self.event, self.torque_above_nm, self.order_after_fault]
        if sum(kind is not None for kind in kinds) != 1:
            raise ValueError("give exactly one of state, event, torque_above_nm and order_after_fault")
        _one_of("state", self.state, STATE_NAMES)
        _one_of("order_after_fault", self.order_after_fault, ORDER_NAMES)
        return self


class Scenario(Strict):
    """A scenario file."""

    scenario: Header
    start: Start = Start()
    faults: tuple[Fault, ...]
    operator: tuple[Operator, ...] = ()
    expect: tuple[Expect, ...] = ()
    never: tuple[Never, ...] = ()
