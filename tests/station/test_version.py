"""What a run keeps of the software that made it: found when the run starts, in a checkout, a wheel and a bare copy."""

from __future__ import annotations

import json
import os
import platform
import pwd
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import ROOT
from setuptools_scm import get_version

from controller.decisions import DECISIONS, DECISIONS_VERSION, changes_since
from station.documents.entries import plain
from station.version import DECIDING, PACKAGES, checkout, files_sha256, program_seen, software, version


def git(root: Path, *words: str) -> None:
    who = ("-c", "user.name=t", "-c", "user.email=t@example.org", "-c", "commit.gpgsign=false")
    subprocess.run(["git", "-C", str(root), *who, *words], check=True, capture_output=True)  # noqa: S607


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A small program of the same packages, without git."""
    for package in PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text(f'"""{package}."""\n')
    (tmp_path / "pyproject.toml").write_text("[tool.setuptools_scm]\n")
    return tmp_path


@pytest.fixture
def cloned(copy: Path) -> Path:
    git(copy, "init", "-q")
    git(copy, "add", "-A")
    git(copy, "commit", "-qm", "first")
    return copy


def fresh(root: Path) -> Any:
    checkout.cache_clear()
    return checkout(root)


def commit(root: Path, text: str) -> None:
    (root / "station" / "more.py").write_text(text)
    git(root, "add", "-A")
    git(root, "commit", "-qm", "more")


def test_each_commit_is_another_version_and_a_change_is_said(cloned: Path) -> None:
    first = fresh(cloned)
    assert (first.changed, first.version) == (False, f"0.0.post1+g{first.id[:9]}")
    (cloned / "station" / "more.py").write_text("x = 1\n")
    assert fresh(cloned).version == f"{first.version}.changed"
    commit(cloned, "x = 2\n")
    assert fresh(cloned).version.startswith("0.0.post2+g")
    (cloned / "notes.txt").write_text("no part of the program")
    assert not fresh(cloned).changed


@pytest.mark.parametrize("commits_since", [None, 0, 2])
def test_a_wheel_is_given_the_version_that_its_checkout_says(cloned: Path, commits_since: int | None) -> None:
    if commits_since is not None:
        git(cloned, "tag", "v0.2.0")
        for number in range(commits_since):
            commit(cloned, f"x = {number}\n")
    built = get_version(root=str(cloned), version_scheme="post-release", fallback_version="0.0")
    assert fresh(cloned).version == built


def test_the_build_uses_the_scheme_that_the_test_above_compares() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert 'version_scheme = "post-release"' in text
    assert 'fallback_version = "0.0"' in text


def test_a_copy_without_git_is_told_apart_by_its_files(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert fresh(copy) is None
    before = files_sha256(copy)
    (copy / "station" / "__pycache__").mkdir()
    for name in ("x.pyc", "plant-0.o", "more.nbi"):
        (copy / "station" / "__pycache__" / name).write_bytes(b"made while it runs")
    assert files_sha256(copy) == before
    (copy / "recipes" / "limits.yaml").write_text("a: 1\n")
    changed = files_sha256(copy)
    assert changed != before
    shutil.copytree(copy, copy.parent / "again", dirs_exist_ok=True)
    assert files_sha256(copy.parent / "again") == changed
    monkeypatch.setenv("PATH", "")
    (copy / ".git").mkdir()
    assert fresh(copy) is None


def test_a_checkout_without_an_answer_of_git_does_not_claim_the_version_of_its_installation(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (copy / ".git").mkdir()  # git finds no repository there
    monkeypatch.setattr("station.version.ROOT", copy)
    monkeypatch.setattr("station.version.checkout", lambda: fresh(copy))
    assert version().startswith("unknown")


def test_a_run_names_its_software(golden_run: Any) -> None:
    checkout.cache_clear()
    said = json.loads((golden_run.record / "run.json").read_bytes())["software"]
    assert said == plain(software())
    assert said["version"] == version() != "0.1.0"
    assert len(said["files_sha256"]) == 64
    assert set(said["dependencies"]) == set(DECIDING)
    assert all(said["dependencies"].values())
    assert (said["host"], said["user"]) == (platform.node(), pwd.getpwuid(os.geteuid()).pw_name)
    assert said["decisions"] == DECISIONS_VERSION


def test_a_process_sees_that_the_program_was_changed_since_it_was_loaded(copy: Path) -> None:
    before = program_seen(copy)
    file = copy / PACKAGES[0] / "one.py"
    (copy / PACKAGES[0]).mkdir(exist_ok=True)
    file.write_text("x = 1\n")
    added = program_seen(copy)
    (copy / PACKAGES[0] / "__pycache__").mkdir(exist_ok=True)
    (copy / PACKAGES[0] / "__pycache__" / "one.o").write_text("made while it runs")
    assert program_seen(copy) == added != before
    file.write_text("x = 22\n")
    assert program_seen(copy) != added


def test_versions_of_the_decisions_follow_each_other() -> None:
    assert list(DECISIONS) == list(range(1, DECISIONS_VERSION + 1))
    assert changes_since(DECISIONS_VERSION) == []
    assert changes_since(0)[0].startswith("1: ")
