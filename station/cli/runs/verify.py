"""`lostmotion verify` and `lostmotion key`: whether a data folder is as it was left, and who signs here."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from station.bench.files import load_named_bench
from station.counted import counted
from station.documents.entries import left_out, plain
from station.errors import StationError
from station.own_place import own_place
from station.records.certificate_code import GENUINE, attempts_of, check_code
from station.records.chain.head import chain_seen_in
from station.records.chain.keys import KEYS, PRIVATE, check_public_key, own_key, trust, trusted_by_person
from station.records.chain.problems import PROBLEMS
from station.records.verify import NAMED_ONCE, Verified, verify_folder
from station.run.jog.jogs import FOLDER as JOGS
from station.run.way_back.recoveries import FOLDER as RECOVERIES
from station.store.quality.verified import tell_store
from station.store.view import warn

EXIT_PROBLEMS = 1
NOT_AS_SEALED = NAMED_ONCE | {"altered", "damaged", "no_chain"}
"""Kinds of problem by which a record is not the one that was sealed."""

MOST_OF_A_KIND = 20
"""Problems of one kind that are printed; JSON has all."""


def verify(data: Path, keys: list[str], bench: str | None, *, samples: bool, as_json: bool) -> int:
    """Check chain, signatures and every file of a data folder, of its recoveries and jogs; 0 passed, 1 not.

    Raises:
        StationError, RecipeError: no such folder, or a key that is none.

    """
    if not data.is_dir():
        raise StationError(f"--data {data}: there is no such folder; name the one that 'lostmotion run' wrote to")
    named = _named(keys, bench)
    below = {name: data / name for name in (RECOVERIES, JOGS) if (data / name).is_dir() or chain_seen_in(data / name)}
    folders = [data, *below.values()]
    found = {one: verify_folder(one, named, samples=samples, may_be_empty=one != data) for one in folders}
    _tell_store(data, found[data], samples=samples)
    if as_json:
        checked = {name: _checked(folder, found[folder]) for name, folder in below.items()}
        whole = replace(_checked(data, found[data]), recoveries=checked.get(RECOVERIES), jogs=checked.get(JOGS))
        sys.stdout.write(json.dumps(plain(whole), ensure_ascii=False) + "\n")
    else:
        for folder, one in found.items():
            sys.stdout.writelines(f"{line}\n" for line in _lines(folder, one))
    return EXIT_PROBLEMS if any(one.problems for one in found.values()) else 0


def _tell_store(data: Path, found: Verified, *, samples: bool) -> None:
    """Let the store know which records are altered; a store that cannot be used is told, and changes nothing here."""
    altered = {one.run for one in found.problems if one.kind in NOT_AS_SEALED}
    try:
        tell_store(data, altered, samples=samples)
    except StationError as error:
        warn(f"{error}. What was found is not in the store: 'capability' and 'quality' may count altered runs")


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedCertificate:
    """What `verify --code` prints: genuine, altered or unknown, why, and what the certificate has to say.

    aside: why the verdict is not that of a real unit. since: what became of the unit when it was measured again.
    """

    certificate: str
    text: str
    run: str
    serial: str
    attempt: int | None
    attempts: str
    verdict: str | None
    aside: str | None
    since: tuple[str, ...]


def verify_code(data: Path, code: str, keys: list[str], bench: str | None, *, as_json: bool) -> int:
    """Say whether a certificate is genuine, and what it has to say; 0 genuine, 1 not.

    keys, bench: who must have signed, as of `verify`.

    Raises:
        StationError: the text is no code, a key is none, or the data folder cannot be read.

    """
    found = check_code(data, code, _named(keys, bench))
    if as_json:
        whole = CheckedCertificate(
            certificate=found.standing, text=found.text, run=found.run, serial=found.serial, attempt=found.attempt,
            attempts=attempts_of(found), verdict=found.verdict, aside=found.aside,
            since=tuple(str(one) for one in found.since),
        )  # fmt: skip
        sys.stdout.write(json.dumps(plain(whole), ensure_ascii=False) + "\n")
    else:
        told = [f"{found.standing.upper()}  {found.text}", f"run      {found.run}"]
        told += [f"serial   {found.serial}, {attempts_of(found)}"] if found.serial else []
        told += [f"verdict  {found.verdict}{f', {found.aside}' if found.aside else ''}"] if found.verdict else []
        told += [f"since    {one}" for one in found.since]
        sys.stdout.write("\n".join(told) + "\n")
    return 0 if found.standing == GENUINE else EXIT_PROBLEMS


def _named(keys: list[str], bench: str | None) -> tuple[str, ...]:
    return tuple(check_public_key(key, "--key") for key in keys) + _key_of(bench)


def _key_of(bench: str | None) -> tuple[str, ...]:
    """Return the public key of a bench file, none without one; StationError where the file names none."""
    if bench is None:
        return ()
    key = load_named_bench(bench).bench.public_key
    if key is None:
        raise StationError(f"--bench {bench}: bench.public_key is missing. 'lostmotion key' on its computer prints it")
    return (key,)


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedFolder:
    """What `verify` prints of a data folder; `keys`: how many entries each public key signed."""

    data: str
    chain: str | None
    entries: int
    keys: Mapping[str, int]
    runs: int
    concluded: int
    removed: int
    only_archived: int
    passed: bool
    warning: str | None
    problems: tuple[Mapping[str, str], ...]
    time_runs_back: tuple[str, ...]
    recoveries: CheckedFolder | None = left_out()
    jogs: CheckedFolder | None = left_out()


def _checked(folder: Path, one: Verified) -> CheckedFolder:
    return CheckedFolder(
        data=str(folder),
        chain=one.chain.id if one.chain.there else None,
        entries=one.walk.entries,
        keys=dict(one.walk.keys),
        runs=one.runs,
        concluded=one.concluded,
        removed=one.removed,
        only_archived=one.only_archived,
        passed=not one.problems,
        warning=one.trust.warning or None,
        problems=tuple(problem.as_json() for problem in one.problems),
        time_runs_back=tuple(one.walk.back),
    )


def _lines(folder: Path, one: Verified) -> list[str]:
    """Return what a person reads: how much was checked, then every kind of problem with what to do about it."""
    signed = (
        f"{counted(one.walk.entries, 'entry', 'entries')} of the chain"
        if one.chain.there
        else "no chain: nothing in it is signed"
    )
    gone = f", {one.removed} removed by a retention rule" if one.removed else ""
    gone += (
        f" ({one.only_archived} of them only in the archive: 'lostmotion archive fetch')" if one.only_archived else ""
    )
    lines = [f"{folder}: {counted(one.runs, 'run')}, {one.concluded} concluded{gone}, {signed}"]
    for kind, action in PROBLEMS.items():
        texts = [problem.text for problem in one.problems if problem.kind == kind]
        lines += [f"  {text}" for text in texts[:MOST_OF_A_KIND]]
        lines += [f"  ... and {len(texts) - MOST_OF_A_KIND} more of this kind"] if len(texts) > MOST_OF_A_KIND else []
        lines += [f"    {action}"] if texts else []
    if one.trust.warning:
        lines.append(f"  note: {one.trust.warning}")
    back = one.walk.back
    lines += [f"  note: {text}" for text in back[:MOST_OF_A_KIND]]
    lines += [f"  ... and {len(back) - MOST_OF_A_KIND} more notes of this kind"] if len(back) > MOST_OF_A_KIND else []
    count = len(one.problems)
    return [*lines, "passed" if not count else f"NOT PASSED: {count} {'problem' if count == 1 else 'problems'}"]


def key(trusted: str | None, *, as_json: bool) -> int:
    """Print the public key of this computer, made at first use; trust another one where it is named. Returns 0.

    Raises:
        StationError: the key cannot be made, or the named one is none.

    """
    if trusted is not None:
        trust(check_public_key(trusted, "--trust"))
    own, place = own_key().public, own_place() / KEYS / PRIVATE
    if as_json:
        whole = {"public_key": own, "private_key_file": str(place), "trusted": trusted_by_person()}
        sys.stdout.write(json.dumps(whole) + "\n")
        return 0
    sys.stdout.write(f"{own}\nThe private key is {place}. Bench files name the public key: bench.public_key\n")
    sys.stdout.writelines(f"trusted: {one}\n" for one in trusted_by_person())
    return 0
