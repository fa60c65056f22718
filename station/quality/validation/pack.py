"""A validation pack as files: the page, the same as JSON, files for a person to read, and a signed list of all.

    validation.html   what an auditor reads
    validation.json   the same for a program
    evidence/         files that belong to it, as they were
    files.json        SHA-256 of each of these
    signature.json    signature of files.json by this computer's key

`check_pack` says whether a pack is as it was made, and by which key.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import jinja2

from station.atomic_file import write_atomic
from station.documents.entries import plain
from station.documents.reading import document_in, read_document
from station.documents.validation import (
    ATTACHED,
    NOT_MET,
    OPEN,
    OPERATION,
    PARTS,
    STATES,
    Evidence,
    PackFiles,
    PackSignature,
    ValidationPack,
)
from station.errors import StationError
from station.quality.validation.operation import content_of
from station.records.chain.keys import own_key, own_public_key, signed_by, trusted_by_person
from station.version import version
from station.wall_clock import now_text

TEMPLATE = "validation.html.j2"
PAGE, DOCUMENT, FILES, SIGNATURE = "validation.html", "validation.json", "files.json", "signature.json"
ATTACHMENTS = "evidence"

PAGES = {
    "coverage.md": "Is the stated measurement uncertainty large enough? Tried on simulated units of known values",
    "model-check.md": "Every state that the controller can reach, checked against its safety rules",
    "fault-matrix.md": "Every fault in every state: the reaction that was measured",
    "exits.md": "Time to zero torque for every way in which a run can end",
    "safety.md": "Protections of the bench, how each was proven, and what happens without it",
}
"""Pages of the documentation that are evidence of the software's maker, where the sources are there."""


class Attachment(NamedTuple):
    """A file that goes into the pack: its name there, what it is, and its bytes."""

    name: str
    what: str
    content: bytes


def attachments(docs: Path, named: Iterable[Path]) -> list[Attachment]:
    """Return the files that go into the pack: pages of the documentation, and those that a person has named.

    Raises:
        StationError: a named file cannot be read, or two have one name.

    """
    found = [
        Attachment(name, what, (docs / name).read_bytes()) for name, what in PAGES.items() if (docs / name).is_file()
    ]
    found += [Attachment(path.name, "Named by whoever made the pack", content_of(path, "--evidence")) for path in named]
    twice = [name for name, times in Counter(one.name for one in found).items() if times > 1]
    if twice:
        raise StationError(f"--evidence: two files are called {twice[0]}; rename one")
    return found


def pack_of(data: Path, bench: str | None, evidence: Iterable[Evidence], files: Iterable[Attachment]) -> ValidationPack:
    """Return the pack: what was found, and the attached files."""
    attached = [
        Evidence(
            part=OPERATION,
            asked=one.what,
            found=f"{ATTACHMENTS}/{one.name}, SHA-256 {_sha256(one.content)}",
            state=ATTACHED,
            again=f"{ATTACHMENTS}/{one.name}",
        )
        for one in files
    ]
    return ValidationPack(made=now_text(), data=str(data), bench=bench, evidence=(*evidence, *attached))


def counts(pack: ValidationPack) -> Mapping[str, int]:
    """Return how many of the evidence are in each state, in the order of the table of states."""
    found = Counter(one.state for one in pack.evidence)
    return {state: found[state] for state in STATES}


def fulfilled(pack: ValidationPack) -> bool:
    """Whether nothing is missing: nothing not met, and nothing open."""
    return not counts(pack)[NOT_MET] and not counts(pack)[OPEN]


def write_pack(pack: ValidationPack, files: Iterable[Attachment], folder: Path) -> list[Path]:
    """Write a pack into a folder that is new or empty; return its files.

    Raises:
        StationError: the folder has files already.
        OSError: it cannot be written.
        RecordError: the key of this computer cannot be read.

    """
    if folder.exists() and any(folder.iterdir()):
        raise StationError(f"--out {folder}: this folder is not empty, and nothing is overwritten. Name a new folder")
    document = json.dumps(plain(pack), ensure_ascii=False, indent=1).encode() + b"\n"
    content = {f"{ATTACHMENTS}/{one.name}": one.content for one in files}
    content |= {DOCUMENT: document, PAGE: _page(pack)}
    listed = PackFiles(made=pack.made, software=version(), files={name: _sha256(one) for name, one in content.items()})
    content[FILES] = json.dumps(plain(listed), indent=1).encode() + b"\n"
    key = own_key()
    signature = PackSignature(key=key.public, signature=key.sign(content[FILES]))
    content[SIGNATURE] = json.dumps(plain(signature), indent=1).encode() + b"\n"
    for name, one in content.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, one)
    return [folder / name for name in content]


class Checked(NamedTuple):
    """What was found of a pack: its list, the key that signed it, whether this computer knows that key, problems."""

    files: PackFiles
    key: str
    known: bool
    problems: list[str]


def check_pack(folder: Path) -> Checked:
    """Return whether a pack is as it was made.

    Raises:
        StationError, RecordError: there is no pack, or its list or signature cannot be read.

    """
    if not (folder / FILES).is_file():
        raise StationError(
            f"--check {folder}: this is not a validation pack: it has no {FILES}. Name the folder of a validation pack"
        )
    content = content_of(folder / FILES, "--check")
    listed = document_in(PackFiles, content, folder / FILES)
    signature = read_document(PackSignature, folder / SIGNATURE)
    problems = []
    if not signed_by(signature.key, content, signature.signature):
        problems.append(f"{FILES}: is not what {signature.key} has signed")
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()}
    there -= {FILES, SIGNATURE}
    problems += [f"{name}: is missing" for name in sorted(listed.files.keys() - there)]
    problems += [f"{name}: does not belong to the pack" for name in sorted(there - listed.files.keys())]
    for name in sorted(there & listed.files.keys()):
        if _sha256(content_of(folder / name, "--check")) != listed.files[name]:
            problems.append(f"{name}: was changed")
    known = signature.key in {own_public_key(), *trusted_by_person()}
    return Checked(listed, signature.key, known, problems)


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _page(pack: ValidationPack) -> bytes:
    loader = jinja2.FileSystemLoader(Path(__file__).parent)
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.get_template(TEMPLATE)
    return template.render(pack=pack, parts=PARTS, states=STATES, counts=counts(pack), version=version()).encode()
