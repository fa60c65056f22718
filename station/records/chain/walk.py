"""A chain from its first line to its last: every hash, every counter, every signature, and what each run has there.

Anybody can add a line. One that does not count, as `writing` says, is named, and the next line is held against the
line before it; so is one that has a number again which was there already. A line of a key that nobody trusts takes no
place from one of a trusted key that belongs there. Earlier programs wrote on behind whatever
line was the last: that is no break either.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from station.records.chain.chain_file import CHAIN, FIRST_LINES, Chain
from station.records.chain.entries import CREATED, LOST, REMOVED, SEALED, START, Entry, entry_of, object_in
from station.records.chain.head import chain_seen_in, counting_keys, head_of
from station.records.chain.keys import FOLDER_KEYS
from station.records.chain.problems import Problem
from station.wall_clock import SLACK


@dataclass(frozen=True)
class Place:
    """How far a chain has been walked: bytes of the file, counter and hash of the last entry in them that counts."""

    offset: int = 0
    counter: int = 0
    sha256: str = ""


class Last(NamedTuple):
    """Counter and hash of the entry that the next one is held against."""

    counter: int
    sha256: str


@dataclass
class Walk:
    """What a walk found: entries by run, what is wrong, who signed how many entries."""

    place: Place = field(default_factory=Place)
    created: dict[str, Entry] = field(default_factory=dict)
    sealed: dict[str, list[Entry]] = field(default_factory=dict)
    removed: dict[str, Entry] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    back: list[str] = field(default_factory=list)
    """Where the time of the entries runs back, in words: no problem, but a clock that was set back or was wrong."""
    keys: Counter[str] = field(default_factory=Counter)
    entries: int = 0


def walk(
    chain: Chain, begin: Place | None = None, end_at: int | None = None, *, trusted: frozenset[str] | None = None
) -> Walk:
    """Walk a chain from a place to its end, or to the end of the line that ends there.

    trusted: public keys whose signatures count; None for those that this computer knows.

    Raises:
        RecordError: the file cannot be read.

    """
    found = Walk(begin or Place())
    content, at = chain.content, found.place.offset
    last, aside = Last(found.place.counter, found.place.sha256), None
    sure = None if at else last
    keys = trust_of(chain).keys if trusted is None else trusted
    newest: Entry | None = None
    strange, from_first = 0, not at
    while (end := content.find(b"\n", at, end_at)) >= 0:
        line, begin_at = content[at:end], at
        at = end + 1
        entry = entry_of(line)
        if entry is None:
            strange += from_first and not found.entries
            # Torn by a power failure it is no object: where it was more than that, the next line has no link to it.
            if object_in(line) is not None:
                text = f"{CHAIN}: the line at byte {begin_at} is no entry: its fields are not those of an entry"
                found.problems.append(Problem("forged_entry", "", text))
            continue
        this = Last(entry.counter, entry.sha256)
        if not entry.signed:
            text = f"{CHAIN}: entry {entry.counter} ({_about(entry)}) is not signed by the key that it names"
            found.problems.append(Problem("forged_entry", str(entry.fields.get("run", "")), text))
            aside = this
            continue
        wrong = _link_problems(entry, last)
        if wrong and entry.key in keys:
            sure = sure or _sure_before(content[: found.place.offset], found.place, keys)
            if not _link_problems(entry, sure):
                wrong, last = [], sure  # what stands between was put there by a key that nobody trusts
        before = aside if wrong and aside is not None and aside.counter == entry.counter - 1 else last
        found.problems += _link_problems(entry, before)
        _take(found, entry, keys)
        repeats = bool(wrong) and entry.kind != LOST and entry.counter <= last.counter
        if (entry.key in keys and not repeats) or not (wrong or entry.kind == LOST):
            if newest is not None and newest.at - entry.at > SLACK:
                found.back.append(_runs_back(entry, newest))
            last, aside, newest = this, None, entry
            sure = this if entry.key in keys else sure
        else:
            aside = this
    found.place = Place(at, last.counter, last.sha256)
    if strange >= FIRST_LINES:
        text = f"{CHAIN}: {strange} lines before its first entry are no entries"
        found.problems.append(Problem("no_start" if chain.start is None else "strange_lines", "", text))
    return found


def _sure_before(content: bytes, place: Place, keys: frozenset[str]) -> Last:
    """Return the last entry of a trusted key in the row that ends at a place; where it has none, the end itself."""
    wanted = place.sha256
    for line in reversed(content.split(b"\n")):
        entry = entry_of(line) if hashlib.sha256(line).hexdigest() == wanted else None
        if entry is not None and entry.key in keys:
            return Last(entry.counter, wanted)
        wanted = wanted if entry is None else str(entry.fields["previous"])
    return Last(place.counter, place.sha256)


def follows(entry: Entry, last: Entry) -> bool:
    """Whether an entry is what comes next behind another."""
    return not _link_problems(entry, Last(last.counter, last.sha256))


def _take(found: Walk, entry: Entry, keys: frozenset[str]) -> None:
    found.entries += 1
    found.keys[entry.key] += 1
    run = str(entry.fields.get("run", ""))
    if entry.kind in (CREATED, REMOVED):
        there = found.created if entry.kind == CREATED else found.removed
        if entry.key in keys or run not in there:
            there[run] = entry
    elif entry.kind == SEALED:
        found.sealed.setdefault(run, []).append(entry)
    elif entry.kind == LOST:
        first, last = entry.fields["first"], entry.fields["last"]
        text = f"{CHAIN}: entries {first} to {last} were gone when entry {entry.counter} was written"
        found.problems.append(Problem("lost_entries", "", text))
    elif entry.kind == START and entry.fields["replaces"]:
        before = entry.fields["replaces"]
        text = f"{CHAIN}: another chain lay in this folder before, with {before['counter']} entries; it is gone"
        found.problems.append(Problem("replaced", "", text))


def _about(entry: Entry) -> str:
    run = entry.fields.get("run")
    return f"{entry.kind} {run}" if run else entry.kind


def _runs_back(entry: Entry, newest: Entry) -> str:
    before = f"entry {newest.counter} ({_about(newest)}) before it is of {newest.fields['time']}"
    return (
        f"{CHAIN}: entry {entry.counter} ({_about(entry)}) is of {entry.fields['time']}, and {before}: the clock was "
        "set back, or was wrong until then"
    )


def _link_problems(entry: Entry, last: Last) -> list[Problem]:
    """Return what is wrong between an entry and the one before it."""
    counter, sha256 = last
    run = str(entry.fields.get("run", ""))
    first = counter == 0
    if first and entry.kind != START:
        return [Problem("no_start", run, f"{CHAIN}: begins with entry {entry.counter} ({_about(entry)})")]
    expected = counter + 1
    if entry.kind == LOST:
        expected = max(counter, int(entry.fields["last"])) + 1
    if entry.counter > expected:
        missing = f"entry {expected} is" if entry.counter == expected + 1 else f"entries {expected} to "
        missing += "" if entry.counter == expected + 1 else f"{entry.counter - 1} are"
        return [Problem("removed_entries", run, f"{CHAIN}: {missing} missing before {_about(entry)}")]
    if entry.counter < expected:
        text = f"{CHAIN}: entry {entry.counter} ({_about(entry)}) is out of order: it follows entry {counter}"
        return [Problem("reordered_entries", run, text)]
    if entry.fields["previous"] != sha256:
        text = f"{CHAIN}: entry {entry.counter} ({_about(entry)}) does not hold the hash of the line before it"
        return [Problem("broken_link", run, text)]
    return []


def whole_between(chain: Chain, begin: Entry, end: Entry) -> bool:
    """Whether the lines from one entry to a later one hang together as they did when the later one was signed."""
    if end.counter == begin.counter + 1:
        return str(end.fields["previous"]) == begin.sha256
    content, row = chain.content, {begin.sha256: begin.counter}
    at = content.find(begin.line) + len(begin.line) + 1
    while end.sha256 not in row:
        behind = content.find(b"\n", at)
        if behind < 0:
            return False
        entry, at = entry_of(content[at:behind]), behind + 1
        # What stands between and is in no row with the two says nothing: anybody can write it.
        if entry is not None and entry.kind != LOST and row.get(entry.fields["previous"]) == entry.counter - 1:
            row[entry.sha256] = entry.counter
    return True


def end_problems(chain: Chain, place: Place) -> list[Problem]:
    """Return what the end of a chain, walked up to there, lacks of what this computer had seen."""
    seen = chain_seen_in(chain.data)
    if not chain.there:
        head = None if seen is None else head_of(seen, chain.data)
        if head is None:
            return []
        return [Problem("no_chain", "", f"{CHAIN}: is missing; this computer had seen {head.counter} entries")]
    found = []
    if seen not in (None, chain.id):
        found.append(
            Problem("replaced", "", f"{CHAIN}: another chain lay in this folder when this computer wrote to it")
        )
    head = head_of(chain.id, chain.data)
    if head is None or (head.counter, head.sha256) == (place.counter, place.sha256):
        return found
    if head.counter > place.counter:
        text = f"{CHAIN}: ends with entry {place.counter}; this computer had seen {head.counter}"
        found.append(Problem("truncated", "", text))
    elif f'"counter":{head.counter},'.encode() in chain.content and not _holds(chain, head.counter, head.sha256):
        text = f"{CHAIN}: entry {head.counter} is not the one that this computer had seen"
        found.append(Problem("truncated", "", text))
    return found


def _holds(chain: Chain, counter: int, sha256: str) -> bool:
    token, content = f',"counter":{counter},'.encode(), chain.content
    at = content.rfind(token)
    while at >= 0:
        begin, end = content.rfind(b"\n", 0, at) + 1, content.find(b"\n", at)
        entry = entry_of(content[begin:end])
        if entry is not None and entry.sha256 == sha256:
            return True
        at = content.rfind(token, 0, begin)
    return False


@dataclass(frozen=True)
class Trust:
    """Whose signatures count in a data folder; `warning` is empty where this computer knows that by itself."""

    keys: frozenset[str]
    warning: str = ""


def trust_of(chain: Chain, named: tuple[str, ...] = ()) -> Trust:
    """Return whose signatures count: keys that were named, or those that this computer knows.

    On a computer that never wrote to the folder, those in the folder itself; that is said as a warning. Where this
    computer has seen another chain in the folder, the keys beside a chain that it does not know say nothing.
    """
    if named:
        return Trust(frozenset(named))
    known, unknown = counting_keys(chain.data, chain.id)
    text = (
        f"{FOLDER_KEYS}: the public key that signed this folder is known from the folder itself only "
        f"({', '.join(sorted(unknown))}). Compare it with the bench's, or name it with --key"
    )
    return Trust(known | unknown, text if unknown else "")


def candidates(chain: Chain, entries: Iterable[Entry], trusted: frozenset[str] | None = None) -> list[Entry]:
    """Return which of these entries say something: the signed ones, and where some are of trusted keys only those.

    Anybody can sign a line with a key of his own and put it before the right one.

    trusted: None for the keys that this computer knows.
    """
    signed = [one for one in entries if one.signed]
    if len({one.key for one in signed}) < 2:
        return signed
    keys = trust_of(chain).keys if trusted is None else trusted
    return [one for one in signed if one.key in keys] or signed


def key_problems(found: Walk, trust: Trust) -> list[Problem]:
    """Return the keys that signed and that nobody here knows."""
    texts = {
        key: f"{CHAIN}: {count} entries are signed by {key}, which this computer does not know"
        for key, count in found.keys.items()
        if key not in trust.keys
    }
    return [Problem("unknown_key", "", text) for text in texts.values()]


def attempt_problems(found: Walk, trust: Trust) -> list[Problem]:
    """Return the serial numbers whose attempts in the chain do not count up; only of keys that are trusted."""
    last: dict[str, int] = {}
    problems = []
    for run, entry in found.created.items():
        if entry.key not in trust.keys:
            continue
        serial, attempt = str(entry.fields["serial"]), entry.fields["attempt"]
        if serial in last and attempt <= last[serial]:
            text = f"{run}: attempt {attempt} of {serial} is out of order: it follows attempt {last[serial]}"
            problems.append(Problem("attempt", run, text))
        last[serial] = attempt
    return problems
