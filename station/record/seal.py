"""What a verdict rests on, kept so that an alteration shows: checksums in run.json, and run.json's own in the index.

When a run is concluded, run.json gets the SHA-256 and the size of every file of `SEALED`, and one line goes to the end
of `index.jsonl` in the data folder: run id, SHA-256 of run.json, verdict, time. No line of the index is ever changed.
A run that was not concluded has no checksums; there is no verdict in it to believe either.
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from station.durable import as_json, sync_folder
from station.errors import RecordError
from station.record.run_record import INTERRUPTED, MANIFEST, RECORDING, RESULT, SAMPLES, RunRecord
from station.wall_clock import now_text

INDEX = "index.jsonl"
SEALED = (
    SAMPLES,
    "samples.json",
    "recipe.yaml",
    "bench.yaml",
    "scenario.yaml",
    "program.json",
    "events.jsonl",
    "calibration.json",
    "timing.json",
    RESULT,
)
"""With the device profiles: every file that the verdict rests on, and the verdict itself."""

EXIT_ALTERED = 3
"""What a command that found an alteration ends with when nothing worse is to be said; `analyze` uses it too."""

WORST_FIRST = ("FAIL", "NOT DECIDABLE", "PASS")
CHUNK_BYTES = 1 << 20


def sealed_names(record: RunRecord) -> list[str]:
    """Return the files of a run that are sealed, as they are there now."""
    profiles = sorted(f"profiles/{path.name}" for path in record.folder.glob("profiles/*"))
    return [name for name in (*SEALED, *profiles) if record.has(name)]


def fingerprint(path: Path) -> dict[str, Any]:
    """Return SHA-256 and size in bytes of a file; RecordError when it cannot be read."""
    digest, size = hashlib.sha256(), 0
    try:
        with path.open("rb") as file:
            while chunk := file.read(CHUNK_BYTES):
                digest.update(chunk)
                size += len(chunk)
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror}") from error
    return {"sha256": digest.hexdigest(), "bytes": size}


def seal(record: RunRecord, **changes: Any) -> None:
    """Conclude a run: its last changes and the checksums to run.json, and its line to the index.

    Raises:
        RecordError: run.json or the index cannot be written; the run then has no verdict.

    """
    files = {name: fingerprint(record.folder / name) for name in sealed_names(record)}
    manifest = record.manifest() | changes | {"files": files}
    content = as_json(manifest)
    line = {
        "run": record.id,
        "sha256": hashlib.sha256(content).hexdigest(),
        "verdict": manifest["verdict"],
        "time": now_text(),
    }
    # A power failure between the two leaves a run without checksums, which has no verdict; never one without a line.
    _append(index_of(record), (json.dumps(line, ensure_ascii=False) + "\n").encode())
    record.write_bytes(MANIFEST, content)


def index_of(record: RunRecord) -> Path:
    """Return the index of the data folder that a run lies in."""
    return record.folder.resolve().parent / INDEX


def _append(path: Path, line: bytes) -> None:
    """Append one line in a single write, which runs that end at the same time cannot tear."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            written = os.write(handle, line)
            os.fsync(handle)
        finally:
            os.close(handle)
        sync_folder(path.parent)
    except OSError as error:
        raise RecordError(f"{path}: cannot be written: {error.strerror}. Free the disk, then run again") from error
    if written != len(line):
        raise RecordError(f"{path}: cannot be written: the disk is full. Free the disk, then run again")


def is_sealed(manifest: dict[str, Any]) -> bool:
    """Whether a run was concluded, so that its verdict may be asked for."""
    return "files" in manifest or manifest["state"] not in (RECORDING, INTERRUPTED)


def alterations(record: RunRecord, *, samples: bool = True) -> tuple[str, ...]:
    """Return what is not as it was when the run was concluded, `<file>: <how>` each; empty when everything is.

    Args:
        record: the run; nothing is said of one that was not concluded.
        samples: False compares only the size of the samples, which are most of a run's bytes.

    Raises:
        RecordError: run.json cannot be read.

    """
    manifest = record.manifest()
    if not is_sealed(manifest):
        return ()
    files = manifest.get("files")
    if not isinstance(files, dict):
        return (f"{MANIFEST}: the checksums that a concluded run has are missing",)
    found = _against_index(record)
    names = dict.fromkeys((*files, *sealed_names(record)))
    found += [text for name in names if (text := _difference(record, name, files.get(name), samples=samples))]
    found += _contradictions(record, manifest, files)
    return tuple(found)


def alteration_lines(altered: tuple[str, ...] | list[str]) -> list[str]:
    """Return what a command says first about an altered record; nothing for one that is as it was."""
    if not altered:
        return []
    head = "RECORD ALTERED since the run was concluded: what follows is no evidence of what was measured"
    return [head, *(f"record altered: {one}" for one in altered)]


def _difference(record: RunRecord, name: str, kept: dict[str, Any] | None, *, samples: bool) -> str:
    if kept is None:
        return f"{name}: was not there when the run was concluded"
    path = record.folder / name
    try:
        size = path.stat().st_size
        now = kept | {"bytes": size} if name == SAMPLES and not samples else fingerprint(path)
    except (OSError, RecordError):
        return f"{name}: is missing or cannot be read"
    if now["bytes"] != kept.get("bytes"):
        return f"{name}: has {now['bytes']} bytes, had {kept.get('bytes')} when the run was concluded"
    if now["sha256"] != kept.get("sha256"):
        return f"{name}: its SHA-256 is not the one from when the run was concluded"
    return ""


def index_lines(index: Path, run_id: str) -> list[dict[str, Any]] | None:
    """Return the lines of an index that name a run; None when there is no index."""
    try:
        texts = index.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    found = []
    for text in texts:
        try:
            line = json.loads(text)
        except ValueError:
            continue
        if isinstance(line, dict) and line.get("run") == run_id:
            found.append(line)
    return found


def has_index(record: RunRecord) -> bool:
    """Whether there is an index beside the run; a run that was copied elsewhere has none to vouch for its run.json."""
    return index_of(record).is_file()


def _against_index(record: RunRecord) -> list[str]:
    manifest = record.manifest()
    lines = index_lines(index_of(record), str(manifest.get("id")))
    if lines is None:
        return []
    if not lines:
        return [f"{INDEX}: has no line for this run"]
    if len({line.get("sha256") for line in lines}) > 1:
        return [f"{INDEX}: has {len(lines)} lines for this run, which is concluded once"]
    found = []
    if lines[0].get("sha256") != fingerprint(record.folder / MANIFEST)["sha256"]:
        found.append(f"{MANIFEST}: its SHA-256 is not the one in {INDEX}")
    if lines[0].get("verdict") != manifest.get("verdict"):
        found.append(f"{MANIFEST}: says {manifest.get('verdict')}, {INDEX} says {lines[0].get('verdict')}")
    return found


def _contradictions(record: RunRecord, manifest: dict[str, Any], files: dict[str, Any]) -> list[str]:
    """Return where the parts of a record do not say the same: recipe and bench as started, verdict, metrics."""
    found = [
        f"{part}.yaml: is not the {part} that the run was started with"
        for part in ("recipe", "bench")
        if manifest[part]["sha256"] != files.get(f"{part}.yaml", {}).get("sha256")
    ]
    try:
        result = record.read_json(RESULT)
        verdict, metrics = result["verdict"], [metric["verdict"] for metric in result["metrics"]]
        said = {key: result[key] for key in ("run", "serial", "state")}
    except (RecordError, KeyError, TypeError):
        return [*found, f"{RESULT}: is not a result"]
    own = {"run": manifest["id"], "serial": manifest["serial"], "state": manifest["state"]}
    found += [f"{RESULT}: says {key} {said[key]}, {MANIFEST} says {own[key]}" for key in own if said[key] != own[key]]
    if verdict != manifest["verdict"]:
        found.append(f"{RESULT}: says {verdict}, {MANIFEST} says {manifest['verdict']}")
    implied = next((one for one in WORST_FIRST if one in metrics), "NOT DECIDABLE")
    if verdict in ("PASS", "FAIL") and verdict != implied:
        found.append(f"{RESULT}: says {verdict}, its own metrics say {implied}")
    return found
