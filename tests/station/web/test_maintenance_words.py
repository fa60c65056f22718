"""The page of maintenance in every language: each text that it asks for a translation of has one."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from datetime import date

import pytest
from station_support import GOLDEN
from test_bench_sight import FRESH, NO_ORDERS, SETTLED

from definitions.faults import FAULTS, bit_of
from definitions.image import State
from definitions.program import Program
from station.bench.request import load_job
from station.documents.events import LeftState
from station.documents.manifest import MASTER
from station.records.left_state import left_action
from station.records.master_parts import ONE_SIDED
from station.records.samples.scan_record import pack
from station.web.bench.changes import IN_PROGRESS, RunFacts, Since, changes_between
from station.web.bench.due import Due, _due
from station.web.bench.sight import sight_of
from station.web.bench.watch import Seen
from station.web.bench.way_back import Fault, Standing, steps
from station.web.languages import ENGLISH, LANGUAGES, Words
from station.web.pages.maintenance import MARKS, SAID, _ago, _parts, _torque, fault_said

FIGURES = re.compile(r"[−\d.]+( [^a-z]\S*)?|[RB]|")
"""What is the same in every language: a figure with its unit, and the names of the test."""


READ = "read PASS, as it should (2 h before, run R). "
BY_ANOTHER = "was last measured by recipe R revision 1 [R] (2 h before, run R)"
OF_A_MASTER_PART = (
    "was never measured on this bench; needed every 8 h",
    f"{READ}The bench rejects a bad unit like this master part",
    f"{READ}A measuring error above 3 % of the metric lost_motion would have been detected",
    f"{READ}{ONE_SIDED}",
    "has an altered record (2 h before, run R): it proves nothing. Measure it again",
    "read FAIL, and PASS is right (2 h before, run R): this bench may measure wrong",
    "was last measured 9 h before, run R; due every 8 h",
    f"{BY_ANOTHER}; needed is recipe R revision 2 [R]. Measure it by that recipe",
    f"{BY_ANOTHER}, which is not the newest released one of this name. Measure it by a released recipe",
)
LEFT_ENGLISH = re.compile(r"\b(before|run|bench|measur\w+|every|read|the|technician)\b")


class Asked(Words):
    """Words that keep each text that they were asked for, and did not have."""

    def __init__(self, language: str) -> None:
        super().__init__(language)
        self.without: list[str] = []

    def __call__(self, text: str, **values: object) -> str:
        said = super().__call__(text, **values)
        there = text in self._texts if values else said != text or text in self._texts
        if not there and not FIGURES.fullmatch(text):
            self.without.append(text)
        return said

    def reading(self, value: str) -> str:
        return ", ".join(self(part) if part in SAID else part for part in value.split(", "))

    def sentences(self, text: str) -> str:
        return " ".join(self(one) for one in text.replace(". ", ".\n").split("\n"))


@pytest.fixture(scope="module")
def program() -> Program:
    return load_job(str(GOLDEN), None).program


@pytest.fixture(params=[one for one in LANGUAGES if one != ENGLISH])
def say(request: pytest.FixtureRequest) -> Asked:
    return Asked(request.param)


def test_values_interlocks_and_alarms(say: Asked, program: Program) -> None:
    parts = _parts()
    states = [(state, 0) for state in State] + [(State.FAULT, bit_of(fault.id)) for fault in FAULTS]
    for (state, alarms), locked in itertools.product(states, (0, 1)):
        orders = NO_ORDERS._replace(state=state, alarms=alarms, phase=SETTLED)
        image = FRESH._replace(brake_on=locked, links_lost=1 - locked, sample_age_scans=1 + 400 * locked)
        sight = sight_of(pack((0, 0, 0, 0), image, orders), program)
        for live, recovery, ago_s in itertools.product((True, False), (True, False), (1.0, 200.0, 9e3, 9e5)):
            seen = Seen(live, "R", recovery, ago_s, sight)
            parts.head(seen, sight, _ago(seen, say), _torque(sight, say), not live, say)
        parts.alarms(sight.alarms, say)
        parts.devices(sight.devices, sight.outputs, say, say.reading)
        parts.limits(sight.limits, say, say.reading)
    parts.alarms((), say)
    for why in ("No run was made yet.", "The devices are being opened."):
        parts.head(Seen(why_none=why), None, "", "", False, say)  # noqa: FBT003 - nothing is wound up
    assert say.without == []


def test_the_recovery_after_a_fault(say: Asked, program: Program) -> None:
    parts = _parts()
    fault = Fault("R", "B", "fault", None, f"{FAULTS[0].text}. {FAULTS[0].next_action}. Servo drive: x.")
    for state, settled, safe in itertools.product(State, (0, SETTLED), (0, 1)):
        orders = NO_ORDERS._replace(state=state, phase=settled)
        image = FRESH._replace(estop_released=safe, guard_closed=safe, drive_age_scans=0 if safe else 10_000)
        sight = sight_of(pack((0, 0, 0, 0), image, orders), program)
        for one, unproven in itertools.product((sight, None), (False, True)):
            rows = steps(Standing(replace(fault, unproven=unproven), recovery="R" if one else ""), one)
            parts.steps(rows, MARKS, say, say.sentences)
    left = LeftState(torque_nm=12.0, torque_known=True, lock="closed", lock_known=True, drive="on", drive_known=True,
                     release_torque_nm=4.0)  # fmt: skip
    for torque_nm, lock, drive, known in itertools.product(
        (None, 0.5, 12.0), ("open", "closed"), ("on", "off"), (True, False)
    ):
        one = replace(left, torque_nm=torque_nm, lock=lock, drive=drive, lock_known=known)
        one = replace(one, next_action=left_action(one))
        for state in ("fault", "interrupted", "not concluded"):
            fault_said(Standing(released=known, said="x"), replace(fault, state=state, left=one), say)
    assert "N·m" in fault_said(Standing(), replace(fault, left=left), say)
    fault_said(Standing(), fault, say)
    assert say.without == []


def test_what_has_changed_and_what_is_due(say: Asked) -> None:
    before = RunFacts("R", "B", (), "B", "B", "B", 1, 0.1, 0.2, 20.0, 21.0, 5.0, 1, 3)
    none = RunFacts("B", "R", ("R",), "R", "R", "R", 3, *[None] * 7)
    for changes in (changes_between(before, none), changes_between(none, before)):
        _parts().since(Since("R", "B", changes), say)
    _parts().since(Since("R", "R"), say)
    for why in ("No run was made yet.", "No run has passed on bench B before.", IN_PROGRESS):
        _parts().since(Since(why_none=why), say)
    today, later = date(2026, 1, 31), date(2026, 3, 1)
    rows = [Due("B", f"{MASTER}R", text) for text in OF_A_MASTER_PART]
    rows += [_due("B", "torque ratio of RV (R)", today, later, one) for one in (today, date(2026, 4, 1))]
    rows += [Due("B", "blank test of the fixture (R)", rows[-1].text), Due("B", "model RV", rows[-1].text)]
    _parts().due(tuple(rows), say)
    _parts().due((), say)
    assert say.without == []


def test_nothing_of_a_master_part_is_left_in_english(say: Asked) -> None:
    for text in OF_A_MASTER_PART:
        refused = f"Master part MP-1 {text}. Measure it before any other unit, or call the technician."
        for said in (say(text), *([] if text.startswith(READ) else [say(refused)])):
            assert not LEFT_ENGLISH.search(said), said
