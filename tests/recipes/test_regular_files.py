"""What a person names in place of a file: a pipe or a device is refused at once, and never waited for."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from lostmotion_command import Running

from recipes import RecipeError, load_recipe, open_regular, shipped_recipes

ROOT = Path(__file__).parents[2]
QUICK = shipped_recipes()["rv-40e-121-quick"]
AT_ONCE_S = 60.0
"""A command that starts on a busy machine, and not one that waits."""


def pipe(folder: Path) -> Path:
    os.mkfifo(folder / "pipe.yaml")
    return folder / "pipe.yaml"


def local_socket(folder: Path) -> Path:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(folder / "s.yaml"))
    return folder / "s.yaml"


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (pipe, "a pipe, but a file is needed"),
        (local_socket, "No such device or address"),
        (lambda _: Path("/dev/zero"), "a device, but a file is needed"),
        (lambda folder: folder, "a folder"),
    ],
    ids=["pipe", "socket", "device", "folder"],
)
def test_what_is_no_file_is_refused(tmp_path: Path, make, what: str) -> None:
    with pytest.raises(RecipeError, match=what):
        load_recipe(make(tmp_path))


def test_a_link_to_a_file_is_a_file_and_a_link_to_a_pipe_is_none(tmp_path: Path) -> None:
    (tmp_path / "link.yaml").symlink_to(QUICK)
    with open_regular(tmp_path / "link.yaml") as stream:
        assert stream.read() == QUICK.read_bytes()
    (tmp_path / "other.yaml").symlink_to(pipe(tmp_path))
    with pytest.raises(OSError, match="a pipe"):
        open_regular(tmp_path / "other.yaml")


@pytest.mark.parametrize("words", [("check", "{pipe}"), ("capability", "{pipe}"), ("play-model", "{pipe}", "{pipe}")])
def test_no_command_waits_for_a_pipe(tmp_path: Path, words: tuple[str, ...]) -> None:
    named = [word.format(pipe=tmp_path / "pipe.yaml") for word in words]
    pipe(tmp_path)
    command = Running(tuple(named))
    try:
        done = command.finish(AT_ONCE_S)
    finally:
        command.end()
    assert done.exit_code == 2
    assert "a pipe, but a file is needed" in done.err


def test_standard_input_may_be_a_pipe() -> None:
    command = [sys.executable, "-m", "station", "check", "/dev/stdin"]
    done = subprocess.run(command, cwd=ROOT, input=QUICK.read_bytes(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
