"""A validation pack as JSON: what an auditor asks, what was found here, and which files belong to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from station.documents.entries import one_of

MET, NOT_MET, OPEN, STATED, ATTACHED = "met", "not met", "open", "stated", "attached"
STATES = {
    MET: "the evidence shows that the requirement is met",
    NOT_MET: "the evidence shows that the requirement is not met",
    OPEN: "there is no evidence yet; the command in the same row makes it",
    STATED: "a figure that nothing is required of; this program does not judge it",
    ATTACHED: "a file for a person to judge; this program does not judge it",
}
INSTALLATION, OPERATION, PERFORMANCE = "installation", "operation", "performance"
PARTS = {
    INSTALLATION: "Installation qualification: is the bench installed as specified?",
    OPERATION: "Operational qualification: does the bench work as specified?",
    PERFORMANCE: "Performance qualification: does the bench measure these units accurately enough?",
}


def judged(met: bool) -> str:  # noqa: FBT001 - the one thing that it is about
    """Return the state of something that is so, or not."""
    return MET if met else NOT_MET


EvidenceState = Annotated[str, one_of(*STATES)]
PartName = Annotated[str, one_of(*PARTS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """One thing that is asked: what was found, whether that is enough, and the command or file that shows it again."""

    part: PartName
    asked: str
    found: str
    state: EvidenceState
    again: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationPack:
    """All evidence of an installation at one moment."""

    format: int = 1
    made: str
    data: str
    bench: str | None
    evidence: tuple[Evidence, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PackFiles:
    """SHA-256 of every file of a pack, by its name, when it was made and by which version of the program."""

    made: str
    software: str
    files: Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class PackSignature:
    """Signature of the list of files, and the public key that it is by."""

    key: str
    signature: str
