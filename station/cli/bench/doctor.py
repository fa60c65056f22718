"""`lostmotion doctor`: what stands between this computer and a scan that is never late, and how to mend it."""

from __future__ import annotations

import json
import sys

from station.cli.say import Grid, say
from station.documents.entries import plain
from station.scan.machine import look

IN_THE_WAY = 1


def doctor(*, as_json: bool) -> int:
    """Print every look at the machine; return 0 when nothing stands in the way, else 1."""
    findings = look()
    wrong = [one for one in findings if not one.in_order]
    if as_json:
        sys.stdout.write(json.dumps(plain(findings), ensure_ascii=False) + "\n")
        return IN_THE_WAY if wrong else 0
    rows = [("ok" if one.in_order else "MEND", one.name, one.found) for one in findings]
    blocks: list[str | Grid] = [Grid(("", "", ""), rows)]
    blocks += [f"{one.name}: {one.mend}" for one in wrong]
    blocks.append(
        "Then measure: lostmotion timing --seconds 60"
        if wrong
        else "Nothing stands in the way. What the machine does, 'lostmotion timing --seconds 60' measures"
    )
    say({}, blocks, as_json=False)
    return IN_THE_WAY if wrong else 0
