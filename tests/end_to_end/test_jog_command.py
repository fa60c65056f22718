"""A jog by the command, on the virtual bench over its wires: it turns while a key is held and the device is pressed.

Keys come as lines, as the station says them. What the shaft did is read from the record.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from lostmotion_command import ROOT, here
from run_samples import records_of

from definitions.image import State
from definitions.jog import JogPhase
from recipes import shipped_recipes
from station.bench.request import load_job
from station.errors import StationError
from station.opcua.bench_view import BenchView
from station.opcua.projection import NOTHING_KNOWN, PROJECTION
from station.records.data_folder import Store
from station.run.jog.jogs import jog_is_on, jog_job, jogs, program_of, why_no_jog

pytestmark = [pytest.mark.wires, pytest.mark.long]

LONGEST_S = 180.0
RECIPE = "rv-40e-121-quick"


class Jogging:
    """The command, with somebody at its keys."""

    def __init__(self, data: Path) -> None:
        words = [sys.executable, "-m", "station", "jog", RECIPE, "--by-lines", "--operator", "Ada", "--data", str(data)]
        self.data = data
        self.process = subprocess.Popen(
            words, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )

    def say(self, *words: str) -> None:
        self.process.stdin.write("".join(f"{one}\n" for one in words).encode())
        self.process.stdin.flush()

    def phase(self) -> int:
        """Return the phase in the newest record, 0 before there is one."""
        for described in self.data.glob("jogs/*/run.json"):
            table = records_of(described.parent)
            if len(table) and table["orders"]["state"][-1] == State.JOG:
                return int(table["orders"]["phase"][-1])
        return 0

    def until(self, reached: Callable[[int], bool], key: str = "", *, late_s: float = 0.0) -> None:
        """Hold a key, if any, until a phase is reached; late_s: by how much each token is too old."""
        ends = time.monotonic() + LONGEST_S
        looked = 0.0
        while True:
            if key:
                self.say(f"{key} {time.monotonic_ns() - round(late_s * 1e9)}")
            if time.monotonic() - looked > 0.3:
                looked = time.monotonic()
                if reached(self.phase()):
                    return
            assert time.monotonic() < ends, self.phase()
            assert self.process.poll() is None, self.process.stdout.read()
            time.sleep(0.05)

    def turn(self, key: str) -> None:
        """Hold the key, then press the enabling device, again where a busy machine has lost the key in between."""
        ends = time.monotonic() + LONGEST_S
        while self.phase() != JogPhase.TURNING:
            self.say("let-go")
            self.until(lambda phase: phase in (JogPhase.PRESS_DEVICE, JogPhase.TURNING), key)
            self.say("press")
            self.until(lambda phase: phase not in (JogPhase.PRESS_DEVICE, JogPhase.ENABLING), key)
            assert time.monotonic() < ends


@pytest.fixture
def jogging(tmp_path: Path) -> Iterator[Jogging]:
    found = Jogging(tmp_path / "runs")
    yield found
    if found.process.poll() is None:
        found.process.kill()
    found.process.wait()


def test_opc_ua_shows_the_jog_while_it_is_on(jogging: Jogging) -> None:
    view, ends = BenchView(jogging.data), time.monotonic() + LONGEST_S
    while (seen := view.look()).states != PROJECTION[State.JOG]:
        assert time.monotonic() < ends, seen
        assert jogging.process.poll() is None, jogging.process.stdout.read()
        time.sleep(0.05)
    (record,) = jogs(jogging.data).newest(9)
    assert (seen.texts["State"], seen.texts["Run"], seen.texts["SerialNumber"]) == ("jog", record.id, "")
    assert seen.values["angle_in_rad"][0] is not None
    jogging.say("end")
    assert jogging.process.wait(LONGEST_S) == 0
    while view.look().states != NOTHING_KNOWN:  # no run was ever made in this folder
        assert time.monotonic() < ends
        time.sleep(0.05)


def stands(phase: int) -> bool:
    return phase in (JogPhase.RELEASE_DEVICE, JogPhase.HOLD_KEY)


def test_it_turns_each_way_while_the_key_is_held_and_stops_without_it(jogging: Jogging) -> None:
    for key in ("+", "-"):
        jogging.turn(key)
        time.sleep(0.5)
        jogging.until(stands)  # the key is let go, the enabling device is not
    jogging.until(stands, "+", late_s=5.0)
    assert stands(jogging.phase()), "a key that was long on its way is none"
    assert jog_is_on(jogging.data)
    assert "in progress" in why_no_jog(jogging.data, load_job(RECIPE, None))
    refused = here("backup", str(jogging.data.parent / "b.tar"), "--data", str(jogging.data))
    assert (refused.exit_code, "End it" in refused.err) == (2, True)
    jogging.say("end")
    assert jogging.process.wait(LONGEST_S) == 0
    assert not jog_is_on(jogging.data)
    (record,) = jogs(jogging.data).newest(9)
    table = records_of(record.folder)
    turning = table["orders"]["phase"] == JogPhase.TURNING
    program = program_of(record)
    speed = table["image"]["drive_velocity_rad_s"][turning]
    assert speed.max() > 0.2 * program.jog.speed_rad_s
    assert speed.min() < -0.2 * program.jog.speed_rad_s
    assert table["image"]["enabling_device"][turning].any()
    assert set(table["image"]["command"].tolist()) >= {0, 6, 7}
    manifest = record.manifest()
    assert (manifest.state, manifest.operator, manifest.verdict) == ("stopped", "Ada", "NOT DECIDABLE")
    checked = here("verify", "--data", str(jogging.data), "--json")
    assert checked.exit_code == 0, checked.out
    assert checked.json["jogs"]["runs"] == 1
    replayed = here("replay", record.id, "--data", str(jogging.data), "--json")
    assert (replayed.exit_code, replayed.json["identical_scans"]) == (0, len(table)), replayed.out + replayed.err
    assert (replayed.json["program_differs"], replayed.json["events_differ"]) == ([], [])
    asked = here("replay", str(record.folder), "--recipe", RECIPE, "--data", str(jogging.data))
    assert (asked.exit_code, "is a jog" in asked.err) == (2, True)
    kept = here("backup", str(jogging.data.parent / "b.tar"), "--data", str(jogging.data), "--json")
    assert (kept.exit_code, kept.json["jogs"]) == (0, 1), kept.out + kept.err
    (record.folder / "samples.bin" if (record.folder / "samples.bin").exists() else record.samples).write_bytes(b"")
    assert here("verify", "--data", str(jogging.data)).exit_code == 1, "a changed record of a jog is told"
    assert Store(jogging.data).runs() == [], "a jog is no run"


@pytest.mark.parametrize("how", ["the input ends", "the supervisor is killed"])
def test_a_shaft_that_turns_stands_still_when_nobody_is_there_any_more(jogging: Jogging, how: str) -> None:
    jogging.turn("+")
    if how == "the input ends":
        jogging.process.stdin.close()
        assert jogging.process.wait(LONGEST_S) == 0
    else:
        scan = json.loads(next(jogging.data.glob("jogs/*/scan-report.json")).read_bytes())["pid"]
        os.kill(jogging.process.pid, signal.SIGKILL)
        ends = time.monotonic() + LONGEST_S
        while Path(f"/proc/{scan}").exists() and " Z " not in Path(f"/proc/{scan}/stat").read_text():
            assert time.monotonic() < ends, "the scan goes on without its supervisor"
            time.sleep(0.1)
        assert not jog_is_on(jogging.data)
    if how == "the input ends":
        (record,) = jogs(jogging.data).newest(9)
        table = records_of(record.folder)
        assert table["orders"]["state"][-1] == State.STOPPED
        assert abs(table["image"]["drive_velocity_rad_s"][-1]) < 0.1


def test_a_bench_without_an_enabling_device_has_no_jog(tmp_path: Path) -> None:
    bench, profiles = tmp_path / "bench.yaml", tmp_path / "profiles"
    write_bench_without(bench, profiles)
    with pytest.raises(StationError, match="has no enabling device"):
        jog_job(load_job(str(shipped_recipes()[RECIPE]), str(bench)), 1.0)
    with pytest.raises(StationError, match="--speed"):
        jog_job(load_job(RECIPE, None), 1.5)
    refused = here("jog", RECIPE, "--data", str(tmp_path / "runs"))
    assert (refused.exit_code, "no terminal" in refused.err) == (2, True)


def write_bench_without(bench: Path, profiles: Path) -> None:
    """Write the shipped bench with a remote I/O that no enabling device is wired to."""
    source = load_job(RECIPE, None)
    bench.write_bytes(source.bench_source.content)
    profiles.mkdir()
    name = source.bench.remote_io.profile
    lines = source.profile_sources[name].content.decode().splitlines()
    kept = [line for line in lines if "enabling_device" not in line]
    (profiles / f"{name}.yaml").write_text("\n".join(kept) + "\n", encoding="utf-8")
