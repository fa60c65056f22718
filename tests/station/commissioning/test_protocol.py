"""The steps of commissioning: their order, what makes one due again, and what a run asks of them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from made_documents import result

from definitions.commissioning import CHANGED, NOT_COMMISSIONED, STEP_BY_ID, STEPS, UNFINISHED, concerns
from recipes import Bench
from station.bench.commissioned import protocol_path, read_protocol, standings
from station.bench.request import DRIVER_PROFILES, load_job
from station.bench.virtual_unit import NOT_NAMED
from station.cli.measure.jog import jog
from station.commissioning.on_wires import OnWires, on_wires
from station.commissioning.steps_done import how_it_stands, may_begin, write_down
from station.documents.commissioning import Figure, Finding
from station.errors import RecordError, StationError
from station.reports.headline import manifest_badges
from station.reports.result_notes import note_lines
from station.run.jog.jogs import jog_job, why_no_jog
from station.run.new_record import Wanted, new_record
from station.store.retention import class_of
from station.web.actions.jog import begin_jog
from station.web.actions.row import Call, NotNowError
from station.web.actions.values import NewJog

WRONG = Finding(what="The contact is inverted.", cure="Use the other contact.")


@pytest.fixture
def bench_file(tmp_path: Path) -> Path:
    """A bench on its own wires, with its profiles beside it; nothing is opened."""
    for name in ("virtual-drive", "virtual-amplifier", "virtual-remote-io"):
        content = (DRIVER_PROFILES / f"{name}.yaml").read_text(encoding="utf-8")
        (tmp_path / f"{name}.yaml").write_text(content, encoding="utf-8")
    text = load_job("rv-40e-121-quick", "virtual").bench_source.content.decode()
    path = tmp_path / "mine.yaml"
    path.write_text(text.replace("embedded: true", "embedded: false"), encoding="utf-8")
    return path


def change(path: Path, before: str, after: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after, 1), encoding="utf-8")


def pass_all(bench: OnWires) -> None:
    for step in STEPS:
        may_begin(bench, step.id)
        write_down(bench, step.id, "A. Technician", (), (Figure(name="lag", value=1.5, unit="ms"),))


def states(path: Path) -> dict[str, str]:
    return {one.step.id: one.state for one in how_it_stands(on_wires(str(path)))}


def test_every_section_of_a_bench_file_is_of_some_step_or_says_why_not(bench_file: Path) -> None:
    parts = on_wires(str(bench_file)).parts
    for section in Bench.model_fields:
        entries = [part for part in parts if part == section or part.startswith((f"{section}.", f"{section}["))]
        missing = [part for part in entries if not any(concerns(step, part) for step in STEPS)]
        assert not missing or section in NOT_COMMISSIONED, missing
    assert set(NOT_COMMISSIONED) <= set(Bench.model_fields)
    for step in STEPS:
        assert any(concerns(step, part) for part in parts), step.id


def test_a_step_is_refused_until_those_before_it_have_passed(bench_file: Path) -> None:
    bench = on_wires(str(bench_file))
    for step in STEPS[1:]:
        with pytest.raises(StationError, match=f"Next: lostmotion bench probe --bench {bench_file}"):
            may_begin(bench, step.id)
    write_down(bench, "probe", None, (), ())
    may_begin(bench, "registers")
    write_down(bench, "registers", None, (WRONG,), ())
    with pytest.raises(StationError, match=r"registers \(not passed\)"):
        may_begin(bench, "io")
    assert states(bench_file)["registers"] == "not passed"
    write_down(bench, "registers", None, (Finding(what="Odd.", cure="None.", refuses=False),), ())
    may_begin(bench, "io")


def test_a_protocol_keeps_every_attempt_with_who_when_and_by_which_file(bench_file: Path) -> None:
    bench = on_wires(str(bench_file))
    write_down(bench, "probe", "A", (WRONG,), ())
    pass_all(bench)
    protocol = read_protocol(bench_file, bench.bench)
    assert protocol_path(bench_file).parent == bench_file.parent
    assert [done.step for done in protocol.steps] == ["probe", *(step.id for step in STEPS)]
    first = protocol.steps[0]
    assert (first.passed, first.by, first.bench_sha256) == (False, "A", bench.source.sha256)
    assert protocol.steps[1].figures[0] == Figure(name="lag", value=1.5, unit="ms")
    assert set(states(bench_file).values()) == {"passed"}


GUARD_BIT = "name: guard_closed, offset: 1, type: u16, bit: "
CHANGES = {
    "address": ("mine.yaml", "port: 1504", "port: 1505", {"probe", "io", "timing"}),
    "gain": ("mine.yaml", "gain: 15", "gain: 20", {"tune"}),
    "time-out": (
        "mine.yaml",
        "setpoint_timeout: 50 ms",
        "setpoint_timeout: 60 ms",
        {"probe", "direction", "latency", "watchdogs", "tune"},
    ),
    "contact": ("virtual-remote-io.yaml", GUARD_BIT + "1", GUARD_BIT + "3", {"probe", "io"}),
    "sign": (
        "virtual-amplifier.yaml",
        "scale: 1.0e-6",
        "scale: -1.0e-6",
        {"probe", "registers", "direction", "latency", "tune"},
    ),
    "statement": ("virtual-drive.yaml", "tried_on_hardware: true", "tried_on_hardware: false", set()),
    "comment": ("mine.yaml", "# whose heartbeat the drive consumes", "# a comment", set()),
    "unit": ("mine.yaml", "calibrations: []", "calibrations: []\nmaster_parts: [{serial: M1, expect: PASS}]", set()),
}


@pytest.mark.parametrize(("file", "before", "after", "due"), CHANGES.values(), ids=CHANGES)
def test_what_has_changed_makes_the_steps_that_depend_on_it_due_and_those_behind(
    bench_file: Path, file: str, before: str, after: str, due: set[str]
) -> None:
    pass_all(on_wires(str(bench_file)))
    change(bench_file.parent / file, before, after)
    stands = how_it_stands(on_wires(str(bench_file)))
    assert {one.step.id for one in stands if one.changes} == due
    for one in stands:
        for entry in one.changes:
            assert entry.was != entry.now
    first = next((place for place, one in enumerate(stands) if one.step.id in due), len(stands))
    assert {one.state for one in stands[:first]} <= {"passed"}
    assert {one.state for one in stands[first:]} <= {"due again"}


def test_a_damaged_protocol_is_told_and_never_taken_for_none(bench_file: Path) -> None:
    protocol_path(bench_file).write_text("{}", encoding="utf-8")
    with pytest.raises(RecordError, match="bench: is missing"):
        how_it_stands(on_wires(str(bench_file)))


def test_an_embedded_bench_has_nothing_to_commission() -> None:
    with pytest.raises(StationError, match="only during a run"):
        on_wires("virtual")


@pytest.fixture
def real_bench(bench_file: Path) -> Path:
    """The same with a drive that is not the virtual one."""
    change(bench_file.parent / "virtual-drive.yaml", "vendor_id: 0x4C4D0001", "vendor_id: 0x000000FB")
    return bench_file


def test_no_run_starts_by_itself_on_a_real_drive_whose_watchdogs_nobody_has_measured(real_bench: Path) -> None:
    def why() -> str:
        return load_job("rv-40e-121-quick", str(real_bench)).no_automatic_run

    assert "not measured on this bench" in why()
    bench = on_wires(str(real_bench))
    write_down(bench, "watchdogs", None, (WRONG,), ())
    assert why(), "it was measured, and has not passed"
    write_down(bench, "watchdogs", None, (), ())
    assert not why()
    change(real_bench, "abort_connection_option: 3", "abort_connection_option: 2")
    assert why(), "another reaction was measured"


def test_no_jog_begins_on_a_real_drive_whose_watchdogs_nobody_has_measured(real_bench: Path, tmp_path: Path) -> None:
    data = tmp_path / "runs"
    data.mkdir()

    def why() -> str:
        return why_no_jog(data, jog_job(load_job("rv-40e-121-quick", str(real_bench)), 1.0))

    assert why() == f"{load_job('rv-40e-121-quick', str(real_bench)).no_automatic_run}."
    with pytest.raises(StationError, match="not measured on this bench"):
        jog("rv-40e-121-quick", str(real_bench), data, speed=1.0, operator=None, unit=None, by_lines=True)
    model = SimpleNamespace(model="M", recipe="rv-40e-121-quick", bench=str(real_bench), unit="")
    station = SimpleNamespace(
        data=data,
        models=SimpleNamespace(models=[model]),
        running=SimpleNamespace(busy=lambda: False),
        jogging=SimpleNamespace(standing=lambda: SimpleNamespace(on=False), start=lambda *_: pytest.fail("it began")),
    )
    with pytest.raises(NotNowError, match="not measured on this bench"):
        begin_jog(cast("Call", SimpleNamespace(station=station)), NewJog(model="M", speed=1.0))
    write_down(on_wires(str(real_bench)), "watchdogs", None, (), ())
    assert not why(), "measured with the speed and torque of the bench file, which are not those of a jog"
    change(real_bench, "abort_connection_option: 3", "abort_connection_option: 2")
    assert why(), "another reaction was measured"


def test_a_virtual_drive_needs_no_proof(bench_file: Path) -> None:
    assert not load_job("rv-40e-121-quick", str(bench_file)).no_automatic_run
    assert not load_job("rv-40e-121-quick", "virtual").no_automatic_run


@pytest.mark.parametrize(("name", "told"), [("bench_file", True), ("real_bench", False)])
def test_a_run_on_the_virtual_drive_is_of_a_virtual_unit_whoever_started_its_bench(
    request: pytest.FixtureRequest, tmp_path: Path, name: str, *, told: bool
) -> None:
    """A virtual bench that was started by itself passed as a real one, and its units as the production."""
    job = load_job("rv-40e-121-quick", str(request.getfixturevalue(name)))
    record = new_record(tmp_path / "runs", job, Wanted("REAL1", None, None, None, clock="wall"), notes=[])
    record.lock.close()
    manifest = record.manifest()
    assert manifest.unit.virtual == (NOT_NAMED if told else None)
    assert bool(manifest_badges(manifest)) is told
    assert class_of(manifest) == ("virtual" if told else "product")


def test_a_step_that_nobody_has_done_stands_so() -> None:
    stands = standings(read_protocol(Path("none-there.yaml"), load_job("rv-40e-121-quick", "virtual").bench), {})
    assert [one.state for one in stands] == ["to do"] * len(STEP_BY_ID)


def notes_of(path: Path) -> tuple[str, ...]:
    return load_job("rv-40e-121-quick", str(path)).drive_notes


def test_a_result_names_what_has_changed_since_the_bench_was_commissioned(bench_file: Path) -> None:
    """By the protocol alone: a bench that never had one is not told of here, and a virtual drive is no exception."""
    never = notes_of(bench_file)
    assert not any(one.startswith((CHANGED, UNFINISHED)) for one in never)
    pass_all(on_wires(str(bench_file)))
    assert not any(one.startswith((CHANGED, UNFINISHED)) for one in notes_of(bench_file))
    change(bench_file, "gain: 15", "gain: 25")
    assert notes_of(bench_file)[-1] == (
        f"{CHANGED}: torque_control.gain_per_s 15.0 → 25.0. Steps due: tune, timing. Run: lostmotion bench status"
    )
    change(bench_file, "timeout: 5 ms", "timeout: 8 ms")
    change(bench_file.with_name("virtual-amplifier.yaml"), "scale: 1.0e-6", "scale: -1.0e-6")
    change(bench_file.with_name("virtual-amplifier.yaml"), "scale: 1.0e-4", "scale: -1.0e-4")
    assert "and 1 more. Steps due: probe, registers, io, " in notes_of(bench_file)[-1]


def test_a_result_says_that_a_bench_was_not_commissioned_to_the_end(bench_file: Path) -> None:
    bench = on_wires(str(bench_file))
    for step in STEPS[:-2]:
        write_down(bench, step.id, None, (), ())
    said = notes_of(bench_file)[-1]
    assert said == f"{UNFINISHED}. Steps due: tune, timing. Run: lostmotion bench status"
    shown = note_lines(result(notes=(said, "another")))
    assert shown[0] == said
