"""`lostmotion faults reactions`: what each reaction orders, and which faults bring it about."""

from __future__ import annotations

import json
import sys

from definitions.faults import FAULTS
from definitions.image import DriveCommand, Reaction
from drivers.servo_drive.cia402 import CONTROL_WORDS
from virtual_bench.faults.reactions import REACTIONS


def list_reactions(*, as_json: bool) -> int:
    """Print the table of reactions."""
    if as_json:
        rows = [
            {
                "reaction": reaction.name.lower(),
                "orders": [_order(command) for command in row.orders],
                "then": None if row.then is None else _order(row.then),
                "state": None if row.state is None else row.state.name.lower(),
                "lock_contact": "kept",
                "opened_contacts": list(row.contacts),
                "what": row.what,
                "faults": faults_of(reaction),
            }
            for reaction, row in REACTIONS.items()
        ]
        sys.stdout.write(json.dumps(rows, ensure_ascii=False) + "\n")
        return 0
    for reaction, row in REACTIONS.items():
        then = "" if row.then is None else f", then {written(row.then)}"
        lines = {
            "what": row.what,
            "order": (" or ".join(map(written, row.orders)) or "as before") + then,
            "state": "stays" if row.state is None else row.state.name.lower(),
            "contacts": "lock unchanged" + "".join(f"; triggered by the open {name}" for name in row.contacts),
            "faults": ", ".join(faults_of(reaction)) or "none",
        }
        text = "".join(f"  {name:9} {value}\n" for name, value in lines.items())
        sys.stdout.write(f"{reaction.name.lower()}\n{text}")
    return 0


def faults_of(reaction: Reaction) -> list[str]:
    """Return the faults that bring a reaction about, in the order of the fault table."""
    return [fault.id for fault in FAULTS if fault.reaction == reaction]


def written(command: DriveCommand) -> str:
    """Return a drive command with its control word, as it goes over the wire."""
    return f"{command.name.lower()} (control word 0x6040 = 0x{CONTROL_WORDS[command]:02X})"


def _order(command: DriveCommand) -> dict[str, str | int]:
    return {"order": command.name.lower(), "control_word": CONTROL_WORDS[command]}
