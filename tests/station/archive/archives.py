"""An archive for tests: a data folder with runs, its settings, and S3 on loopback."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from station.archive.place import Place
from station.archive.settings import load_settings


def data_with_archive(folder: Path, tmp_path: Path, url: str = "") -> tuple[Path, Place]:
    """Copy a data folder, and give it an archive of its own."""
    data = Path(shutil.copytree(folder, tmp_path / "runs"))
    (data / "archive.yaml").write_text(f"url: {url or tmp_path / 'archive'}\n", encoding="utf-8")
    return data, Place(load_settings(data))


def killed(work: Callable[[], object]) -> None:
    """Do work in a process of its own that must end itself by SIGKILL."""
    child = os.fork()
    if not child:
        work()
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status), "the work ended before it was killed"


def kill_at(monkeypatch: pytest.MonkeyPatch, owner: object, name: str, *, before: bool) -> None:
    """Let a process end itself before or after it does something."""
    real = getattr(owner, name)

    def deed(*args: object, **kwargs: object) -> object:
        if before:
            os.kill(os.getpid(), signal.SIGKILL)
        real(*args, **kwargs)
        os.kill(os.getpid(), signal.SIGKILL)
        return None

    monkeypatch.setattr(owner, name, deed)
