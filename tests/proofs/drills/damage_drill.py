"""Damages one run of a folder of twenty, often. `python tests/proofs/drills/damage_drill.py [COUNT] [SEED]`.

After each damage the other nineteen must be listed, shown, evaluated, replayed, exported, reported and resumed as
before, and the recovery (`recover`) must be open; no command may end with exit code 70.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2]), str(Path(__file__).parents[3])]

from damage import NOT_EVIDENCE, OWN, Folder  # noqa: E402 - after the path of a script run by hand
from lostmotion_command import ROOT, here  # noqa: E402

from station.own_place import PLACE  # noqa: E402

OTHERS_ASKED = 3
"""Runs of the nineteen, drawn anew for each damage, of which every single command is asked; all stand in `list`."""


def main() -> int:
    """Damage and judge; 1 when something went wrong."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else random.SystemRandom().randrange(10**6)
    started, drawn = time.monotonic(), random.Random(seed + 1)  # noqa: S311 - to be drawn again
    sys.stdout.write(f"{count} damages, seed {seed}\n")
    with tempfile.TemporaryDirectory(prefix="lostmotion-damage-") as name:
        place = Path(name)
        os.environ[PLACE] = str(place / OWN)
        golden = str(ROOT / "tests" / "proofs" / "golden" / "golden.yaml")
        words = ("--serial", "R", "--virtual-time", "--no-report", "--json", "--data", str(place / "golden"))
        folder = Folder(place, here("run", golden, *words).record, report=True)
        bad, named = 0, Counter[str]()
        for number, damage in enumerate(folder.damages(seed, count)):
            found = folder.judge(damage, drawn, others=OTHERS_ASKED)
            bad += bool(found.wrong)
            evidence = damage.file not in NOT_EVIDENCE
            named[f"named by {found.named}" if found.named else "not named" if evidence else "not evidence"] += 1
            sys.stdout.write(f"{number:4} {damage}: {'; '.join(found.wrong) or found.named or 'nothing told'}\n")
            sys.stdout.flush()
    told = ", ".join(f"{times} {what}" for what, times in sorted(named.items()))
    took_s = time.monotonic() - started
    sys.stdout.write(f"{told}\n{count} damages of {len(folder.ids)} runs, {bad} with problems, {took_s:.0f} s in all\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
