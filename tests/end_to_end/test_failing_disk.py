"""A disk that fails in the middle of a run: an ext4 on a loop device, shut down as the kernel does after an error."""

from __future__ import annotations

import fcntl
import os
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from lostmotion_command import here
from run_samples import read_back
from test_disks import recording

from station.atomic_file import Appender, write_atomic
from station.errors import RecordError

pytestmark = pytest.mark.wires
EXT4_IOC_SHUTDOWN = 0x8004587D
WITHOUT_JOURNAL = struct.pack("I", 2)
DISK_MB = 64


def mounted(image: Path, place: Path) -> None:
    done = subprocess.run(["mount", "-o", "loop", str(image), str(place)], capture_output=True, text=True, check=False)  # noqa: S607
    if done.returncode:
        pytest.skip(f"a disk of its own cannot be mounted here: {done.stderr.strip()}")


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """An ext4 in a file."""
    path = tmp_path / "disk.img"
    path.touch()
    os.truncate(path, DISK_MB << 20)
    try:
        subprocess.run(["mkfs.ext4", "-q", str(path)], check=True)  # noqa: S607
    except FileNotFoundError:
        pytest.skip("an ext4 cannot be made here: mkfs.ext4 is not installed")
    return path


@pytest.fixture
def disk(image: Path, tmp_path: Path) -> Iterator[Path]:
    place = tmp_path / "disk"
    place.mkdir()
    mounted(image, place)
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)  # noqa: S607


def fail(disk: Path) -> None:
    """Make every read and write of the disk fail with an input/output error from now on, to the next mount."""
    handle = os.open(disk, os.O_RDONLY)
    fcntl.ioctl(handle, EXT4_IOC_SHUTDOWN, WITHOUT_JOURNAL)
    os.close(handle)
    with pytest.raises(OSError, match="Input/output error"):
        (disk / "probe").touch()


def test_a_failing_disk_is_to_be_replaced_and_not_to_be_freed(disk):
    file = Appender(disk / "samples.bin")
    fail(disk)
    for deed in (lambda: write_atomic(disk / "run.json", b"{}"), lambda: file.write(b"record"), file.sync):
        with pytest.raises(RecordError, match=r"cannot be (written|flushed): Input/output error.*replace it"):
            deed()


def test_a_disk_that_fails_stops_the_run_and_what_it_lost_is_told(start, one_ramp, disk, image):
    run = start("run", *one_ramp, "--serial", "D", "--json", data=disk)
    run.wait_for(lambda: recording(disk, period_ms=4))
    (folder,) = (path.parent for path in disk.glob("*/run.json"))
    fail(disk)
    ran = run.finish()
    assert "Traceback" not in ran.err, ran.err
    assert ran.exit_code == 4, ran.err
    said = " ".join(ran.err.split())
    assert "Input/output error" in said
    assert "replace it" in said
    for words in (
        "Input/output error",
        "torque was brought to zero",
        "records wait in memory",
        f"conclude {folder.name}",
    ):
        assert words in ran.err

    subprocess.run(["umount", str(disk)], check=True)  # noqa: S607
    mounted(image, disk)
    assert here("conclude", folder.name, "--data", str(disk)).exit_code == 0
    done = here("show", folder.name, "--data", str(disk), "--json")
    assert done.exit_code == 0, done.err
    shown = done.json
    assert (shown["state"], shown["verdict"]) == ("stopped", "NOT DECIDABLE")
    assert any("because records could not be written to disk, stopped the run" in one for one in shown["reasons"])
    # what the supervisor had written, but the disk had not yet taken for good, is lost as in a power cut: one gap,
    # and told
    gaps = read_back(folder).problems
    assert len(gaps) <= 1
    assert all("the sequence has a gap" in gap for gap in gaps)
