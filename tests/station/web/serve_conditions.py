"""Serves a station whose start conditions fail as a file says: one of the cases of the tests of start permission.

`python serve_conditions.py DATA`: the file `chosen` in the data folder names the condition that fails.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
from test_start_permission import cases

from station.web.actions import runs
from station.web.models import load_models
from station.web.permission import Situation, Wanted, situation_of
from station.web.server import Served, serve

CHOSEN = "chosen"


def main(data: Path) -> None:
    wanted = Wanted("SN-1")
    good = situation_of(data, load_models(data, None), wanted, busy=False, confirmed=frozenset())
    found = cases(good, pytest.MonkeyPatch())

    def situation(*_: Any, **__: Any) -> Situation:
        return found[(data / CHOSEN).read_text(encoding="utf-8")]

    runs.situation_of = situation
    serve(Served(data, "127.0.0.1", 0, run_options=("--pace", "fast")))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
