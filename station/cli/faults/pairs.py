"""`lostmotion faults pairs`: two faults at once, drawn by chance, judged by the plant and by a run without them."""

from __future__ import annotations

import json
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial

from faultlab.pairs.judge import Pair, measure_pair
from station.counted import counted


def pairs(seed: int, numbers: range, workers: int, *, as_json: bool) -> int:
    """Run the pairs `numbers` of a draw and say each; 0 when nothing is wrong in any, 1 when something is."""
    found: list[Pair] = []
    with ProcessPoolExecutor(workers) as pool:
        for one in pool.map(partial(measure_pair, seed), numbers):
            found.append(one)
            if not as_json:
                sys.stdout.write(line(one) + "\n")
                sys.stdout.flush()
    bad = [one.number for one in found if one.wrong]
    if as_json:
        sys.stdout.write(json.dumps({"seed": seed, "pairs": [asdict(one) for one in found]}, ensure_ascii=False) + "\n")
    else:
        verdicts = Counter(one.verdict for one in found)
        each = ", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items()))
        peak_nm = max(one.peak_nm for one in found)
        opened_nm = max((one.opened_nm for one in found if one.opened_nm is not None), default=0.0)
        sys.stdout.write(
            f"seed {seed}: {counted(len(found), 'pair')}: {each}; largest torque {peak_nm:.1f} N·m, lock opened at "
            f"{opened_nm:.1f} N·m at most; wrong: {wrong_text(bad)}\n"
        )
    return 1 if bad else 0


def wrong_text(bad: list[int]) -> str:
    """Return how many pairs are wrong, and by their numbers which; a number alone would be taken for a count."""
    return f"{len(bad)} ({'pair' if len(bad) == 1 else 'pairs'} {', '.join(map(str, bad))})" if bad else "none"


def line(one: Pair) -> str:
    """One pair as a line of text, and a line for each thing that is wrong."""
    why = f" ({one.alarm})" if one.alarm else ""
    distance = "" if one.largest_en is None else f", E_n {one.largest_en:.2f} at most"
    told = f"{one.number:5}  {' + '.join(one.faults)}: {one.state}{why}, {one.verdict}{distance}"
    return "\n".join([told, *(f"       WRONG: {text}" for text in one.wrong)])
