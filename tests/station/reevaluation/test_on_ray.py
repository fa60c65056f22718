"""The same evaluation on a Ray cluster of this computer: the same ledger. Where Ray is not installed it is left out."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from recipes import Selection
from station.archive.place import Place
from station.archive.push import push
from station.archive.settings import load_settings
from station.records.data_folder import Store
from station.reevaluation.jobs import Where
from station.reevaluation.ledger import FOLDER
from station.reevaluation.question import Question
from station.reevaluation.run_question import Means, ask_of_runs

# Not by importing it: Ray reads how it asks for tokens when it is loaded, and the command says that before.
if find_spec("ray") is None:
    pytest.skip("Ray is not installed: pip install 'lostmotion[cluster]'", allow_module_level=True)


def test_a_cluster_evaluates_as_this_computer_does(
    golden_run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = golden_run.copy(tmp_path / "runs").parent
    (data / "archive.yaml").write_text(f"url: {tmp_path / 'archive'}\n", encoding="utf-8")
    archive = load_settings(data)
    push(data, Place(archive))
    shutil.rmtree(Store(data).find("last").folder)
    question = Question(selection=Selection(None, ("torque_ratio_slope",)))
    here = ask_of_runs(data, question, Where(), Means(1, archive, from_archive=True))
    assert (here.evaluated, here.failed) == (1, {})
    shutil.rmtree(data / FOLDER)
    monkeypatch.setenv("RAY_AUTH_TOKEN", "0123456789abcdef" * 4)
    there = ask_of_runs(data, question, Where(), Means(1, archive, cluster="local"))
    assert (there.evaluated, there.failed, there.digest) == (1, {}, here.digest)
