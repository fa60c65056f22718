"""A data folder that vanishes under a running scan: a controlled stop at once, and no ring that stays for good."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from lostmotion_command import here
from run_samples import read_back
from test_disks import recording

from station.records.ring.reader import RingReader

pytestmark = pytest.mark.wires
STOPPED_WITHIN_SCANS = 2000
"""Eight seconds of the bench: bringing the torque to zero takes two, and a busy supervisor its time to notice."""


def deleted(data: Path) -> None:
    shutil.rmtree(data)


def moved(data: Path) -> None:
    data.rename(data.with_name("moved"))


@pytest.mark.parametrize("vanish", [deleted, moved])
def test_a_run_whose_data_folder_vanishes_is_stopped_at_once(
    start, one_ramp, tmp_path: Path, vanish: Callable[[Path], None]
) -> None:
    data = tmp_path / "runs"
    run = start("run", *one_ramp, "--serial", "V", "--json", data=data)
    run.wait_for(lambda: recording(data, period_ms=4))
    (manifest,) = data.glob("*/run.json")
    ring = Path(json.loads(manifest.read_bytes())["ring"])
    reader = RingReader(ring)
    before = reader.written
    vanish(data)
    ran = run.finish()
    assert 0 < reader.written - before < STOPPED_WITHIN_SCANS
    reader.close()
    assert ran.exit_code == 4, ran.err
    assert "stopping: the torque is brought to zero first" in ran.err
    assert "was deleted, moved or replaced while the program was writing it" in ran.err
    assert "the torque was brought to zero and the lock opened" in ran.err
    assert "Traceback" not in ran.err
    assert ring.exists(), "the folder may be put back"
    if vanish is deleted:
        ring.unlink()
        return
    back = tmp_path / "moved"
    assert here("conclude", "--all", "--data", str(back)).exit_code == 0
    shown = here("show", "last", "--data", str(back), "--json").json
    assert (shown["state"], shown["stopped_by"]) == ("stopped", "disk")
    assert read_back(back / manifest.parent.name, shown["timing"]["scans"]).problems == ()
    assert not ring.exists()
