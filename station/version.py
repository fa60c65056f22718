"""Which software this is: what `--version` prints, what a run keeps of it, and what a stored verdict is compared with.

A version is the newest release and the commits since: `0.2.0.post12+g1a2b3c4d5`. In a checkout (also one that is
installed with `pip install -e`) git is asked now, because what was written down at the installation is of that day. A
wheel has it from its build (setuptools-scm, pyproject.toml). The SHA-256 over the program's own files is true for both,
and where there is no git.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import platform
import pwd
import subprocess
import sysconfig
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

from controller.decisions import DECISIONS_VERSION
from station.documents.manifest import Software

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("analysis", "controller", "definitions", "drivers", "faultlab", "recipes", "station", "virtual_bench")
MADE_FROM_PROGRAM = "__pycache__"
"""Folders of what is made from the program while it runs: compiled modules, and machine code."""

DECIDING = ("numpy", "scipy", "transitions", "canopen", "python-can", "pymodbus")
"""Dependencies that a measurement or a decision goes through; the bench file names the virtual bench's own."""

UNRELEASED = "0.0"
"""The release before the first one, as setuptools-scm calls it."""

NODE_DIGITS = 9
GIT_S = 30.0
"""Longest wait for git: on a busy computer its first look at a checkout takes seconds."""


class Commit(NamedTuple):
    """A commit of the checkout that the program runs from, the version it is, and whether files were changed since."""

    id: str
    version: str
    changed: bool


def version() -> str:
    """Return the version; words where nobody knows it: no answer of git in a checkout, a copy that is not installed."""
    commit = checkout()
    if commit is not None:
        return commit.version
    if (ROOT / ".git").exists():  # what was written down at the installation is of another day
        return "unknown (git does not answer in its checkout)"
    with suppress(importlib.metadata.PackageNotFoundError):
        return importlib.metadata.version("lostmotion")
    return "unknown (run from its source folder)"


@cache
def checkout(root: Path = ROOT) -> Commit | None:
    """Return the commit that the program runs from; None for an installed wheel, and where git does not answer."""
    if not (root / ".git").exists():
        return None
    try:
        commit = _git(root, "rev-parse", "HEAD")
        changed = bool(_git(root, "status", "--porcelain", "--", *PACKAGES))
        release, distance = _since_release(root)
    except (OSError, subprocess.SubprocessError, ValueError):
        return None
    plain = release if distance == 0 else f"{release}.post{distance}"
    node = f"+g{commit[:NODE_DIGITS]}" if distance or changed else ""
    return Commit(commit, f"{plain}{node}{'.changed' if changed else ''}", changed)


def _since_release(root: Path) -> tuple[str, int]:
    """Return the newest release that the commit comes after, and the number of commits since."""
    try:
        tag, distance, _ = _git(root, "describe", "--tags", "--long", "--match", "v[0-9]*").rsplit("-", 2)
    except subprocess.CalledProcessError:
        return UNRELEASED, int(_git(root, "rev-list", "--count", "HEAD"))
    return tag.removeprefix("v"), int(distance)


def _git(root: Path, *words: str) -> str:
    command = ("git", "-C", str(root), *words)
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=GIT_S).stdout.strip()  # noqa: S603


def files_sha256(root: Path = ROOT) -> str:
    """Return the SHA-256 over names and contents of the program's files: the same for a wheel and its commit."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*")):
            if MADE_FROM_PROGRAM not in path.parts and path.is_file():
                content = hashlib.sha256(path.read_bytes()).hexdigest()
                digest.update(f"{path.relative_to(root).as_posix()} {content}\n".encode())
    return digest.hexdigest()


def program_seen(root: Path = ROOT) -> int:
    """Return a number that is another one when files of the program, or packages that it uses, were changed.

    It looks at names, sizes and times only, in a few milliseconds: for a process that has loaded the program earlier.
    """
    looks = [("", Path(sysconfig.get_path("purelib")).stat().st_mtime_ns, 0)]
    for package in PACKAGES:
        for folder, folders, names in os.walk(root / package):
            folders[:] = [name for name in folders if name != MADE_FROM_PROGRAM]
            found = ((path, path.stat()) for path in (Path(folder, name) for name in names))
            looks += [(str(path), there.st_mtime_ns, there.st_size) for path, there in found]
    return hash(tuple(sorted(looks)))


@cache
def _own_files_sha256() -> str:
    """Return the hash of this program's files as they were when this process first asked: what it has loaded."""
    return files_sha256()


def software() -> Software:
    """Return what a run keeps of the software that makes it, and of the computer that it runs on."""
    commit = checkout()
    return Software(
        name="lostmotion",
        version=version(),
        commit=None if commit is None else commit.id,
        changed=None if commit is None else commit.changed,
        files_sha256=_own_files_sha256(),
        decisions=DECISIONS_VERSION,
        dependencies={name: _installed(name) for name in DECIDING},
        python=platform.python_version(),
        platform=platform.platform(),
        host=platform.node(),
        user=_user(),
    )


@cache
def _installed(name: str) -> str | None:
    """Return the version of a package as it was when this process first asked: what it has loaded."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _user() -> str:
    """Return the operating system's name of the user; the number where the system has no name for it."""
    try:
        return pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return str(os.geteuid())
