"""What can be wrong with a chain and the runs in it: one table, with what a person does about each."""

from __future__ import annotations

from typing import NamedTuple

PROBLEMS: dict[str, str] = {
    "forged_entry": "This line of chain.jsonl was not signed with the key in it. Compare the file with a backup",
    "removed_entries": "Lines of chain.jsonl were removed. Restore this file from a backup",
    "reordered_entries": "Lines of chain.jsonl were moved or duplicated. Restore this file from a backup",
    "broken_link": "A line of chain.jsonl was changed. Restore this file from a backup",
    "truncated": "The end of chain.jsonl was cut off. Restore this file and the runs from a backup",
    "lost_entries": "Lines of chain.jsonl were cut off before this entry was written. Look for the runs in a backup",
    "no_chain": "The file chain.jsonl was removed. Restore it from a backup",
    "unsigned": "Restore chain.jsonl from a backup. If the folder is from before there were chains, verify it without "
    "--key and --bench, which proves less",
    "no_start": "The first line of chain.jsonl is missing or changed. Restore this file from a backup",
    "strange_lines": "Lines of another hand stand before the first line of chain.jsonl. Take them out of this file",
    "replaced": "The data folder was emptied or replaced. Look for its runs in a backup",
    "unknown_key": "Another computer signed these entries. If it belongs to one of your benches, trust its public key: "
    "'lostmotion key --trust KEY'",
    "old_index": "The list of runs that are older than chain.jsonl was changed. Restore it from a backup",
    "missing": "The folder of this run was deleted or moved. Restore it from a backup, or write down why it is gone",
    "renamed": "The folder of a run was renamed. Rename it back to the run id in its run.json",
    "swapped": "The folders of two runs have exchanged names. Rename each to the run id in its run.json",
    "copied": "This folder is a copy of another run. Move the copy out of the data folder",
    "not_in_chain": "This run was not recorded in this data folder. Move it out of the data folder",
    "lost_line": "The line of chain.jsonl that begins this run is gone. Restore this file from a backup; leave the run "
    "where it is",
    "altered": "A file of the run was changed. Restore the run from a backup; an altered run gives no verdict",
    "damaged": "A file of the run is damaged. Restore the run from a backup",
    "trace": "A stored trace (torque and angle of a run) is missing or was changed. Restore the folder 'traces' from a "
    "backup",
    "attempt": "Two attempts of a unit have the same number, or one is missing. "
    "Compare the runs of this serial number with a backup",
    "recipes": "The stored recipes were changed. Restore recipes.jsonl and the folder 'recipes' from a backup",
    "archive": "The list of archived runs cannot be read. Move it away: 'lostmotion archive verify' makes it again",
    "study": "The file of a guided study was changed. Restore the folder 'studies' from a backup",
}
"""Kinds of problem and what to do about them."""


class Problem(NamedTuple):
    """One finding: its kind (a key of `PROBLEMS`), the run it is about ('' for the chain), and what was found."""

    kind: str
    run: str
    text: str

    @property
    def sentence(self) -> str:
        """The finding and what to do about it."""
        return f"{self.text}. {PROBLEMS[self.kind]}"

    def as_json(self) -> dict[str, str]:
        """Return plain data."""
        return {"kind": self.kind, "run": self.run, "text": self.text, "next_action": PROBLEMS[self.kind]}
