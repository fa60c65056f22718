"""`lostmotion reevaluate`: what another recipe, metric definition or limit would have said of thousands of runs."""

from __future__ import annotations

import csv
import os
import sys
from dataclasses import dataclass
from pathlib import Path

from station.archive.settings import load_settings
from station.cli.say import Grid, say
from station.counted import counted
from station.records.archive_note import SETTINGS
from station.reevaluation.jobs import where_of
from station.reevaluation.question import LimitsQuestion, Question, ReevaluationError, limits_of, question_of
from station.reevaluation.run_question import Means, Reevaluated, ask_of_runs
from station.results.csv_cells import text_cell

EXIT_FAILED = 1
MOST_SHOWN = 20
SAID_EVERY = 100
BESIDE = "No stored verdict was changed. These results were stored separately, in folder"


@dataclass(frozen=True)
class Asked:
    """What the command line asks: one of recipe, metrics with preset, limits; which runs; by what means."""

    recipe: str | None
    preset: str | None
    metrics: tuple[str, ...]
    limits: str | None
    where: tuple[str, ...]
    cluster: str | None
    workers: int | None
    archive: bool


def reevaluate_runs(data: Path, asked: Asked, *, as_csv: bool, as_json: bool) -> int:
    """Ask a question of every run that fits; return 0, or 1 where some could not be evaluated.

    Raises:
        StationError, RecipeError, AnalysisError: nothing can be asked, or not of these runs.

    """
    question, where = _question(asked), where_of(asked.where)
    archive = load_settings(data) if asked.archive or asked.cluster or (data / SETTINGS).is_file() else None
    means = Means(asked.workers or os.cpu_count() or 1, archive, asked.cluster, asked.archive)
    found = ask_of_runs(data, question, where, means, _tell)
    if not found.lines and not found.failed:
        raise ReevaluationError(f"{data}: no complete run fits --where. See 'lostmotion list'")
    if as_csv:
        _write_csv(found)
    else:
        say(_document(found), _blocks(found), as_json=as_json)
    return EXIT_FAILED if found.failed else 0


def _question(asked: Asked) -> Question | LimitsQuestion:
    if asked.limits is None:
        return question_of(asked.recipe, asked.preset, asked.metrics)
    if asked.recipe or asked.preset or asked.metrics:
        raise ReevaluationError(
            "--limits cannot be combined with --recipe, --metric or --preset. Leave those options out"
        )
    return limits_of(asked.limits)


def _tell(done: int, there: int) -> None:
    if done and done % SAID_EVERY == 0:
        sys.stderr.write(f"{done} of {there} runs\n")


def _document(found: Reevaluated) -> object:
    changes = [{"before": was, "after": now, "runs": number} for (was, now), number in sorted(found.changes().items())]
    return {
        "question": found.question,
        "question_sha256": found.hash,
        "software": found.software,
        "ledger": str(found.ledger),
        "ledger_sha256": found.digest,
        "runs": len(found.lines),
        "evaluated": found.evaluated,
        "known": found.known,
        "processes_replaced": found.died,
        "seconds": round(found.seconds, 3),
        "processor_s": round(found.processor_s, 3),
        "changes": changes,
        "flips": [
            {"run": one.run, "serial": one.serial, "before": one.before, "after": one.after, "reasons": one.reasons}
            for one in found.flips()
        ],
        "failed": [{"run": run, "why": why} for run, why in sorted(found.failed.items())],
    }


def _blocks(found: Reevaluated) -> list[str | Grid]:
    blocks: list[str | Grid] = [f"RE-EVALUATED by {found.question}: {counted(len(found.lines), 'run')}", ""]
    flipping = {(one.before, one.after) for one in found.flips()}
    rows = [
        [was, now, str(number), "" if was == now else "flips" if (was, now) in flipping else "no limit was asked for"]
        for (was, now), number in sorted(found.changes().items())
    ]
    blocks.append(Grid(("verdict", "would be", "runs", ""), rows, right=(2,)))
    flips = found.flips()
    if flips:
        shown = [[one.run, one.serial, one.before, one.after, "; ".join(one.reasons)] for one in flips[-MOST_SHOWN:]]
        more = f", the newest {MOST_SHOWN}; --csv has all" if len(flips) > MOST_SHOWN else ""
        blocks += [
            "",
            f"{counted(len(flips), 'verdict')} would be another one{more}:",
            Grid(("run", "serial", "verdict", "would be", "reasons"), shown),
        ]
    blocks += [f"not evaluated: {run}: {why}" for run, why in sorted(found.failed.items())[:MOST_SHOWN]]
    replaced = f", {counted(found.died, 'process', 'processes')} replaced" if found.died else ""
    blocks += [
        "",
        f"{found.evaluated} evaluated in {found.seconds:.1f} s, {found.known} known before{replaced}",
        f"{BESIDE} {found.ledger}",
    ]
    return blocks


def _write_csv(found: Reevaluated) -> None:
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(("run", "serial", "verdict", "would be", "flips", "reasons", "question", "software"))
    for line in found.lines:
        texts = (line.run, line.serial, line.before, line.after, "yes" if line.flips else "no", "; ".join(line.reasons))
        writer.writerow([text_cell(one) for one in (*texts, found.question, line.software)])
    sys.stderr.writelines(f"not evaluated: {run}: {why}\n" for run, why in sorted(found.failed.items()))
