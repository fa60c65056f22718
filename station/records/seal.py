"""What a verdict rests on, kept so that an alteration shows: checksums in run.json, and run.json's own in the chain.

When a run is concluded, run.json gets the SHA-256 and the size of every file of `SEALED`, and one signed line goes to
the end of the chain in the data folder. A run that was not concluded has no checksums; there is no verdict in it to
believe either. A run is concluded by its line: the new run.json is on disk beside the old one before it, and takes its
place behind it, whoever does that.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Mapping
from pathlib import Path

from station.atomic_file import as_json, open_file, refused, remove_parts, sync_folder
from station.documents.manifest import Checksum, Manifest, PackedSamples
from station.documents.reading import document_in
from station.documents.result import Decided
from station.errors import RecordError
from station.records.begun_by import BegunBy, beginning_of, is_named_by, not_begun_by, not_begun_with, unlike_its_line
from station.records.chain.blocks import read_back
from station.records.chain.chain_file import CHAIN, Chain
from station.records.chain.entries import SEALED as SEALED_ENTRY
from station.records.chain.entries import Entry
from station.records.chain.missing import why_not_alone
from station.records.chain.old_index import INDEX, index_content, index_kept, index_lines
from station.records.chain.walk import trust_of, whole_between
from station.records.chain.writing import writing_to
from station.records.ring.ring import FILE_PREFIX
from station.records.run_record import (
    BENCH_COPY,
    CALIBRATION,
    EVENTS,
    INTERRUPTED,
    MANIFEST,
    PACKED,
    PROFILE_ENDINGS,
    PROFILES,
    RECIPE_COPY,
    RECORDING,
    RESULT,
    SAMPLES,
    TIMING,
    RunRecord,
)
from station.there import is_there

CONCLUDED = ".run.json.concluded"
"""The run.json of a run whose line is being written to the chain; nobody believes it before it is there."""

SEALED = (
    SAMPLES,
    PACKED,
    "samples.json",
    RECIPE_COPY,
    BENCH_COPY,
    "scenario.yaml",
    "program.json",
    EVENTS,
    CALIBRATION,
    TIMING,
    RESULT,
)
"""With the device profiles: every file that the verdict rests on, and the verdict itself."""

EXIT_ALTERED = 3
"""What a command that found an alteration ends with when nothing worse is to be said; `analyze` uses it too."""

WORST_FIRST = ("FAIL", "NOT DECIDABLE", "PASS")
CHUNK_BYTES = 1 << 20
NOT_READ, NO_RESULT = "is missing or cannot be read", "is not a result"
"""How an alteration ends where a file, or a part of it, could not be read: at the next look it may be."""

RESTORE = "Restore the run's folder from a backup"


def sealed_names(record: RunRecord) -> list[str]:
    """Return the files of a run that are sealed, as they are there now."""
    return [name for name in names_to_seal(record) if record.has(name)]


def names_to_seal(record: RunRecord) -> tuple[str, ...]:
    """Return the files that are sealed in a run where they are there."""
    try:
        profiles = sorted(os.listdir(f"{record.folder}/{PROFILES}"))  # noqa: PTH208 - pathlib takes twice as long
    except OSError:
        profiles = []
    return (*SEALED, *(f"{PROFILES}/{name}" for name in profiles if name.endswith(PROFILE_ENDINGS)))


def fingerprint(path: Path) -> Checksum:
    """Return SHA-256 and size in bytes of a file; RecordError when it cannot be read."""
    digest, size = hashlib.sha256(), 0
    try:
        with open_file(path) as file:
            while chunk := file.read(CHUNK_BYTES):
                digest.update(chunk)
                size += len(chunk)
    except OSError as error:
        raise refused(path, error, "read") from error
    return Checksum(sha256=digest.hexdigest(), bytes=size)


def seal(record: RunRecord, *, samples: PackedSamples | None = None, **changes: object) -> None:
    """Conclude a run: its last changes and the checksums to run.json, and its signed line to the chain.

    samples: of a run whose samples were packed; the raw ones are removed.

    Raises:
        RecordError: run.json or the chain cannot be written; the run then has no verdict. Or `refuse_second_seal`.

    """
    remove_parts(record.folder)
    names = [name for name in sealed_names(record) if name != SAMPLES or samples is None]
    files = {name: fingerprint(record.folder / name) for name in names}
    packed = {} if samples is None else {"samples": samples}
    content = as_json(record.changed_manifest({**changes, **packed, "files": files}))
    manifest = document_in(Manifest, content, record.folder / CONCLUDED)
    row = {name: getattr(manifest, name) for name in ("serial", "attempt", "state", "verdict")}
    row |= {"run": record.id, "created": None if manifest.chain is None else manifest.chain.counter}
    with writing_to(data_folder(record)) as chain:
        refuse_second_seal(record, manifest, chain.chain, chain.trusted)
        # The line is what concludes the run. Before it the new run.json is on disk already, under another name, so that
        # a process that is killed behind it leaves the next one nothing to decide: it gives the file its name.
        record.write_bytes(CONCLUDED, content)
        chain.append(SEALED_ENTRY, sha256=hashlib.sha256(content).hexdigest(), **row)
    _put_in_place(record)


def refuse_second_seal(
    record: RunRecord, manifest: Manifest, chain: Chain, trusted: frozenset[str] | None = None
) -> None:
    """Look whether a run may be concluded in this folder; a run is begun once and sealed once, where it was begun.

    An unsealed record is protected by nothing. Somebody may have put it into the place of the sealed one, or copied it
    here, and a signature would make it true.

    trusted: public keys whose signatures count; None for those that this computer knows.

    Raises:
        RecordError: it may not be; says why, and what to do.

    """
    run, place = manifest.id, record.folder
    if run != record.id:
        raise RecordError(f"{place}: contains run {run}; the folder was copied or renamed. Conclude the run itself")
    if trusted is None:
        trusted = trust_of(chain).keys if chain.there else frozenset()
    if _that_count(chain, run, trusted):
        raise RecordError(f"{place}: {CHAIN} seals this run already, with another {MANIFEST}. {RESTORE}")
    if manifest.chain is None:
        known = not chain.there or (chain.before is not None and run in chain.before.unconcluded)
    else:
        created = beginning_of(chain, run)
        known = created is not None and created.key in trusted and is_named_by(manifest, chain, created)
    if not known:
        raise RecordError(
            f"{place}: {chain.data / CHAIN} has no entry that begins this run. Put the folder back into the data "
            "folder in which it was begun, and conclude it there"
        )


def data_folder(record: RunRecord) -> Path:
    """Return the data folder that a run lies in; of one that was moved and linked back, the folder with the link.

    The chain beside the link has the run. What lies beside the link's target says nothing of it.
    """
    return record.folder.parent.resolve()


def finish_seal(record: RunRecord) -> bool:
    """Finish what a process had begun that was killed while it sealed its run; return whether the run is sealed now.

    Only a run.json that the chain vouches for, by a key that counts, is put in its place: any other is removed, and
    decides nothing. That of a bench that is not trusted here stays for it, in a run that it began.

    Raises:
        RecordError: the disk refuses it; nothing has changed.

    """
    if not record.has(CONCLUDED):
        return False
    data = data_folder(record)
    for name in (CHAIN, INDEX):
        if is_there(data / name) is not False:
            read_back(data / name)  # one that cannot be read says nothing; and a line that was written is flushed
    found, chain = fingerprint(record.folder / CONCLUDED).sha256, Chain(data)
    if found not in _vouched(chain, record.id):
        if found not in _sealed_elsewhere(chain, record.id):
            record.remove(CONCLUDED)
        return False
    _put_in_place(record)
    return True


def _vouched(chain: Chain, run: str, trusted: frozenset[str] | None = None) -> list[str]:
    """Return the hashes of run.json that the folder vouches for: by a line that counts, or the index before it."""
    signed = [entry.fields["sha256"] for entry in _that_count(chain, run, trusted)]
    kept = index_kept(chain.data, chain.before) if chain.there else index_content(chain.data)
    return signed + [str(line.sha256) for line in index_lines(kept or b"", run)]


def _sealed_elsewhere(chain: Chain, run: str, trusted: frozenset[str] | None = None) -> list[str]:
    """Return the hashes of run.json by which another bench sealed a run that it began; none of a run that counts.

    Its lines make no verdict true here, but they tell that there was one.
    """
    signed = [one for one in _sealed_entries(chain, run) if one.signed]
    created = beginning_of(chain, run, trusted) if signed else None
    if created is None or created.key in (trust_of(chain).keys if trusted is None else trusted):
        return []
    return [one.fields["sha256"] for one in signed]


def is_signed_for(record: RunRecord, chain: Chain, keys: frozenset[str]) -> bool:
    """Whether a line of one of these keys vouches for a run.json as it is: its own, or the first with the old index."""
    if not chain.there or chain.start is None or chain.start.key not in keys:
        kept = [str(one.fields["sha256"]) for one in _that_count(chain, record.id, keys)]
    else:
        kept = _vouched(chain, record.id, keys)
    return fingerprint(record.folder / MANIFEST).sha256 in kept


def _that_count(chain: Chain, run: str, trusted: frozenset[str] | None = None) -> list[Entry]:
    """Return the lines that seal a run and count; trusted: None for the keys that this computer knows."""
    signed = [one for one in _sealed_entries(chain, run) if one.signed]
    if signed and trusted is None:
        trusted = trust_of(chain).keys
    return [one for one in signed if one.key in (trusted or ())]


def _sealed_entries(chain: Chain, run: str) -> list[Entry]:
    return [entry for entry in chain.entries_of(run) if entry.kind == SEALED_ENTRY]


def vouched_for(record: RunRecord) -> str:
    """Return the name of the file beside a run that vouches for its run.json: chain, index or '' for none."""
    data = data_folder(record)
    return next((name for name in (CHAIN, INDEX) if is_there(data / name) is not False), "")


def _put_in_place(record: RunRecord) -> None:
    """Give the concluded run.json its name; the ring of the run has nothing more to say."""
    ring = record.manifest().ring
    try:
        if ring and Path(ring).name.startswith(FILE_PREFIX):
            Path(ring).unlink(missing_ok=True)
        if record.read(Manifest, CONCLUDED).samples is not None:
            record.remove(SAMPLES)  # they are packed: read back, compared and sealed
        (record.folder / CONCLUDED).replace(record.folder / MANIFEST)
        sync_folder(record.folder)
    except OSError as error:
        raise refused(record.folder / MANIFEST, error) from error


def is_sealed(manifest: Manifest) -> bool:
    """Whether a run was concluded, so that its verdict may be asked for."""
    return manifest.files is not None or manifest.state not in (RECORDING, INTERRUPTED)


def alterations(
    record: RunRecord, *, samples: bool = True, chain: Chain | None = None, trusted: frozenset[str] | None = None
) -> tuple[str, ...]:
    """Return what is not as it was when the run was concluded, `<file>: <how>` each; empty when everything is.

    Args:
        record: the run; nothing is said of one that was not concluded.
        samples: False compares only the size of the samples, which are most of a run's bytes.
        chain: that of its data folder, for who looks at many runs; None reads it.
        trusted: public keys whose signatures count; None for those that this computer knows.

    Raises:
        RecordError: run.json cannot be read.

    """
    manifest = record.manifest()
    if not is_sealed(manifest):
        chain = chain or Chain(data_folder(record))
        kept = {*_vouched(chain, record.id, trusted), *_sealed_elsewhere(chain, record.id, trusted)}
        if not kept or _waits_for_its_name(record, kept):
            return ()
        manifest = record.manifest()  # it may have got its name since
    if not is_sealed(manifest):
        return (f"{MANIFEST}: is not the one with which the run was concluded",)
    files = manifest.files
    if files is None:
        return (f"{MANIFEST}: the checksums that a concluded run has are missing",)
    found = _against_chain(record, manifest, chain or Chain(data_folder(record)), trusted)
    names = dict.fromkeys((*files, *sealed_names(record)))
    found += [text for name in names if (text := _difference(record, name, files.get(name), samples=samples))]
    found += _contradictions(record, manifest, files)
    return tuple(found)


def _waits_for_its_name(record: RunRecord, kept: set[str]) -> bool:
    """Whether the run.json that the chain seals waits beside the old one, as it does between its line and its name."""
    if not record.has(CONCLUDED):
        return False
    try:
        return fingerprint(record.folder / CONCLUDED).sha256 in kept
    except RecordError:
        if record.has(CONCLUDED):
            raise  # that it cannot be read now is no alteration
        return False


def alteration_lines(altered: tuple[str, ...] | list[str]) -> list[str]:
    """Return what a command says first about an altered record; nothing for one that is as it was."""
    if not altered:
        return []
    head = "RECORD ALTERED since the run was concluded: what follows is no evidence of what was measured"
    return [head, *(f"record altered: {one}" for one in altered)]


def _difference(record: RunRecord, name: str, kept: Checksum | None, *, samples: bool) -> str:
    if kept is None:
        return f"{name}: was added after the run was concluded"
    path = record.folder / name
    try:
        found = path.stat()
        # Another size says it at once: what somebody made of it may take hours to read.
        other_size = stat.S_ISREG(found.st_mode) and found.st_size != kept.bytes
        by_size = other_size or (name in (SAMPLES, PACKED) and not samples)
        now = Checksum(sha256=kept.sha256, bytes=found.st_size) if by_size else fingerprint(path)
    except (OSError, RecordError):
        return f"{name}: {NOT_READ}"
    if now.bytes != kept.bytes:
        return f"{name}: was changed after the run was concluded: {now.bytes} bytes instead of {kept.bytes}"
    if now.sha256 != kept.sha256:
        return f"{name}: was changed after the run was concluded: its SHA-256 differs"
    return ""


def _against_chain(record: RunRecord, manifest: Manifest, chain: Chain, trusted: frozenset[str] | None) -> list[str]:
    """Return what speaks against a run in the chain beside it, or in the index of a folder from before chains."""
    run = manifest.id
    if not chain.there:
        if why := why_not_alone(manifest, chain.data):
            return [] if record.shown_alone else [why]
        has_index = is_there(chain.data / INDEX) is not False
        return _against_index(record, manifest, index_content(chain.data)) if has_index else []
    named = [] if run == record.id else [f"{MANIFEST}: is that of run {run}; the folder was copied or renamed"]
    entries = _sealed_entries(chain, run)
    keys = trust_of(chain).keys if trusted is None else trusted
    before = chain.before if chain.start is not None and chain.start.key in keys else None
    if not entries and before is not None and manifest.chain is None:
        kept = index_kept(chain.data, before)
        if kept is None:
            return [*named, f"{INDEX}: differs from the one at the start of the chain"]
        if kept:
            return named + _against_index(record, manifest, kept)
        return named if run in before.unconcluded else [*named, f"{CHAIN}: does not name this run"]
    entries = _that_count(chain, run, keys) or entries
    found = _against_entries(record, manifest, entries, keys)
    if entries and not (manifest.chain is None and before is not None and run in before.unconcluded):
        found += _against_beginning(chain, run, manifest, entries[0], keys)
    return named + found


def _against_beginning(chain: Chain, run: str, manifest: Manifest, sealed: Entry, trusted: frozenset[str]) -> list[str]:
    """Return what is wrong between the entry that begins a run and the one that seals it.

    What lies in the folder unsealed is not protected. So a run that nobody began, or that was sealed before and whose
    line was taken out, has no verdict although it was sealed by the right key.
    """
    created = beginning_of(chain, run, trusted)
    if created is None:
        return [f"{CHAIN}: has no entry that begins this run"]
    if not is_named_by(manifest, chain, created):
        return [f"{MANIFEST}: does not name the entry of {CHAIN} that begins this run"]
    if not whole_between(chain, created, sealed):
        return [f"{CHAIN}: entries between the beginning and the end of this run were removed or changed"]
    kept = {name: one.sha256 for name, one in (manifest.files or {}).items()}
    return unlike_its_line(manifest, created) + not_begun_with(created, kept)


def _against_entries(record: RunRecord, manifest: Manifest, entries: list[Entry], trusted: frozenset[str]) -> list[str]:
    if not entries:
        return [f"{CHAIN}: has no entry that seals this run"]
    found = [
        f"{CHAIN}: entry {one.counter} is not signed by the key that it names" for one in entries if not one.signed
    ]
    own = manifest.bench.public_key
    for key in {entry.key for entry in entries}:
        if key not in trusted:
            found.append(f"{CHAIN}: is signed by {key}, which this computer does not know")
        if own is not None and key != own:
            found.append(f"{CHAIN}: is signed by {key}, and not by the key of the bench file")
    if len({entry.fields["sha256"] for entry in entries}) > 1:
        return [*found, f"{CHAIN}: has {len(entries)} entries that seal this run, which is concluded once"]
    said = entries[0].fields
    if said["sha256"] != fingerprint(record.folder / MANIFEST).sha256:
        found.append(f"{MANIFEST}: its SHA-256 is not the one in {CHAIN}")
    found += [
        f"{MANIFEST}: says {name} {getattr(manifest, name)}, {CHAIN} says {said[name]}"
        for name in ("verdict", "state", "serial", "attempt")
        if getattr(manifest, name) != said[name]
    ]
    return found


def _against_index(record: RunRecord, manifest: Manifest, content: bytes) -> list[str]:
    lines = index_lines(content, manifest.id)
    if not lines:
        return [f"{INDEX}: has no line for this run"]
    if len({line.sha256 for line in lines}) > 1:
        return [f"{INDEX}: has {len(lines)} lines for this run, which is concluded once"]
    found = []
    if lines[0].sha256 != fingerprint(record.folder / MANIFEST).sha256:
        found.append(f"{MANIFEST}: its SHA-256 is not the one in {INDEX}")
    if lines[0].verdict != manifest.verdict:
        found.append(f"{MANIFEST}: says {manifest.verdict}, {INDEX} says {lines[0].verdict}")
    return found


def _contradictions(record: RunRecord, manifest: Manifest, files: Mapping[str, Checksum]) -> list[str]:
    """Return where the parts of a record do not say the same: recipe and bench as started, verdict, metrics."""
    sealed = (files.get(name) for name in (RECIPE_COPY, BENCH_COPY))
    found = not_begun_by(manifest, BegunBy(*(None if one is None else one.sha256 for one in sealed)))
    try:
        result = record.read(Decided, RESULT)
    except RecordError:
        return [*found, f"{RESULT}: {NO_RESULT}"]
    pairs = (
        ("run", result.run, manifest.id),
        ("serial", result.serial, manifest.serial),
        ("state", result.state, manifest.state),
    )
    found += [f"{RESULT}: says {key} {said}, {MANIFEST} says {own}" for key, said, own in pairs if said != own]
    verdict, metrics = result.verdict, [metric.verdict for metric in result.metrics]
    if verdict != manifest.verdict:
        found.append(f"{RESULT}: says {verdict}, {MANIFEST} says {manifest.verdict}")
    implied = next((one for one in WORST_FIRST if one in metrics), "NOT DECIDABLE")
    if verdict in ("PASS", "FAIL") and verdict != implied:
        found.append(f"{RESULT}: says {verdict}, its own metrics say {implied}")
    return found
