"""The code on a certificate: run id and SHA-256 of its sealed `run.json`, and whether a code is that of a record.

`run.json` has the checksums of every file of the run, and the signed chain has its hash; so one hash stands for all.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, replace
from pathlib import Path

from station.atomic_file import document_bytes, open_file, refused
from station.documents.manifest import MANIFEST, EarlierAttempt, Manifest, attempt_text
from station.errors import StationError
from station.records.attempts import aside_of
from station.records.chain.chain_file import Chain
from station.records.chain.entries import SEALED, Entry
from station.records.chain.walk import trust_of
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import alterations, is_sealed, is_signed_for

CERTIFICATE = "certificate.yaml"
"""The file of a data folder that says how its certificates look; what is made by it is made anew when it changes."""

GENUINE, ALTERED, UNKNOWN = "genuine", "altered", "unknown"
LONGEST_CODE = 400

_CODE = re.compile(r"LM1\.([0-9a-f]{64})\.(.+)", re.IGNORECASE)
"""Full stops divide it: a scanner sends them alike on the keyboards of most countries."""

_RUN = re.compile(r"\b20[0-9]{6}T[0-9]{6}\.[0-9]{3}Z-.")
"""How the id of a run begins: with the moment of its start."""


class CodeError(StationError):
    """A text that is no code of a certificate."""


@dataclass(frozen=True)
class CheckedCode:
    """What a code is: genuine, altered or unknown, in words. What a certificate has to say is that of `manifest`.

    manifest: of the run where its record is here. entry: serial number, attempt and verdict as the chain has them.
    aside: why its verdict is not that of a real unit, None where it is, or where no record says so. since: what became
    of the unit when it was measured again, oldest first: the verdict of this run is not its newest then.
    """

    standing: str
    text: str
    run: str
    serial: str = ""
    attempt: int | None = None
    verdict: str | None = None
    manifest: Manifest | None = None
    aside: str | None = None
    since: tuple[EarlierAttempt, ...] = ()


def code_of(run: RunRecord) -> str:
    """Return the code of a concluded run; RecordError when its run.json cannot be read."""
    return f"LM1.{_hash(run)}.{run.id}"


def _hash(run: RunRecord) -> str:
    path = run.folder / MANIFEST
    try:
        with open_file(path) as file:
            return hashlib.sha256(document_bytes(file)).hexdigest()
    except OSError as error:
        raise refused(path, error, "read") from error


def names_a_run(text: str) -> bool:
    """Say whether a text has a code or the id of a run in it, as labels and certificates have: no unit is called so."""
    return _CODE.search(text) is not None or _RUN.search(text) is not None


def check_code(data: Path, text: str, named: tuple[str, ...] = ()) -> CheckedCode:
    """Return what a code is, against the records and the chain of a data folder.

    named: public keys, one of which must have signed; empty for those that this computer knows, and for runs from
    before the chain.

    Raises:
        CodeError: the text is no code.
        RecordError: the chain or the record cannot be read.

    """
    known = _checked(data, text, named)
    if known.attempt is None:
        return known
    since = tuple(one for one in Store(data).attempts_of(known.serial) if one.attempt > known.attempt)
    aside = None if known.manifest is None else aside_of(known.manifest)
    return replace(known, aside=aside, since=since)


def _checked(data: Path, text: str, named: tuple[str, ...]) -> CheckedCode:
    """Return what a code is, without what the verdict of its run is worth by now; raises as `check_code`."""
    found = _CODE.fullmatch(text.strip()) if len(text) <= LONGEST_CODE else None
    if found is None:
        raise CodeError(
            f"found {text.strip()[:40]!r}, which is not the code of a certificate: 'LM1.', 64 hexadecimal digits, a "
            "full stop and the run id. Scan the square on the certificate again"
        )
    sha256, chain = found[1].lower(), Chain(data)
    name = _as_written(data, chain, found[2])
    run = Store(data).by_id(name)
    keys = frozenset(named) if named else trust_of(chain).keys if chain.there else frozenset()
    entry = _sealed(chain, name, keys)
    if run is None:
        return _without_record(sha256, name, entry)
    manifest = run.manifest()
    known = CheckedCode(ALTERED, "", name, manifest.serial, manifest.attempt, manifest.verdict, manifest)
    if not is_sealed(manifest):
        return _said(known, ALTERED, "The run was not concluded, so no certificate was made of it.")
    if altered := alterations(run, chain=chain, trusted=frozenset(named) or None):
        return _said(known, ALTERED, f"The record is not as it was when the run was concluded: {altered[0]}.")
    if sha256 != _hash(run):
        return _said(known, ALTERED, "The hash on the certificate is not that of the record: one of the two is forged.")
    if named and not is_signed_for(run, chain, keys):
        return _said(known, UNKNOWN, f"Nothing of this record is signed by {', '.join(named)}.")
    text = "The record is as it was when the run was concluded. Compare what the paper says."
    if not chain.there:
        text = "The record is as its own files say, and nothing signed vouches for it. Compare what the paper says."
    return _said(known, GENUINE, text)


def attempts_of(found: CheckedCode) -> str:
    """Return which attempt a run was, and what became of those before as far as its record is here; '' for none."""
    if found.attempt is None:
        return ""
    return attempt_text(found.attempt, None if found.manifest is None else found.manifest.before, None)


def _said(known: CheckedCode, standing: str, text: str) -> CheckedCode:
    shown = known.verdict if standing == GENUINE else None
    return CheckedCode(standing, text, known.run, known.serial, known.attempt, shown, known.manifest)


def _sealed(chain: Chain, run: str, keys: frozenset[str]) -> Entry | None:
    """Return the newest signed line with which a run was concluded, by one of these keys."""
    if not chain.there:
        return None
    lines = (one for one in chain.entries_of(run) if one.fields["kind"] == SEALED)
    return next((one for one in reversed(list(lines)) if one.signed and one.fields["key"] in keys), None)


def _as_written(data: Path, chain: Chain, name: str) -> str:
    """Return the id of the one run that differs from a typed one by case at most; what was typed where there is none.

    The hash still has to be that of this run: how somebody writes the letters makes nothing genuine.
    """
    if Store(data).by_id(name) is not None:
        return name
    known = {*Store(data).folders(), *(chain.runs() if chain.there else ())}
    alike = [one for one in known if one.casefold() == name.casefold()]
    return alike[0] if len(alike) == 1 and name not in known else name


def _without_record(sha256: str, run: str, entry: Entry | None) -> CheckedCode:
    if entry is None:
        return CheckedCode(UNKNOWN, "No run of this name was ever made here.", run)
    fields = entry.fields
    serial, attempt = str(fields["serial"]), int(fields["attempt"])
    if sha256 != fields["sha256"]:
        text = "The hash on the certificate is not the one in the signed chain. The record itself is not here any more."
        return CheckedCode(ALTERED, text, run, serial, attempt)
    text = "The signed chain has this run with this hash. The record itself is not here any more."
    return CheckedCode(GENUINE, text, run, serial, attempt, fields["verdict"])
