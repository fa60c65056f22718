"""Exits of a jog: the shaft turns by a held key and the enabling device, with the lock open."""

from __future__ import annotations

from definitions.image import Command
from definitions.jog import TOKEN_EVERY_S, JogPhase
from faultlab.exits.elsewhere import from_alarm
from faultlab.exits.judge import Measured
from faultlab.exits.rows import Exit
from faultlab.exits.shown import Shown
from faultlab.matrix.matrix import job
from faultlab.run import Bench
from recipes.compiler.jog import compile_jog, jog_bench, jog_section, jog_speed_rad_s
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.virtual_unit import FIXED_SEED
from virtual_bench.faults.scenario import Fault as Injected
from virtual_bench.faults.scenario import Header, Scenario, When

PRESSED_AT_S = 0.5
TURNING_S = 1.0


def _turning(name: str) -> Bench:
    """Return a jog in full turn: the key held, the enabling device pressed and never let go."""
    work = job()
    config = virtual_config(jog_bench(work.bench), work.profile_paths, choose_unit(None, work.recipe, FIXED_SEED))
    pressed = Injected(target="io.enabling_device", verb="press", when=When(time_s=PRESSED_AT_S))
    scenario = Scenario(scenario=Header(name=name), faults=(pressed,))
    bench = Bench(compile_jog(work.bench, jog_speed_rad_s(work.bench)), config, scenario)
    _hold(bench, PRESSED_AT_S + TURNING_S)
    if bench.run.orders[-1].phase != JogPhase.TURNING:
        raise RuntimeError(
            f"the jog of {name} does not turn the shaft: {JogPhase(bench.run.orders[-1].phase).name.lower()}"
        )
    return bench


def _hold(bench: Bench, seconds: float) -> None:
    """Hold the key for so long, or until the run has ended."""
    every = round(TOKEN_EVERY_S / bench.run.period_s)
    for scan in range(round(seconds / bench.run.period_s)):
        if scan % every == 0:
            bench.order(Command.JOG_POSITIVE)
        bench.go()
        if bench.controller.finished:
            return


def enabling_device_stuck(row: Exit) -> Measured | None:
    """The contact of the enabling device stays closed for longer than a hand presses it."""
    bench = _turning(row.id)
    _hold(bench, jog_section(job().bench).longest_press_s)
    return from_alarm(row, bench.finish(), "io.enabling_device press, never let go")


def jog_not_stopped(row: Exit) -> Measured | None:
    """The key is let go, and the shaft is seen to turn on."""
    bench = _turning(row.id)
    turning = {"drive_velocity_rad_s": bench.run.images[-1].drive_velocity_rad_s}
    bench.bench = Shown(bench.bench, turning)  # type: ignore[assignment]
    return from_alarm(row, bench.finish(), "speed of the drive stays after the key is let go")
