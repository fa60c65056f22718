"""What a verdict rests on, kept so that an alteration shows: checksums in run.json, and run.json's own in the index.

When a run is concluded, run.json gets the SHA-256 and the size of every file of `SEALED`, and one line goes to the end
of the index in the data folder. A run that was not concluded has no checksums; there is no verdict in it to believe
either. A run is concluded by its line: the new run.json is on disk beside the old one before it, and takes its place
behind it, whoever does that.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from station.durable import as_json, read_from_disk, refused, remove_parts, sync_folder
from station.errors import RecordError
from station.record.ring import FILE_PREFIX
from station.record.run_index import INDEX, append_line, index_lines, index_of
from station.record.run_record import INTERRUPTED, MANIFEST, RECORDING, RESULT, SAMPLES, RunRecord
from station.wall_clock import now_text

CONCLUDED = ".run.json.concluded"
"""The run.json of a run whose line is being written to the index; nobody believes it before it is there."""

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
        raise refused(path, error, "read") from error
    return {"sha256": digest.hexdigest(), "bytes": size}


def seal(record: RunRecord, **changes: Any) -> None:
    """Conclude a run: its last changes and the checksums to run.json, and its line to the index.

    Raises:
        RecordError: run.json or the index cannot be written; the run then has no verdict.

    """
    remove_parts(record.folder)
    files = {name: fingerprint(record.folder / name) for name in sealed_names(record)}
    manifest = record.manifest() | changes | {"files": files}
    content = as_json(manifest)
    line = {
        "run": record.id,
        "sha256": hashlib.sha256(content).hexdigest(),
        "verdict": manifest["verdict"],
        "time": now_text(),
    }
    # The line is what concludes the run. Before it the new run.json is on disk already, under another name, so that
    # a process that is killed behind it leaves the next one nothing to decide: it gives the file its name.
    record.write_bytes(CONCLUDED, content)
    append_line(index_of(record), line)
    _put_in_place(record)


def finish_seal(record: RunRecord) -> bool:
    """Finish what a process had begun that was killed while it sealed its run; return whether the run is sealed now.

    Only a run.json that the index vouches for is put in its place: any other is removed, and decides nothing.

    Raises:
        RecordError: the disk refuses it; nothing has changed.

    """
    if not record.has(CONCLUDED):
        return False
    index = index_of(record)
    if index.exists():
        read_from_disk(index)  # an index that cannot be read says nothing; and a line that was written is flushed now
    found = fingerprint(record.folder / CONCLUDED)["sha256"]
    if found not in [line.get("sha256") for line in index_lines(index, record.id) or []]:
        record.remove(CONCLUDED)
        return False
    _put_in_place(record)
    return True


def _put_in_place(record: RunRecord) -> None:
    """Give the concluded run.json its name; the ring of the run has nothing more to say."""
    ring = record.manifest().get("ring")
    try:
        if ring and Path(ring).name.startswith(FILE_PREFIX):
            Path(ring).unlink(missing_ok=True)
        (record.folder / CONCLUDED).replace(record.folder / MANIFEST)
        sync_folder(record.folder)
    except OSError as error:
        raise refused(record.folder / MANIFEST, error) from error


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
