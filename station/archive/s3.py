"""An S3 bucket as fsspec has it, by the client that Arrow brings: of the extra `plant`."""

from __future__ import annotations

from fsspec.implementations.arrow import ArrowFSWrapper

SCHEME = "archive"
"""How DuckDB is told of objects in S3: s3:// it would give to an extension that it downloads."""


class Bucket(ArrowFSWrapper):  # type: ignore[misc, unused-ignore]
    """Paths are BUCKET/FOLDER/NAME, with or without archive:// before them."""

    protocol = SCHEME

    @classmethod
    def _strip_protocol(cls, path: str) -> str:
        return path.removeprefix(f"{SCHEME}://").rstrip("/")
