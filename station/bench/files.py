"""Files as they were read once, and files that are read when they are asked for: profiles come from either."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from recipes import Bench, find_bench, parse_bench, parse_written_bench, read_bytes
from station.records.run_record import BENCH_COPY, MANIFEST


class File(Protocol):
    """A file that was read: where it is, and its bytes."""

    @property
    def path(self) -> Path:
        """Where it is."""

    @property
    def content(self) -> bytes:
        """Its bytes."""


@dataclass(frozen=True)
class FileAt:
    """A file that is read when it is asked for; RecipeError when it cannot be."""

    path: Path

    @property
    def content(self) -> bytes:
        """Its bytes, as they are now."""
        return read_bytes(self.path)


def load_named_bench(name_or_path: str | Path) -> Bench:
    """Load the bench file that a person names, by its path or its shipped name; as `named_bench`."""
    path = find_bench(name_or_path)
    return named_bench(read_bytes(path), path)


def named_bench(content: bytes, path: Path) -> Bench:
    """Return the bench in the bytes of a file that a person names; RecipeError with all of its problems.

    An option without a value is one; not in the copy in a record, which nobody writes any more: it opens as ever.
    """
    in_record = path.name == BENCH_COPY and (path.parent / MANIFEST).is_file()
    parse = parse_bench if in_record else parse_written_bench
    return parse(content, str(path))
