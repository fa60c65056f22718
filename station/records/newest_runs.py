"""The newest runs of a data folder, also those whose record is damaged or gone: with what the chain says of each.

A folder that is no run is passed over. A run that the chain has begun is one, whatever became of its files since.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from station.atomic_file import document_bytes, open_file
from station.documents.manifest import Manifest
from station.documents.reading import document_in
from station.errors import StationError
from station.records.chain.chain_file import CREATED_MANIFEST
from station.records.chain.entries import Entry
from station.records.chain.lookup import ChainEnd
from station.records.data_folder import Store
from station.records.run_record import MANIFEST, RunRecord, only_simulated
from station.records.seal import CONCLUDED, is_sealed
from station.there import is_folder


@dataclass(frozen=True)
class KnownRun:
    """A run by its folder and by the chain.

    created, sealed: the lines of the chain that begin and conclude it, None where none counts. chain: id of that of
    the folder.
    """

    record: RunRecord
    created: Entry | None
    sealed: Entry | None
    chain: str

    @property
    def id(self) -> str:
        """Run id."""
        return self.record.id

    @property
    def here(self) -> bool:
        """Whether the folder of the run is there, or may be where nobody can look."""
        return is_folder(self.record.folder) is not False

    @property
    def serial(self) -> str:
        """Serial number of the unit: of the chain where that has the run; '' where nobody knows."""
        entry = self.sealed or self.created
        return (self.record.serial() or "") if entry is None else str(entry.fields["serial"])

    def can_be_read(self) -> bool:
        """Say whether run.json can be read, be it as it was sealed or not."""
        try:
            self.record.manifest()
        except StationError:
            return False
        return True

    def sound(self) -> Manifest | None:
        """Return run.json as it was sealed, or as it is while the run is not concluded; None where it is not so.

        Between its line in the chain and its place, a run.json waits under another name: that one counts.
        """
        names = (CONCLUDED, MANIFEST) if self.sealed else (MANIFEST, CREATED_MANIFEST)
        for name in names:
            try:
                with open_file(self.record.folder / name) as file:
                    content = document_bytes(file)
            except OSError:
                continue
            try:
                if self.sealed is not None:
                    if hashlib.sha256(content).hexdigest() != self.sealed.fields["sha256"]:
                        continue
                    return document_in(Manifest, content, self.record.folder / name)
                found = document_in(Manifest, content, self.record.folder / name)
            except StationError:
                return None
            return None if self._was_sealed_here(found) else found
        return None

    def only_simulated(self) -> bool:
        """Whether the run only simulated the bench that it names, by a run.json that is `sound`."""
        found = self.sound()
        return found is not None and only_simulated(found)

    def _was_sealed_here(self, found: Manifest) -> bool:
        """Say whether an unsealed run.json says that it is concluded, though the chain of this folder began it."""
        begun_here = self.created is not None or (found.chain is not None and found.chain.id == self.chain)
        return is_sealed(found) and begun_here


def newest_runs(data: Path, store: Store | None = None) -> Iterator[KnownRun]:
    """Yield the runs of a data folder, newest first; StationError where its chain cannot be read."""
    end = ChainEnd(data)
    folders = iter((store or Store(data)).newest_first())
    begun = sorted(end.runs(), reverse=True)
    folder = next(folders, None)
    while folder is not None or begun:
        name = max(begun[0] if begun else "", "" if folder is None else folder.id)
        if begun and begun[0] == name:
            begun.pop(0)
        if folder is not None and folder.id == name:
            folder = next(folders, None)
        yield KnownRun(RunRecord(data / name), end.created(name), end.sealed(name), end.id)
