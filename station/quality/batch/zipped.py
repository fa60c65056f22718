"""The report of a batch as one file; what draws is loaded when it is made, in the process that evaluates."""

from __future__ import annotations

import io
import tempfile
import zipfile
from pathlib import Path

from station.results.export import LOCALES
from station.store.quality.lot import Lot


def batch_zip(data: Path, lot: Lot, loops: int, locale: str) -> bytes:
    """Return all files of the report as a ZIP file; StationError as `batch_of`."""
    from station.quality.batch.content import batch_of  # noqa: PLC0415 - draws
    from station.quality.batch.files import write_batch  # noqa: PLC0415 - draws

    batch = batch_of(data, lot, loops)
    kept = io.BytesIO()
    with tempfile.TemporaryDirectory() as place, zipfile.ZipFile(kept, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in write_batch(batch, Path(place), LOCALES[locale]):
            archive.write(file, f"batch/{file.name}")
    return kept.getvalue()
