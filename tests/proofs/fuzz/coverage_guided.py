"""Coverage-guided fuzzing by atheris: `python tests/proofs/fuzz/coverage_guided.py [SECONDS] [TARGET ...]`, one by one.

Starts from the committed corpus; what finds new code is kept in a folder of its own and forgotten at the end, unless
`--keep` is given: then the smallest inputs that reach new code join the corpus. An input that breaks something is left
in `tests/proofs/fuzz/found/`, to be replayed by `python tests/proofs/fuzz/coverage_guided.py --replay FILE`.
"""

from __future__ import annotations

import argparse
import hashlib
import logging
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
sys.path[:0] = [str(HERE), str(ROOT)]
CORPUS, FOUND = HERE / "corpus", HERE / "found"
PACKAGES = ["analysis", "controller", "definitions", "drivers", "recipes", "station", "targets"]
LARGEST_INPUT = 8192
KEPT_BYTES = 600
"""Larger inputs do not join the corpus: it stays small."""

MOST_KEPT = 4


def _fuzz(target: str, seconds: int, folders: list[str]) -> None:
    """Fuzz in this process, which libFuzzer ends."""
    import atheris  # noqa: PLC0415 - an optional extra without wheels for every machine

    logging.disable(logging.CRITICAL)
    with atheris.instrument_imports(include=PACKAGES):
        from targets import TARGETS  # noqa: PLC0415 - instrumented when it is imported
    FOUND.mkdir(exist_ok=True)
    options = (
        f"-max_total_time={seconds}",
        f"-max_len={LARGEST_INPUT}",
        f"-artifact_prefix={FOUND}/{target}-",
        "-timeout=10",
        "-rss_limit_mb=4096",
        "-print_final_stats=1",
    )
    atheris.Setup([sys.argv[0], *options, *folders], TARGETS[target])
    atheris.Fuzz()


def _names() -> list[str]:
    return sorted(path.name for path in CORPUS.iterdir())


def _one(target: str, seconds: int, *, keep: bool) -> bool:
    """Fuzz one target in a process of its own; True when nothing broke."""
    with tempfile.TemporaryDirectory(prefix="lostmotion-fuzz-") as fresh:
        command = [sys.executable, __file__, "--inside", target, str(seconds), fresh, str(CORPUS / target)]
        begin = time.monotonic()
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        took_s = time.monotonic() - begin
        said = dict(
            line.removeprefix("stat::").split(": ", 1) for line in done.stderr.splitlines() if line.startswith("stat::")
        )
        runs = said.get("number_of_executed_units", "?").strip()
        new = sorted(Path(fresh).iterdir(), key=lambda path: path.stat().st_size)
        covered = [word for line in done.stderr.splitlines() if " cov: " in line for word in line.split()]
        cover = covered[len(covered) - 1 - covered[::-1].index("cov:") + 1] if "cov:" in covered else "?"
        sys.stdout.write(
            f"{target:18} {runs:>8} inputs in {took_s:5.1f} s, {cover:>5} places reached, {len(new):3} new inputs: "
            f"{'nothing broke' if done.returncode == 0 else 'BROKEN'}\n"
        )
        sys.stdout.flush()
        if done.returncode:
            sys.stdout.write(done.stderr[-3000:] + "\n")
        if keep:
            for path in [path for path in new if 0 < path.stat().st_size <= KEPT_BYTES][-MOST_KEPT:]:
                data = path.read_bytes()
                (CORPUS / target / hashlib.sha256(data).hexdigest()[:10]).write_bytes(data)
    return done.returncode == 0


def main() -> int:
    """Fuzz every target, or those that were named; 1 when one broke."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seconds", nargs="?", type=int, default=60)
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--replay", type=Path)
    parser.add_argument("--inside", nargs="+")
    args = parser.parse_args()
    if args.inside:
        _fuzz(args.inside[0], int(args.inside[1]), args.inside[2:])
    if args.replay:
        from targets import TARGETS  # noqa: PLC0415 - not instrumented

        TARGETS[args.replay.name.split("-")[0]](args.replay.read_bytes())
        sys.stdout.write("nothing broke\n")
        return 0
    broken = sum(not _one(target, args.seconds, keep=args.keep) for target in args.targets or _names())
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
