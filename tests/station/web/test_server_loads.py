"""The server loads what its pages need, and nothing of what its other processes do: buses, physics, fits, drawing."""

from __future__ import annotations

import json
import subprocess
import sys

from lostmotion_command import ROOT

NOT_NEEDED = frozenset(
    {"canopen", "can", "pymodbus", "serial", "cantools", "durand", "numba", "llvmlite", "matplotlib", "reportlab",
     "nptdms", "pyarrow", "httpx", "scipy.integrate", "scipy.optimize", "scipy.special", "station.scan.scan_process",
     "station.run.supervisor", "virtual_bench.server"}
)  # fmt: skip
LOOK = "import json, sys, station.web.server; print(json.dumps(sorted(sys.modules)))"


def test_the_server_loads_no_bus_no_physics_and_nothing_that_draws() -> None:
    ran = subprocess.run([sys.executable, "-c", LOOK], cwd=ROOT, capture_output=True, text=True, check=True)
    assert NOT_NEEDED & set(json.loads(ran.stdout)) == set()
