"""The bench of a plant's own tests: a run in virtual time that goes on as the test says (`faultlab.pytest_plugin`).

A failure is shown at the line of the test: what a test calls in here hides itself from pytest's traceback.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import pytest
from pydantic import BaseModel, ValidationError

from definitions.image import Command, Orders
from faultlab.given import given_lines
from faultlab.judge import judge
from faultlab.run import LONGEST_RUN_S, Bench, FaultRun
from recipes.text.problems import Mark, Source
from recipes.text.translation import problem_of
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import load_job
from station.bench.virtual_unit import FIXED_SEED
from virtual_bench.faults.scenario import Expect, Fault, Header, Never, Operator, Scenario, When
from virtual_bench.faults.vocabulary import FAULTS, only_over_wires

HIDDEN = "__tracebackhide__"
"""Local variable of functions that pytest leaves out of its tracebacks; the place of a call is outside of them."""

ModelT = TypeVar("ModelT", bound=BaseModel)


def checked(model: type[ModelT], options: Mapping[str, Any]) -> ModelT:
    """Return a section of a scenario made of a call's options.

    Raises:
        ValueError: an option is unknown, missing or wrong; a line for each with the place of the call.

    """
    __tracebackhide__ = True
    try:
        return model.model_validate(dict(options), strict=True)
    except ValidationError as error:
        source = _call(options)
        problems = [problem_of(detail, source, model) for detail in error.errors(include_url=False)]
    raise ValueError("\n".join(map(str, problems)))


def _call(options: Mapping[str, Any]) -> Source:
    """Return the call of a test as a document: its options, all at the place of the call."""
    frame = inspect.currentframe()
    while frame is not None and (frame.f_code.co_filename == __file__ or HIDDEN in frame.f_locals):
        frame = frame.f_back
    if frame is None:
        return Source("", dict(options), {})
    info = inspect.getframeinfo(frame, context=0)
    column = 0 if info.positions is None else info.positions.col_offset or 0
    mark = Mark(info.lineno, column + 1, info.lineno, column + 1)
    path, here = Path(info.filename), Path.cwd()
    shown = path.relative_to(here) if path.is_relative_to(here) else path
    return Source(str(shown), dict(options), {(): mark} | {(name,): mark for name in options})


DEFAULT_RECIPE = "rv-40e-121-faults"
AT_ONCE = When(time_s=0.0)
BY_HAND = When(scan=0)
HEADER = Header(name="test")


class BenchUnderTest:
    """A bench with a run on it: `until` a moment, `inject` a fault, `expect` what must come of it."""

    def __init__(
        self,
        recipe: str = DEFAULT_RECIPE,
        bench: str | None = None,
        unit: str | None = None,
        seed: int = FIXED_SEED,
    ) -> None:
        job = load_job(recipe, bench)
        chosen = choose_unit(unit, job.recipe, seed)
        self._bench = Bench(job.program, virtual_config(job.bench, job.profile_paths, chosen), None)
        self._ended = False

    @property
    def state(self) -> str:
        """State of the controller, as in records."""
        return self._bench.state

    @property
    def run(self) -> FaultRun:
        """Everything so far: images, orders, torque in the reducer, events."""
        return self._bench.run

    def until(self, state: str, after_scans: int = 0) -> Orders:
        """Run until a state was entered and some scans have passed in it.

        Fails where that does not come: the run ends before, leaves the state before, or takes more than 300 s of its
        own time. The failure lists what came instead.

        Raises:
            ValueError: there is no such state, or `after_scans` is not a whole number from 0.

        """
        __tracebackhide__ = True
        self._must_go_on("until")
        checked(When, {"state": state, "after_scans": after_scans})
        wanted = f"until state {state}" + (f", after_scans {after_scans}" if after_scans else "")
        if self.state != state and not self._bench.until(lambda _: self.state == state):
            self._never_came(wanted)
        most = round(LONGEST_RUN_S / self.run.period_s)
        for passed in range(after_scans):
            if passed >= most:
                self._never_came(wanted)
            self._bench.go()
            if self.state != state:
                self._never_came(wanted, f"{state} was left for {self.state} after {passed + 1} scans")
        return self.run.orders[-1] if self.run.orders else self._bench.go()

    def go(self, scans: int = 1) -> Orders:
        """Run some scans.

        Raises:
            ValueError: `scans` is below 1.

        """
        __tracebackhide__ = True
        self._must_go_on("go")
        if scans < 1:
            raise ValueError(f"go: found {scans} scans; allowed: a whole number from 1")
        for _ in range(scans - 1):
            self._bench.go()
        return self._bench.go()

    def inject(self, target: str, verb: str, value: float | None = None, for_ms: float | None = None) -> None:
        """Let a fault act from the next scan on; `lostmotion faults list` has the vocabulary.

        Raises:
            ValueError: there is no such fault, or it is one that acts over wires only.

        """
        __tracebackhide__ = True
        self._must_go_on("inject")
        if (target, verb) in FAULTS and only_over_wires(target, verb):
            where = "write a scenario file for it and run that with 'lostmotion faults run FILE --wires'"
            raise ValueError(f"{target} {verb} acts over real wires only, and this bench runs in virtual time: {where}")
        options = {"target": target, "verb": verb, "value": value, "for_ms": for_ms, "when": AT_ONCE}
        self._bench.faults.inject([checked(Fault, options)])

    def order(self, command: str) -> None:
        """Let the operator do something: stop, quick_stop, acknowledge, reset, start.

        Raises:
            ValueError: there is no such command.

        """
        __tracebackhide__ = True
        self._must_go_on("order")
        item = checked(Operator, {"command": command, "when": BY_HAND})
        self._bench.order(Command[item.command.upper()])
        self._bench.go()

    def finish(self) -> FaultRun:
        """Run to the end, and a little further."""
        if not self._ended:
            self._ended = True
            self._bench.finish()
        return self.run

    def expect(self, **clause: Any) -> None:
        """Finish the run and hold it against one clause of a scenario's `expect`; a fault that did not act fails.

        Raises:
            ValueError: it is no clause of a scenario.

        """
        __tracebackhide__ = True
        self._hold(Scenario(scenario=HEADER, faults=(), expect=(checked(Expect, clause),)))

    def never(self, **clause: Any) -> None:
        """Finish the run and hold it against one clause of a scenario's `never`.

        Raises:
            ValueError: it is no clause of a scenario.

        """
        __tracebackhide__ = True
        self._hold(Scenario(scenario=HEADER, faults=(), never=(checked(Never, clause),)))

    def _hold(self, scenario: Scenario) -> None:
        __tracebackhide__ = True
        wrong = judge(self.finish(), scenario)
        if wrong:
            pytest.fail("\n".join([*wrong, "given were", *given_lines(self.run)]))

    def _must_go_on(self, call: str) -> None:
        """Refuse what would come too late: nothing that happens after the end is judged any more."""
        __tracebackhide__ = True
        if self._ended:
            pytest.fail(
                f"{call}: the run has ended, the first expect or never runs it to its end; put {call} before them"
            )

    def _never_came(self, wanted: str, instead: str = "") -> NoReturn:
        __tracebackhide__ = True
        if not instead:
            ended = self._bench.controller.finished
            instead = (
                f"the run ended in {self.state}" if ended else f"{LONGEST_RUN_S:g} s later the run is in {self.state}"
            )
        pytest.fail("\n".join([f"{wanted} never came: {instead}; given were", *given_lines(self.run)]))
