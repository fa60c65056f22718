"""A step from its order to its entry in the protocol."""

from __future__ import annotations

import getpass
from collections.abc import Sequence

from definitions.commissioning import STEP_BY_ID
from station.bench.commissioned import Standing, add_to_protocol, depended_on, read_protocol, refuse_before, standings
from station.commissioning.on_wires import OnWires
from station.documents.commissioning import Figure, Finding, StepDone
from station.version import version
from station.wall_clock import now_text


def may_begin(bench: OnWires, step: str) -> None:
    """Refuse a step while one before it has not passed, or is due again; StationError with the command for that."""
    refuse_before(STEP_BY_ID[step], how_it_stands(bench), bench.path)


def how_it_stands(bench: OnWires) -> tuple[Standing, ...]:
    """Return how each step stands now; RecordError when the protocol is damaged."""
    return standings(read_protocol(bench.path, bench.bench), bench.parts)


def write_down(
    bench: OnWires, step: str, by: str | None, findings: Sequence[Finding], figures: Sequence[Figure]
) -> StepDone:
    """Put a step that was done into the protocol and return its entry; it has passed when no finding refuses it.

    by: who did it, by default the user of this computer.

    Raises:
        RecordError: the protocol is damaged, or cannot be written.

    """
    done = StepDone(
        step=step,
        passed=not any(finding.refuses for finding in findings),
        when=now_text(),
        by=by or getpass.getuser(),
        software=version(),
        bench_sha256=bench.source.sha256,
        figures=tuple(figures),
        findings=tuple(findings),
        parts=depended_on(STEP_BY_ID[step], bench.parts),
    )
    add_to_protocol(bench.path, bench.bench, done)
    return done
