"""Compiles the virtual bench's physics for whoever cannot wait for it."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[3]))

from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import load_job
from virtual_bench.physics.plant import warm_up

job = load_job("rv-40e-121-quick", None)
warm_up(virtual_config(job.bench, job.profile_paths, choose_unit("P1", job.recipe)))
