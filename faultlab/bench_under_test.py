"""The bench of a plant's own tests: a run in virtual time that goes on as the test says (`faultlab.pytest_plugin`)."""

from __future__ import annotations

from typing import Any

import pytest

from definitions.image import Command, Orders
from faultlab.judge import judge
from faultlab.run import Bench, FaultRun
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import load_job
from station.bench.virtual_unit import FIXED_SEED
from virtual_bench.faults.scenario import Expect, Fault, Header, Never, Scenario, When
from virtual_bench.faults.vocabulary import ONLY_OVER_WIRES

DEFAULT_RECIPE = "rv-40e-121-faults"


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
        self._bench = Bench(job, virtual_config(job.bench, job.profile_paths, chosen), None)
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
        """Run until a state was entered and some scans have passed in it; fails when the run ends before."""
        When(state=state)  # a state that does not exist is refused here
        reached = self.state == state or self._bench.until(lambda _: self.state == state)
        if not reached:
            pytest.fail(f"the run ended in {self.state}, before {state}: {' → '.join(self.run.states)}")
        for _ in range(after_scans):
            self._bench.go()
        return self.run.orders[-1] if self.run.orders else self._bench.go()

    def go(self, scans: int = 1) -> Orders:
        """Run some scans."""
        for _ in range(scans - 1):
            self._bench.go()
        return self._bench.go()

    def inject(self, target: str, verb: str, value: float | None = None, for_ms: float | None = None) -> None:
        """Let a fault act from the next scan on; `lostmotion faults list` has the vocabulary.

        Raises:
            ValueError: there is no such fault, or it is one that acts over wires only.

        """
        if (target, verb) in ONLY_OVER_WIRES:
            where = "write a scenario file for it and run that with 'lostmotion faults run FILE --wires'"
            raise ValueError(f"{target} {verb} acts over wires only, this bench runs in virtual time: {where}")
        self._bench.faults.inject([Fault(target=target, verb=verb, value=value, for_ms=for_ms, when=When(time_s=0.0))])

    def order(self, command: str) -> None:
        """Let the operator do something: stop, quick_stop, acknowledge, reset."""
        self._bench.order(Command[command.upper()])
        self._bench.go()

    def finish(self) -> FaultRun:
        """Run to the end, and a little further."""
        if not self._ended:
            self._ended = True
            self._bench.finish()
        return self.run

    def expect(self, **clause: Any) -> None:
        """Finish the run and hold it against one clause of a scenario's `expect`; a fault that did not act fails."""
        self._hold(Scenario(scenario=Header(name="test"), faults=(), expect=(Expect(**clause),)))

    def never(self, **clause: Any) -> None:
        """Finish the run and hold it against one clause of a scenario's `never`."""
        self._hold(Scenario(scenario=Header(name="test"), faults=(), never=(Never(**clause),)))

    def _hold(self, scenario: Scenario) -> None:
        wrong = judge(self.finish(), scenario)
        if wrong:
            pytest.fail("\n".join(wrong), pytrace=False)
