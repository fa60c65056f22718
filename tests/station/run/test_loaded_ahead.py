"""What an evaluation needs is loaded while the bench starts, and not between the end of the motion and the verdict."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
from pathlib import Path

from lostmotion_command import ROOT

from station.own_program import loading
from station.results.evaluation import LOADED_AHEAD

CODE = """
import json, sys
from pathlib import Path
from station.records.run_record import RunRecord
from station.results.run_analysis import complete_run
from station.results.evaluation import load_ahead
load_ahead()
before = set(sys.modules)
complete_run(RunRecord(Path(sys.argv[1])))
print(json.dumps(sorted({name.split(".")[0] for name in set(sys.modules) - before})))
"""


def test_an_evaluation_loads_nothing_large(golden_run) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(Path(golden_run.record))], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert LOADED_AHEAD
    assert not {"scipy", "pyarrow", "numpy", "pandas"} & set(json.loads(done.stdout))


def test_what_is_loaded_is_never_searched_for_what_is_over() -> None:
    before = gc.get_freeze_count()
    with loading():
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() > before
    gc.unfreeze()
