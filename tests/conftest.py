"""Runs in virtual time that several test files look at: made once, by whichever worker needs one first."""

from __future__ import annotations

import fcntl
import gc
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import pytest
from hypothesis import settings
from lostmotion_command import ROOT, Ran, here
from shipped_copies import at_4_ms

pytest_plugins = ("command_fixtures",)

os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""Before numpy is loaded: on small matrices a second thread only waits, and doubles the processor time of the fits."""

os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(ROOT / "tests" / "without_pandas"), *filter(None, [os.environ.get("PYTHONPATH")])]
)
"""The processes that tests start have no pandas either: see there."""

settings.register_profile("tests", deadline=None)
settings.load_profile("tests")
"""How long an example takes says how busy the machine is, and nothing of what the test is about."""

IN_MEMORY = Path("/dev/shm")  # noqa: S108 - the folders below it are pytest's own
ROOM_BYTES = 4 << 30
if IN_MEMORY.is_dir() and os.access(IN_MEMORY, os.W_OK) and shutil.disk_usage(IN_MEMORY).free > ROOM_BYTES:
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(IN_MEMORY))
"""Runs of tests are flushed some ten thousand times: what a busy disk takes for that is not what they are about.

What disks do wrong is tested on disks of their own (`end_to_end/test_disks.py`, `test_failing_disk.py`).
"""

if "LOSTMOTION_STATE" not in os.environ:
    os.environ["LOSTMOTION_STATE"] = tempfile.mkdtemp(
        prefix="lostmotion-state-", dir=os.environ.get("PYTEST_DEBUG_TEMPROOT")
    )
    MADE_HERE: Path | None = Path(os.environ["LOSTMOTION_STATE"])
else:
    MADE_HERE = None
"""Keys and heads of chains, of the tests and not of whoever runs them; workers share the folder of their parent."""

STATE = {"LOSTMOTION_STATE": os.environ["LOSTMOTION_STATE"]}
"""Runs that several files look at are signed by this key, also where the first test that asks has one of its own."""


gc.disable()  # until all tests are loaded: what comes stays, and to search it again and again is a fifth of that time


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Spread the files on wires among the others: they wait for half of their time, and side by side all would wait."""
    files: dict[Path, bool] = {}
    for item in items:
        files[item.path] = files.get(item.path, False) or item.get_closest_marker("wires") is not None
    place: dict[Path, float] = {}
    for waits in (True, False):
        alike = [path for path, one in files.items() if one is waits]
        place |= {path: (number + 0.5) / len(alike) for number, path in enumerate(alike)}
    items.sort(key=lambda item: place[item.path])  # all of a file stay together


def pytest_collection_finish() -> None:
    """Leave what is loaded out of every later collection of garbage, here and in the processes that tests fork."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)  # a fortieth of the processor's time, otherwise


@pytest.hookimpl(tryfirst=True)  # a worker's own loop is asked before others, and then no other is
def pytest_runtestloop() -> None:
    """Search for garbage again, in workers and in the process that hands the tests out."""
    gc.enable()


def pytest_sessionfinish() -> None:
    if MADE_HERE is not None:
        shutil.rmtree(MADE_HERE, ignore_errors=True)


@pytest.fixture(scope="module", autouse=True)
def surroundings() -> Iterator[None]:
    """Hold every file to leave the environment and the working folder to the next ones as they were."""
    before, folder = {**os.environ}, Path.cwd()
    yield
    after = {**os.environ}
    left = {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}
    assert (left - {"PYTEST_CURRENT_TEST"}, Path.cwd()) == (set(), folder)


TOO_SHORT = {"rv-40e-121-faults"}
"""Shipped recipes that load so fast that a bin of the loop has too few samples at 4 ms."""


@dataclass(frozen=True)
class Stored:
    """A run that is there to be copied and never to be written to: its data folder, and what the command printed."""

    data: Path
    ran: Ran

    @property
    def record(self) -> Path:
        return self.ran.record

    def copy(self, folder: Path) -> Path:
        """Copy the data folder with its index; return the record in the copy."""
        return Path(shutil.copytree(self.data, folder)) / self.record.name


@pytest.fixture(scope="session")
def stored_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Stored]:
    """Run `lostmotion run ARGS` in virtual time into a folder of that name, unless another worker has done so."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def make(name: str, *args: str) -> Stored:
        data, said = shared / f"{name}-runs", shared / f"{name}.json"
        with (shared / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not said.exists():
                with mock.patch.dict(os.environ, STATE):
                    ran = here("run", *args, "--virtual-time", "--json", "--data", str(data))
                said.write_text(json.dumps([ran.exit_code, ran.out, ran.err]), encoding="utf-8")
        return Stored(data, Ran(*json.loads(said.read_text(encoding="utf-8"))))

    return make


@pytest.fixture(scope="session")
def quarter(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    """Return the path of a shipped recipe at 4 ms, by its name; as shipped where that leaves too few samples."""
    folder = tmp_path_factory.mktemp("recipes")

    def recipe(name: str) -> str:
        return name if name in TOO_SHORT else at_4_ms(folder, name)

    return recipe


@pytest.fixture(scope="session")
def quick_run(stored_once: Callable[..., Stored], quarter: Callable[[str], str]) -> Stored:
    """The shipped quick recipe, at 4 ms, with a good unit: PASS."""
    recipe = quarter("rv-40e-121-quick")
    stored = stored_once("quick", recipe, "--serial", "SN 1", "--operator", "A. Tester", "--report")
    assert stored.ran.exit_code == 0, stored.ran
    return stored


@pytest.fixture(scope="session")
def shipped_run(
    stored_once: Callable[..., Stored], quarter: Callable[[str], str], quick_run: Stored
) -> Callable[[str], Stored]:
    """Run a shipped recipe, by its name and at 4 ms, with the unit and the bench that it is for."""
    made = {"rv-40e-121-quick": quick_run}

    def run(name: str) -> Stored:
        return made.get(name) or stored_once(f"shipped-{name}", quarter(name), "--serial", "SN 1", "--no-report")

    return run


@pytest.fixture(scope="session")
def as_shipped_run(stored_once: Callable[..., Stored]) -> Stored:
    """The shipped quick recipe as it is, with a good unit."""
    return stored_once("as-shipped", "rv-40e-121-quick", "--serial", "SN 1", "--no-report")


@pytest.fixture(scope="session")
def worn_run(stored_once: Callable[..., Stored], quarter: Callable[[str], str]) -> Stored:
    """The shipped quick recipe, at 4 ms, with a worn unit: FAIL."""
    return stored_once("worn", quarter("rv-40e-121-quick"), "--unit", "worn", "--serial", "W1")


@pytest.fixture(scope="session")
def golden_run(stored_once: Callable[..., Stored]) -> Stored:
    """The short recipe of the golden runs: nothing to decide by."""
    return stored_once("golden", str(ROOT / "tests" / "proofs" / "golden" / "golden.yaml"), "--serial", "R")
